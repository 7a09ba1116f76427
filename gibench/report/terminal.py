"""The tables of a run on the terminal."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gibench.measure.runfolder.axes import recorded_axes, recorded_counts
from gibench.report.figures import number, percent
from gibench.report.tables import frame_budget_ms
from gibench.report.which_one import PROJECTED_GI, Answer, shown
from gibench.techniques.registry import axis_title

_WIDE = 150  # columns where the output is no terminal, so that nothing is cut


def console() -> Console:
    """Standard output; plain and wide where it is no terminal. rich honours NO_COLOR. A kernel
    called ``x`` in ``a.cl:x:`` is no emoji.
    """
    width = None if sys.stdout.isatty() else max(_WIDE, shutil.get_terminal_size().columns)
    return Console(width=width, highlight=False, emoji=False)


def show_run(passes: pd.DataFrame, frames: pd.DataFrame, record: Mapping[str, Any]) -> None:
    """One table of passes per configuration, with a line on its frame."""
    out = console()
    for _, frame in frames.iterrows():
        mine = passes[passes["configuration"] == frame["configuration"]]
        out.print(f"[bold]{escape(heading(frame, record))}[/]", soft_wrap=True)
        out.print(_passes(mine))
        out.print(_frame_line(frame, record["environment"]["cpu"]), soft_wrap=True)
        if told := rest_line(frame):
            out.print(told, soft_wrap=True)
        if told := worst_line(frame, frame_budget_ms(record)):
            out.print(told, soft_wrap=True)
        if frame["reason"]:
            out.print(
                f"[yellow]{frame['status']}[/]: {escape(str(frame['reason']))}", soft_wrap=True
            )
        out.print()


def show_answers(found: Sequence[Answer]) -> None:
    """Which technique fits, for each scene and profile: a table and a sentence."""
    out = console()
    for one in found:
        table = Table(
            title=escape(f"Which one: {one.scene}, profile {one.profile}"), title_justify="left"
        )
        titles, rows = shown(one)
        for title in titles:
            words = title in ("technique", "error", PROJECTED_GI, "remark")
            table.add_column(title, justify="left" if words else "right", overflow="fold")
        for row in rows:
            table.add_row(*map(escape, row))
        out.print(table)
        out.print(escape(one.sentence), soft_wrap=True)
        if one.projected:
            out.print(escape(one.projected), soft_wrap=True)


def heading(frame: pd.Series, record: Mapping[str, Any]) -> str:
    """A configuration of the run ``record`` in words."""
    layout = "" if pd.isna(frame["layout"]) else f", {frame['layout']}"
    parts = [f"{frame['technique']} ({frame['variant']}{layout}) on {frame['scene']}"]
    parts += [
        f"{axis_title(name)} {frame[name]}"
        for name in recorded_axes(record)
        if not pd.isna(frame[name])
    ]
    parts += [
        f"{frame[name]:,} {name}"
        for name in (*recorded_counts(record), "receivers")
        if not pd.isna(frame[name])
    ]
    parts.append(f"work-group {frame['workgroup_size']}")
    return ", ".join(parts)


def rest_line(frame: pd.Series) -> str:
    """What filling took, in words; empty where nothing had to be filled or it never ended."""
    frames = frame.get("frames_to_rest")
    if frames is None or pd.isna(frames) or not frames:
        return ""
    return f"at rest after {frames:,} frames, {frame['ms_to_rest']:,.0f} ms"


def worst_line(frame: pd.Series, budget_ms: float) -> str:
    """The worst frames, in words; empty where they were not judged."""
    if pd.isna(frame.get("pace")):
        return ""
    alone = frame.get("machine_stutter")
    machine = "" if pd.isna(alone) else f"; the machine alone {number(alone, 1)} times"
    return (
        f"worst: {100 * frame['within_budget']:.1f} % of frames within {budget_ms:g} ms "
        f"({frame['budget']}), longest {frame['longest_ms']:.1f} ms, {frame['stutter']:.1f} times "
        f"its neighbour at most ({frame['pace']}{machine})"
    )


def _passes(passes: pd.DataFrame) -> Table:
    table = Table()
    table.add_column("pass", no_wrap=True)
    for name in ("median ms", "p95 ms", "GB/s", "GFLOP/s", "Mrays/s", "of roof"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("status", no_wrap=True)
    for _, row in passes.iterrows():
        table.add_row(
            escape(str(row["pass"])),
            number(row["median_ms"], 3),
            number(row["p95_ms"], 3),
            number(row["gb_per_s"]),
            number(row["gflop_per_s"]),
            number(row["mrays_per_s"]),
            percent(row["roofline_fraction"]),
            escape(str(row["status"])),
        )
    return table


def _frame_line(frame: pd.Series, cpu: str) -> str:
    where = f"measured on {escape(cpu)} under the limits of profile {escape(frame['profile'])}"
    memory = f"{frame['memory_bytes'] / 2**20:,.1f} of {frame['memory_budget_bytes'] / 2**20:,.0f}"
    if pd.isna(frame["median_ms"]):
        return f"frame: no time; {where}"
    return (
        f"frame: [bold]{frame['median_ms']:.2f} ms[/] median ({frame['fps']:.1f} frames/s), p99 "
        f"{frame['p99_ms']:.2f} ms, {frame['device_ms']:.2f} ms of it in kernels, over "
        f"{frame['frames']} frames; {memory} MiB; {where}"
    )
