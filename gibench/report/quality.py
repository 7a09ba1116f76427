"""The tables of ``gibench quality`` to read, in Markdown and on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from rich.markup import escape
from rich.table import Table

from gibench.report.faults import show_faults, told
from gibench.report.tables import whole_numbers
from gibench.report.terminal import console

_TITLES = {
    "bias": "bias",
    "rel_l2": "rel. L2",
    "rel_mse": "rel. MSE",
    "lab_l_mse": "MSE of L*",
    "flip": "FLIP",
    "ssim": "SSIM",
}
_AS_PERCENT = ("bias", "rel_l2", "bias_covered", "bias_open", "rel_l2_open")
NOT_THEIRS = (
    "Times are of the machine they were measured on, under the limits of the profile; none is a "
    "time of the modelled device."
)


def quality_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> pd.DataFrame:
    """``quality.csv``: one row per configuration and region."""
    table = pd.DataFrame([{name: row.get(name) for name in columns} for row in rows])
    table = table.reindex(columns=list(columns))
    whole_numbers(table, rows)
    for name in (
        "memory_bytes",
        "workgroup_size",
        "receivers",
        "bounces",
        "reference_paths",
        "frames",
        "memory_budget_bytes",
        "uncovered",
        "hidden",
        "frames_to_rest",
    ):
        table[name] = table[name].astype("Int64")
    return table


def error_text(row: Mapping[str, Any] | pd.Series, metric: str) -> str:
    """An error to read: ``none`` where it could be the reference's own noise."""
    value, noise = row[metric], row[f"{metric}_noise"]
    if pd.isna(value):
        return ""
    perfect = 1.0 if metric == "ssim" else 0.0
    if abs(value - perfect) <= noise:
        return "none"
    return f"{100 * value:.2f} %" if metric in _AS_PERCENT else f"{value:.4g}"


def cover_text(row: Mapping[str, Any] | pd.Series) -> str:
    """What a technique has nothing to say of, in words; empty where there is no such receiver."""
    if pd.isna(row["uncovered"]) or not row["uncovered"]:
        return ""
    count = f"{row['uncovered']:,} of {row['receivers']:,} receivers uncovered and counted as black"
    bias = error_text(row, "bias_covered")
    return f"{count}; bias over the others: {bias}" if bias else count


def open_text(row: Mapping[str, Any] | pd.Series) -> str:
    """The errors without receivers that lie in part inside of geometry; empty where none do."""
    if pd.isna(row["hidden"]) or not row["hidden"]:
        return ""
    return (
        f"{row['hidden']:,} of {row['receivers']:,} receivers lie in part inside of geometry or "
        f"see backs; over the others: bias {error_text(row, 'bias_open')}, rel. L2 "
        f"{error_text(row, 'rel_l2_open')}"
    )


def quality_report(
    table: pd.DataFrame, machine: str, warnings: Mapping[str, Sequence[str]] | None = None
) -> str:
    """``quality.md``.

    Args:
        table: see :func:`quality_table`.
        machine: in words, what the times were measured on.
        warnings: of each scene's loading, by its name.
    """
    head = ["result", "region", *_TITLES.values(), "ms", "MiB", "frames", "note"]
    lines = ["# gibench quality", "", f"**Measured on** {machine}. {NOT_THEIRS}"]
    for (scene, receivers), group in table.groupby(["scene", "receivers"], sort=False):
        first = group.iloc[0]
        bounces = "any number of" if pd.isna(first["bounces"]) else str(first["bounces"])
        lines += [
            "",
            f"## {scene}, {receivers:,} receivers",
            "",
            f"Reference: {first['reference_paths']:,} paths per receiver, {bounces} bounces, mean "
            f"standard error {100 * first['reference_error']:.2g} % of the mean irradiance; lights "
            f"as in frame {first['light_frame']}; camera {first['camera']}. An error that could be "
            "the reference's own noise is called none.",
            "",
            "| " + " | ".join(head) + " |",
            "|" + " --- |" * len(head),
        ]
        lines += ["| " + " | ".join(_cells(row)) + " |" for _, row in group.iterrows()]
        lines += [f"\n> {warning}" for warning in (warnings or {}).get(str(scene), ())]
        lines += told(group)
    lines += ["", *_MEANING]
    return "\n".join(lines) + "\n"


def show_quality(table: pd.DataFrame, machine: str) -> None:
    """The same on the terminal."""
    out = console()
    for (scene, receivers), group in table.groupby(["scene", "receivers"], sort=False):
        first = group.iloc[0]
        out.print(f"[bold]{escape(str(scene))}, {receivers:,} receivers[/]")
        shown = Table("result", "region")
        for title in (*_TITLES.values(), "ms", "MiB", "frames"):
            shown.add_column(title, justify="right", no_wrap=True)
        for _, row in group.iterrows():
            shown.add_row(*(escape(cell) for cell in _cells(row)[:-1]))
        out.print(shown)
        for _, row in group.drop_duplicates("result").iterrows():
            if said := _note(row):
                out.print(f"[yellow]{escape(str(row['result']))}[/]: {escape(said)}")
        show_faults(out, group)
        out.print(
            f"reference: mean standard error {100 * first['reference_error']:.2g} % of the mean; "
            f"none: not more than its noise; times measured on {escape(machine)}",
            soft_wrap=True,
        )


_MEANING = (
    "Bias and relative errors of *whole* are over all receivers by area; in a region, and for L*, "
    "FLIP and SSIM, over the pixels of the camera image, which shows irradiance without albedo "
    "through the lightmap. L* is on its scale of 0 to 100 at the exposure that brings the "
    "reference's 99th percentile to white. Squared errors have the reference's noise taken out.",
)


def _note(row: pd.Series) -> str:
    said = (str(row["reason"] or ""), cover_text(row), open_text(row))
    return "; ".join(part for part in said if part)


def _cells(row: pd.Series) -> list[str]:
    def figure(name: str, digits: int, scale: float = 1.0) -> str:
        return "" if pd.isna(row[name]) else f"{row[name] / scale:,.{digits}f}"

    return [
        str(row["result"]),
        str(row["region"]),
        *(error_text(row, metric) for metric in _TITLES),
        figure("time_ms", 2),
        figure("memory_bytes", 1, 2**20),
        "" if pd.isna(row["frames"]) else str(row["frames"]),
        _note(row).replace("|", "\\|"),
    ]
