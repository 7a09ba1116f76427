"""Faults to read: a table, and a small profile of each result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gibench.measure.statistics.faults import FAULTS, Fault
from gibench.report.plots import new_figure, save, technique_colors

_SHORT = {
    "leak": "leak",
    "flicker_p50": "flicker p50",
    "flicker_p99": "flicker p99",
    "lag_light_half": "light half",
    "lag_light_95": "light 95 %",
    "lag_object_half": "object half",
    "lag_object_95": "object 95 %",
    "blotches": "blotches",
    "missing": "missing",
}
CANNOT_TELL = "cannot tell"
_LEAST = 0.01
"""Of a threshold: where a profile's bars begin."""
_MOST = 100.0
_MEANING = (
    "*leak*: light where the truth is dark, of the truth's mean; blank where nothing is dark. "
    "*flicker*: standard deviation over frames of a settled receiver, of its mean. *light*, "
    "*object*: frames until half and 95 % of a light that is switched, or of what a moved object "
    "changes, are there. *blotches*: low-frequency error on flat surfaces. *missing*: receivers "
    "that nothing is said of. In bold what is over its threshold; blank what was not looked for or "
    "does not apply."
)


def fault_text(value: Any, fault: Fault) -> str:
    """A figure to read: blank where there is none."""
    if value is None or pd.isna(value):
        return ""
    if fault.unit == "frames":
        return "never" if np.isinf(value) else f"{value:.0f}"
    return f"{100 * value:.2f} %"


def cell(row: Mapping[str, Any] | pd.Series, fault: Fault) -> str:
    """A result's figure to read; ``CANNOT_TELL`` where it was looked for in vain."""
    return fault_text(row.get(fault.name), fault) or (CANNOT_TELL if _reason(row, fault) else "")


def _reason(row: Mapping[str, Any] | pd.Series, fault: Fault) -> str:
    """Why a result has no figure though it was looked for; empty where it has, or it was not."""
    told = row.get("lag_light_reason") if fault.name.startswith("lag_light") else None
    missing = row.get(fault.name) is None or pd.isna(row.get(fault.name))
    return str(told) if missing and isinstance(told, str) else ""


def not_told(row: Mapping[str, Any] | pd.Series) -> list[str]:
    """Lines on the figures of a result that were looked for in vain."""
    reasons = dict.fromkeys(filter(None, (_reason(row, fault) for fault in FAULTS)))
    return [f"{row['result']}: how long light takes cannot be told: {one}." for one in reasons]


def is_fault(value: Any, fault: Fault) -> bool:
    """Whether a figure is over its threshold."""
    return value is not None and not pd.isna(value) and bool(value > fault.threshold)


def profiled(table: pd.DataFrame) -> list[pd.Series]:
    """The rows of ``quality.csv`` that have any figure of a fault: one a result."""
    known = [fault.name for fault in FAULTS if fault.name in table.columns]
    rows = table.dropna(subset=known, how="all") if known else table.iloc[:0]
    return [row for _, row in rows.iterrows()]


def told(group: pd.DataFrame) -> list[str]:
    """Lines of ``quality.md``: the faults of a scene's results. Empty where none was looked for."""
    rows = profiled(group)
    if not rows:
        return []
    untold = [line for row in rows for line in not_told(row)]
    lines = ["", "### Faults", "", *_markdown(rows), ""]
    lines += [*untold, ""] if untold else []
    lines += [_MEANING, "", "![faults](faults.png)"]
    dark = rows[0]["dark_area"]
    if not pd.isna(dark) and not dark:
        lines[3:3] = ["Nothing in this scene is dark, so that there is nowhere to leak to.", ""]
    return lines


def _markdown(rows: Sequence[pd.Series]) -> list[str]:
    head = ["result", *_SHORT.values()]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        cells = [str(row["result"]).replace("|", "\\|")]
        for fault in FAULTS:
            text = cell(row, fault)
            cells.append(f"**{text}**" if is_fault(row[fault.name], fault) else text)
        lines.append("| " + " | ".join(cells) + " |")
    limits = [f"{_limit(fault)}" for fault in FAULTS]
    return [*lines, "| *fault from* | " + " | ".join(limits) + " |"]


def _limit(fault: Fault) -> str:
    if fault.unit == "frames":
        return f"over {fault.threshold:.0f}"
    return f"over {100 * fault.threshold:g} %"


def show_faults(out: Console, group: pd.DataFrame) -> None:
    """The same on the terminal."""
    rows = profiled(group)
    if not rows:
        return
    table = Table("result")
    for title in _SHORT.values():
        table.add_column(title, justify="right", no_wrap=True)
    for row in rows:
        cells = [escape(str(row["result"]))]
        for fault in FAULTS:
            text = cell(row, fault)
            cells.append(f"[bold red]{text}[/]" if is_fault(row[fault.name], fault) else text)
        table.add_row(*cells)
    out.print(table)
    for line in (line for row in rows for line in not_told(row)):
        out.print(escape(line), soft_wrap=True)


def profile_of(row: Mapping[str, Any] | pd.Series) -> list[dict[str, Any]]:
    """What a page draws of a result: for each fault its title, what it reads, whether it is one,
    and how long its bar is, from 0 (a hundredth of the threshold, or less) over a half (the
    threshold) to 1 (a hundred times it, or more). Faults without a figure are left out, but for
    those that were looked for in vain.
    """
    found = []
    for fault in FAULTS:
        value, text, reason = row.get(fault.name), cell(row, fault), _reason(row, fault)
        if not text:
            continue
        found.append(
            {
                "name": _SHORT[fault.name],
                "meaning": f"{fault.meaning}; {reason}" if reason else fault.meaning,
                "text": text,
                "limit": _limit(fault),
                "bad": is_fault(value, fault),
                "length": 0.0 if value is None or reason else bar_length(float(value), fault),
            }
        )
    return found


def bar_length(value: float, fault: Fault) -> float:
    """See :func:`profile_of`; where nothing at all is allowed, a thousandth stands for the
    threshold.
    """
    allowed = fault.threshold or 1e-3
    ratio = min(max(value / allowed, _LEAST), _MOST)
    return float(np.log(ratio / _LEAST) / np.log(_MOST / _LEAST))


def plot_faults(path: Path, table: pd.DataFrame) -> None:
    """A profile of each result, as ``path``.png and .svg: a bar for each fault, of its threshold.

    Raises:
        GibenchError: the disk refuses.
    """
    rows = profiled(table)
    several = len({(row["scene"], row["receivers"]) for row in rows}) > 1
    columns = min(3, len(rows))
    figure = new_figure(4.4 * columns, 2.3 * -(-len(rows) // columns) + 0.3)
    colors = technique_colors(str(row["technique"]) for row in rows)
    for number, row in enumerate(rows, 1):
        where = figure.add_subplot(-(-len(rows) // columns), columns, number)
        title = f"{row['result']}, {row['scene']}" if several else str(row["result"])
        where.set_title(title, fontsize=8)
        at = [n for n, fault in enumerate(FAULTS) if not pd.isna(row[fault.name])]
        shown = [FAULTS[place] for place in at]
        lengths = [bar_length(float(row[fault.name]), fault) for fault in shown]
        faulty = [is_fault(row[fault.name], fault) for fault in shown]
        mine = colors[str(row["technique"])]
        where.barh(at, lengths, color=[mine if bad else "#c9ccd1" for bad in faulty])
        where.set_yticks(range(len(FAULTS)), list(_SHORT.values()), fontsize=7)
        where.set_ylim(len(FAULTS) - 0.5, -0.5)
        for place, fault in enumerate(FAULTS):
            where.text(1.02, place, cell(row, fault), fontsize=7, va="center")
        where.axvline(0.5, color="black", linewidth=0.8)
        where.set_xlim(0, 1.25)
        where.set_xticks([0, 0.5, 1], ["1/100", "threshold", "x 100"], fontsize=6)
        where.spines[["top", "right"]].set_visible(False)
    caption = "Each fault's figure over its threshold, on a logarithmic scale; coloured: over it."
    figure.supxlabel(caption, fontsize=7, color="dimgrey")
    save(figure, path)
