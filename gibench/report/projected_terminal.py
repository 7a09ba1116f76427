"""Projected ranges on the terminal."""

from __future__ import annotations

import pandas as pd
from rich.markup import escape
from rich.table import Table

from gibench.report.projected import (
    RATIO_HEAD,
    RATIO_WARNING,
    WARNING,
    configuration_text,
    range_text,
    ranked_cells,
    ratio_cells,
)
from gibench.report.terminal import console


def show_ranking(table: pd.DataFrame) -> None:
    """Settings by projected GI; columns as ``RANKED``."""
    out = console()
    title = f"GI on {table['device'].iloc[0]}: projected, not measured"
    shown = Table("rank", "technique", "settings", "receivers", "PROJECTED GI", "than the last",
                  "than the first", "verdict", title=title, title_justify="left")  # fmt: skip
    for cells in ranked_cells(table):
        shown.add_row(*(escape(cell) for cell in cells))
    out.print(shown)
    out.print(WARNING, soft_wrap=True)


def show_projection(table: pd.DataFrame) -> None:
    """The ranges on the terminal."""
    out = console()
    shown = Table("configuration", "on", "pass", title="Projected, not measured",
                  title_justify="left")  # fmt: skip
    shown.add_column("PROJECTED range", justify="right")
    for name in ("verdict", "bound by", "driven by"):
        shown.add_column(name)
    for _, row in table.iterrows():
        shown.add_row(
            escape(f"{row['configuration']}: {configuration_text(row)}"),
            escape(str(row["device"])),
            escape(str(row["pass"])),
            range_text(row),
            row["verdict"],
            *(
                "" if pd.isna(row[name]) else escape(str(row[name]))
                for name in ("bound_by", "driven_by")
            ),
        )
    out.print(shown)
    out.print(WARNING, soft_wrap=True)


def show_ratios(table: pd.DataFrame) -> None:
    """Ratios to the cheapest on the terminal; nothing where nothing is compared."""
    if table.empty:
        return
    out = console()
    shown = Table(*RATIO_HEAD, title="Projected ratios, not measured", title_justify="left")
    for cells in ratio_cells(table):
        shown.add_row(*(escape(cell) for cell in cells))
    out.print(shown)
    out.print(RATIO_WARNING, soft_wrap=True)
