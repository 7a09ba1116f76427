"""``gibench techniques``."""

from __future__ import annotations


def techniques() -> None:
    """List the techniques and their settings, with units and what they trade."""
    from dataclasses import fields

    from rich.markup import escape
    from rich.table import Table

    from gibench.commands.asked import BY_OPTION
    from gibench.report.terminal import console
    from gibench.techniques.registry import techniques as all_techniques

    out = console()
    for spec in all_techniques().values():
        out.print(f"[bold]{spec.name}[/]: {escape(spec.title)} ({', '.join(spec.variants)})")
        table = Table("option", "default", "unit", "what it does")
        usual = spec.settings_type()
        for item in fields(spec.settings_type):
            option = (
                f"--{item.name.replace('_', '-')}"
                if item.name in BY_OPTION
                else f"--set {spec.name}.{item.name}="
            )
            default = str(getattr(usual, item.name))
            unit, text = item.metadata.get("unit", ""), item.metadata.get("help", "")
            table.add_row(option, escape(default), escape(str(unit)), escape(str(text)))
        if table.row_count:
            out.print(table)
