"""What ``gibench advise`` says: a table, a plot and the settings that fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from rich.markup import escape
from rich.table import Table

from gibench.report.plots import Axes, Series, plot, technique_colors
from gibench.report.quality import NOT_THEIRS, error_text
from gibench.report.terminal import console

_HEAD = ("technique", "settings", "receivers", "ms", "MiB", "rel. L2", "bias", "fits", "Pareto")


def advice_report(
    table: pd.DataFrame,
    profile: str,
    budget_ms: float,
    machine: str,
    warnings: Sequence[str] = (),
) -> str:
    """``advice.md``, with the ``warnings`` of the scene's loading."""
    lines = [
        "# gibench advise",
        "",
        f"Budget: {budget_ms:g} ms per frame, memory and work-group sizes of profile {profile}. "
        "Errors are at each setting's own receivers: what fewer receivers lose of detail is not "
        "in them. "
        f"**Measured on** {machine}. {NOT_THEIRS}",
        "",
        "| " + " | ".join(_HEAD) + " | note |",
        "|" + " --- |" * (len(_HEAD) + 1),
    ]
    for _, row in table.iterrows():
        note = str(row["reason"] or "").replace("|", "\\|")
        lines.append("| " + " | ".join([*_cells(row), note]) + " |")
    lines += [f"\n> {warning}" for warning in warnings]
    return "\n".join(lines) + "\n"


def show_advice(table: pd.DataFrame, profile: str, budget_ms: float, machine: str) -> None:
    """The same on the terminal, and the best that fits in a sentence."""
    out = console()
    shown = Table(*_HEAD)
    for _, row in table.iterrows():
        shown.add_row(*(escape(cell) for cell in _cells(row)))
    out.print(shown)
    if table["fits"].any():
        best = table[table["fits"]].iloc[0]
        out.print(
            f"[bold]{best['technique']}[/] with {escape(str(best['settings']))}, "
            f"{best['receivers']:,} receivers, has the least error within {budget_ms:g} ms: "
            f"{best['time_ms']:.1f} ms, {best['memory_bytes'] / 2**20:,.1f} MiB, relative L2 error "
            f"{100 * best['rel_l2']:.1f} %",
            soft_wrap=True,
        )
    out.print(
        f"times measured on {escape(machine)} under the limits of profile {escape(profile)}; none "
        "is a time of the modelled device",
        soft_wrap=True,
    )


def plot_advice(path: Path, table: pd.DataFrame, budget_ms: float, machine: str) -> None:
    """Error over time and over memory, the Pareto front labelled.

    Raises:
        GibenchError: the disk refuses.
    """
    ran = table[table["status"] == "ok"]
    front = ran[ran["pareto"]]
    colors = technique_colors(ran["technique"])

    def axes(column: str, scale: float, title: str, unit: str) -> Axes:
        series = [
            Series(
                str(name),
                (group.sort_values(column)[column] / scale).tolist(),
                (100 * group.sort_values(column)["rel_l2"]).tolist(),
                points=True,
                color=colors[str(name)],
            )
            for name, group in ran.groupby("technique", sort=False)
        ]
        marks = [
            (row[column] / scale, 100 * row["rel_l2"], f"{row['technique']}: {row['settings']}")
            for _, row in front.iterrows()
        ]
        return Axes(title, unit, "relative L2 error, %", series, marks=marks, log_x=True)

    plot(
        path,
        [
            axes("time_ms", 1.0, f"time (budget {budget_ms:g} ms)", "median frame, ms"),
            axes("memory_bytes", 2**20, "memory", "device memory, MiB"),
        ],
        f"Labelled: the Pareto front of time, memory and error. Times of {machine}, not of the "
        "modelled device.",
    )


def _cells(row: pd.Series) -> list[str]:
    def figure(name: str, scale: float = 1.0) -> str:
        return "" if pd.isna(row[name]) else f"{row[name] / scale:,.1f}"

    return [
        str(row["technique"]),
        str(row["settings"]),
        f"{int(row['receivers']):,}",
        figure("time_ms"),
        figure("memory_bytes", 2**20),
        error_text(row, "rel_l2"),
        error_text(row, "bias"),
        "yes" if row["fits"] else "",
        "yes" if row["pareto"] else "",
    ]
