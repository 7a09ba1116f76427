"""What `gibench conform` found, on the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd
from rich.markup import escape
from rich.table import Table

from gibench.report.figures import number
from gibench.report.terminal import console

_COLORS = {"right": "green", "wrong": "red", "cannot run": "yellow", "no oracle": "dim"}


def show_conformance(kernels: pd.DataFrame, record: Mapping[str, Any]) -> None:
    """The device, a row for each kernel, and how many of each status there are."""
    out, device = console(), record["device"]
    said = f"{device['name']} ({device['platform']}, {device['platform_version']})"
    out.print(f"[bold]{escape(said)}[/], driver {escape(device['driver'])}", soft_wrap=True)
    table = Table("kernel", "status", "work-group sizes", "of tolerance", "why")
    table.columns[3].justify = "right"
    for row in kernels.to_dict("records"):
        table.add_row(
            escape(str(row["kernel"])),
            f"[{_COLORS[str(row['status'])]}]{row['status']}[/]",
            str(row["sizes"]),
            number(row["off"], 3),
            escape(str(row["why"])),
        )
    out.print(table)
    counts = kernels["status"].value_counts()
    out.print(", ".join(f"{counts.get(status, 0)} {status}" for status in _COLORS))
