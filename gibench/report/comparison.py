"""Comparisons to read: on the terminal, as Markdown for a pull request, as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
from rich.markup import escape
from rich.table import Table

from gibench.errors import GibenchError
from gibench.measure.compare.paired import Judged
from gibench.report.figures import number
from gibench.report.terminal import console

_STYLE = {"faster": "green", "slower": "bold red", "ambiguous": "yellow", "same": "dim"}
_MARK = {"faster": "🟢", "slower": "🔴", "ambiguous": "🟡", "same": "⚪"}


@dataclass(frozen=True)
class Row:
    """One line of a comparison.

    Attributes:
        configuration: in words; empty where there is one only.
        name: the frame or a pass.
        old_ms: the baseline's median.
        new_ms: the other's.
    """

    configuration: str
    name: str
    old_ms: float
    new_ms: float
    judged: Judged


@dataclass(frozen=True)
class Comparison:
    """How times of two kernel trees, or of two recordings, compare.

    Attributes:
        title: what was compared.
        rows: the frame and every pass, with times and verdict.
        remarks: what a reader must know.
        facts: for the JSON file, beside the rows.
        error: what the command ends with where something is slower, broken or missing, else None.
    """

    title: str
    rows: list[Row] = field(repr=False)
    remarks: list[str] = field(repr=False)
    facts: dict[str, Any] = field(repr=False)
    error: GibenchError | None = None

    @property
    def table(self) -> pd.DataFrame:
        """A row per frame and pass, as the JSON file names them."""
        return pd.DataFrame(self.content["rows"])

    @property
    def markdown(self) -> str:
        """The table for a pull request."""
        lines = [
            f"### {self.title}",
            "",
            "| | row | old ms | new ms | new / old | 99 % interval | verdict |",
            "|---|---|---:|---:|---:|---|---|",
        ]
        last = None
        for row in self.rows:
            if row.configuration != last and row.configuration:
                lines.append(f"| | **{_cell(row.configuration)}** | | | | | |")
            last = row.configuration
            lines.append(
                f"| {_MARK[row.judged.verdict]} | {_cell(row.name)} | {number(row.old_ms, 3)} | "
                f"{number(row.new_ms, 3)} | {row.judged.ratio:.3f} | {_interval(row.judged)} | "
                f"{row.judged.verdict} |"
            )
        return "\n".join([*lines, "", *(f"{remark}  " for remark in self.remarks)]) + "\n"

    @property
    def content(self) -> dict[str, Any]:
        """Everything, as the JSON file holds it; an interval's end that is not known is null."""
        return {
            **self.facts,
            "rows": [
                {
                    "configuration": row.configuration,
                    "row": row.name,
                    "old_ms": _finite(row.old_ms),
                    "new_ms": _finite(row.new_ms),
                    "ratio": _finite(row.judged.ratio),
                    "low": _finite(row.judged.low) if math.isfinite(row.judged.high) else None,
                    "high": _finite(row.judged.high),
                    "verdict": row.judged.verdict,
                    "replicates": row.judged.replicates,
                }
                for row in self.rows
            ],
        }

    def show(self) -> None:
        """Print it on the terminal."""
        out = console()
        out.print(f"[bold]{escape(self.title)}[/]", soft_wrap=True)
        for configuration in dict.fromkeys(row.configuration for row in self.rows):
            if configuration:
                out.print(escape(configuration), soft_wrap=True)
            out.print(_table([row for row in self.rows if row.configuration == configuration]))
        for remark in self.remarks:
            out.print(escape(remark), soft_wrap=True)


def _interval(judged: Judged) -> str:
    """The confidence interval of the ratio."""
    if not math.isfinite(judged.high):
        return "(too few replicates)"
    return f"{judged.low:.3f} to {judged.high:.3f}"


def _table(rows: Sequence[Row]) -> Table:
    table = Table()
    table.add_column("row", overflow="fold")
    for name in ("old ms", "new ms", "new / old", "99 % interval"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for row in rows:
        verdict = row.judged.verdict
        table.add_row(
            escape(row.name),
            number(row.old_ms, 3),
            number(row.new_ms, 3),
            f"{row.judged.ratio:.3f}",
            _interval(row.judged),
            f"[{_STYLE[verdict]}]{verdict}[/]",
        )
    return table


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
