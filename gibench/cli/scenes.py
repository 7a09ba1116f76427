"""``gibench scenes``."""

from __future__ import annotations


def scenes() -> None:
    """List the built-in scenes; any glTF, OBJ or scene TOML works by its path."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.report.terminal import console
    from gibench.scene.builtin import build, names

    table = Table("name")
    for title in ("triangles", "probes", "receivers", "lights", "cameras"):
        table.add_column(title, justify="right")
    for name in names():
        scene = build(name)
        table.add_row(
            escape(name),
            f"{len(scene.triangles):,}",
            f"{scene.probes.count:,}",
            f"{scene.receivers:,}",
            f"{len(scene.lights)}",
            escape(", ".join(camera.name for camera in scene.cameras)),
        )
    console().print(table)
