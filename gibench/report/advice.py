"""What ``gibench advise`` says: a table, a plot and the settings that fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from rich.markup import escape
from rich.table import Table

from gibench.report.limits import (
    ERROR,
    METRICS,
    Limit,
    Metric,
    front_of,
    in_limits,
    lifted_in_words,
)
from gibench.report.plots import Axes, Series, plot, technique_colors
from gibench.report.quality import NOT_THEIRS, error_text
from gibench.report.terminal import console

_HEAD = (
    *(
        "technique",
        "settings",
        "receivers",
        "GI ms",
        "frame ms",
        "MiB",
        "bake s",
        "rel. L2",
        "bias",
    ),
    *("leak", "fits", "Pareto"),
)
_FIRST_PLOTS = 4
"""Axes side by side: more are not read."""


def advice_report(
    table: pd.DataFrame,
    more: pd.DataFrame,
    profile: str,
    limits: Sequence[Limit],
    machine: str,
    warnings: Sequence[str] = (),
) -> str:
    """``advice.md``.

    Args:
        table: what was tried, what fits first.
        more: what would fit if one limit were lifted.
        profile: its name.
        limits: that are to be met.
        machine: in words, what the times were measured on.
        warnings: of the scene's loading.
    """
    front = table[table["pareto"]] if len(table) else table
    named = ", ".join(metric.title for metric in front_of(limits))
    lines = [
        "# gibench advise",
        "",
        f"Budget: {in_limits(limits)}; memory and work-group sizes of profile {profile}. "
        "Errors are at each setting's own receivers: what fewer receivers lose of detail is not "
        "in them. "
        f"**Measured on** {machine}. {NOT_THEIRS}",
        "",
        *_lines(table),
        "",
        "## If one budget were raised",
        "",
        *([f"- {lifted_in_words(row)}" for _, row in more.iterrows()] or [f"{_NOTHING_MORE}."]),
        "",
        "## The front",
        "",
        f"What nothing else beats in all of {named}.",
        "",
        *_lines(front),
        "",
        "![the front](pareto.png)",
    ]
    lines += [f"\n> {warning}" for warning in warnings]
    return "\n".join(lines) + "\n"


_NOTHING_MORE = "No single one would let in anything that is nearer to the truth"


def _lines(table: pd.DataFrame) -> list[str]:
    lines = ["| " + " | ".join(_HEAD) + " | note |", "|" + " --- |" * (len(_HEAD) + 1)]
    for _, row in table.iterrows():
        note = _note(row).replace("|", "\\|")
        lines.append("| " + " | ".join([*_cells(row), note]) + " |")
    return lines


def show_advice(
    table: pd.DataFrame, more: pd.DataFrame, profile: str, limits: Sequence[Limit], machine: str
) -> None:
    """The same on the terminal, and the best that fits in a sentence."""
    out = console()
    shown = Table(*_HEAD, "note")
    for _, row in table.iterrows():
        shown.add_row(*(escape(cell) for cell in (*_cells(row), _note(row))))
    out.print(shown)
    if table["fits"].any():
        best = table[table["fits"]].iloc[0]
        out.print(
            f"[bold]{best['technique']}[/] with {escape(str(best['settings']))}, "
            f"{best['receivers']:,} receivers, has the least error within "
            f"{escape(in_limits(limits))}: {best['time_ms']:.1f} ms, "
            f"{best['memory_bytes'] / 2**20:,.1f} MiB, relative L2 error "
            f"{100 * best['rel_l2']:.1f} %",
            soft_wrap=True,
        )
    told = [lifted_in_words(row) for _, row in more.iterrows()]
    if not told and not table["fits"].any():
        told = [f"{_NOTHING_MORE}."]
    for line in told:
        out.print(escape(line), soft_wrap=True)
    out.print(
        f"times measured on {escape(machine)} under the limits of profile {escape(profile)}; none "
        "is a time of the modelled device",
        soft_wrap=True,
    )


def plot_advice(path: Path, table: pd.DataFrame, limits: Sequence[Limit], machine: str) -> None:
    """Error over all else that the front is of, the front labelled, limits drawn.

    Raises:
        GibenchError: the disk refuses.
    """
    ran = table[table["status"] == "ok"]
    colors = technique_colors(ran["technique"])
    most = {limit.metric.name: limit.most for limit in limits}
    error = METRICS[ERROR]
    level = None
    if error.name in most:
        level = (100 * most[error.name], f"{100 * most[error.name]:g} %")

    def axes(metric: Metric) -> Axes:
        scale = 100.0 if metric.form.endswith("%") else 1.0
        own = ran.assign(x=scale * metric.of(ran), y=100 * error.of(ran)).sort_values("x")
        series = [
            Series(
                str(name),
                group["x"].tolist(),
                group["y"].tolist(),
                points=True,
                color=colors[str(name)],
            )
            for name, group in own.groupby("technique", sort=False)
        ]
        marks = [
            (row["x"], row["y"], f"{row['technique']}: {row['settings']}")
            for _, row in own[own["pareto"]].iterrows()
        ]
        limit = most.get(metric.name)
        return Axes(
            metric.title + ("" if limit is None else f" (at most {scale * limit:g})"),
            f"{metric.title}, %" if scale > 1 else metric.title,
            "relative L2 error, %",
            series,
            marks=marks,
            log_x=bool((own["x"] > 0).all()),
            level=level,
            limit=None if limit is None else scale * limit,
        )

    shown = [metric for metric in front_of(limits) if metric is not error]
    drawn = [axes(metric) for metric in shown if np.isfinite(metric.of(ran)).any()]
    plot(
        path,
        drawn[:_FIRST_PLOTS],
        "Labelled: the front, which nothing beats in all of these and the error. Times of "
        f"{machine}, not of the modelled device.",
    )


def _note(row: pd.Series) -> str:
    """Why it did not run, or ran and is passed over; empty where it competes."""
    return str(row["reason"] or row["passed_over"] or "")


def _cells(row: pd.Series) -> list[str]:
    def figure(name: str, scale: float = 1.0, digits: int = 1) -> str:
        return "" if pd.isna(row[name]) else f"{row[name] / scale:,.{digits}f}"

    return [
        str(row["technique"]),
        str(row["settings"]),
        f"{int(row['receivers']):,}",
        figure("gi_ms", digits=2),
        figure("time_ms"),
        figure("memory_bytes", 2**20),
        figure("bake_seconds", digits=0),
        error_text(row, "rel_l2"),
        error_text(row, "bias"),
        "" if pd.isna(row["leak"]) else f"{100 * row['leak']:.2f} %",
        "yes" if row["fits"] else "",
        "yes" if row["pareto"] else "",
    ]
