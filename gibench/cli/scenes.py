"""``gibench scenes``."""

from __future__ import annotations


def scenes() -> None:
    """List the built-in scenes; any glTF, OBJ or scene TOML works by its path."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.commands.listings import list_scenes
    from gibench.report.terminal import console

    table = Table("name")
    for title in ("triangles", "probes", "receivers", "lights", "cameras"):
        table.add_column(title, justify="right")
    for row in list_scenes().to_dict("records"):
        numbers = (row["triangles"], row["probes"], row["receivers"], row["lights"])
        cameras = escape(", ".join(row["cameras"]))
        table.add_row(escape(row["name"]), *(f"{number:,}" for number in numbers), cameras)
    console().print(table)
