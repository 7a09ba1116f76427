"""``gibench techniques``."""

from __future__ import annotations


def techniques() -> None:
    """List the techniques and their settings, with units and what they trade."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.commands.listings import list_techniques
    from gibench.report.terminal import console
    from gibench.techniques.registry import find_technique

    out = console()
    for name, rows in list_techniques().groupby("technique", sort=False):
        spec = find_technique(str(name))
        out.print(f"[bold]{spec.name}[/]: {escape(spec.title)} ({', '.join(spec.variants)})")
        table = Table("option", "default", "unit", "what it does")
        for row in rows.dropna(subset=["setting"]).to_dict("records"):
            table.add_row(
                row["option"], escape(str(row["default"])), escape(row["unit"]), escape(row["help"])
            )
        if table.row_count:
            out.print(table)
