"""What ``gibench calibrate`` measured, on the terminal."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from gibench.report.terminal import console


def show_calibration(figures: pd.DataFrame, out: Path) -> None:
    """A row for each figure, and where the profile went."""
    from rich.markup import escape
    from rich.table import Table

    table = Table("figure")
    for heading in ("low", "nominal", "high", "times wide before", "now"):
        table.add_column(heading, justify="right")
    for figure, *numbers in figures.itertuples(index=False):
        table.add_row(str(figure), *(f"{float(number):,.3g}" for number in numbers))
    screen = console()
    screen.print(table)
    screen.print(f"written to {escape(str(out))}", soft_wrap=True)
