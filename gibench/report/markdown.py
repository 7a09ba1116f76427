"""``report.md``: a run to read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from gibench.measure.runfolder.axes import recorded_axes, recorded_counts
from gibench.measure.runfolder.results import AT_REST
from gibench.measure.statistics.summary import REAL_TIME_MS, moved
from gibench.measure.statistics.worst import BESIDE_PER_FRAME, CLEAR, HOLDS_SHARE, STUTTER
from gibench.report.figures import number, percent
from gibench.report.images import METHOD
from gibench.report.roofline import drawable
from gibench.report.tables import frame_budget_ms, roofs_of
from gibench.report.terminal import heading
from gibench.report.which_one import Answer, shown
from gibench.techniques.registry import axis_title

_ROOFS = {
    "read_gb_per_s": "streaming read, GB/s",
    "triad_gb_per_s": "STREAM triad, GB/s",
    "fma_gflop_per_s": "multiply-add, GFLOP/s",
    "mrays_per_s": "incoherent rays in a closed box, Mrays/s",
    "launch_us": "one launch, µs of host time",
}


def report(
    passes: pd.DataFrame,
    frames: pd.DataFrame,
    record: Mapping[str, Any],
    found: Sequence[Answer] = (),
) -> str:
    """The report of a run as Markdown.

    Args:
        passes: see :func:`gibench.report.tables.passes_table`.
        frames: see :func:`gibench.report.tables.frames_table`.
        record: the content of ``run.json``.
        found: which technique fits.
    """
    sections = [
        "# gibench run",
        *_warnings(record),
        _measured_on(record),
        *_which_one(found),
        "## Frames",
        _frames(frames, record),
        *_worst_frames(frames, record),
        "## Passes",
        *_passes(passes, frames, record),
        "## The machine's roofs",
        _roofs_section(record, passes),
        *_how(record, passes, frames),
        *_notes(record, frames),
        "## What the figures say, and what they do not",
        _meaning(record),
    ]
    return "\n\n".join(sections) + "\n"


def _which_one(found: Sequence[Answer]) -> list[str]:
    sections = []
    for one in found:
        sections.append(f"## Which one: {one.scene}, profile {one.profile}")
        sections += [_table(*shown(one)), one.sentence]
        if one.projected:
            sections.append(one.projected)
    if found:
        sections.append(
            "Error: relative L2 of the indirect irradiance at the receivers against a path-traced "
            "truth, lights standing as in frame 0. The slowest 1 % of frames take longer than the "
            "worst ms. Leak: light where the truth is dark, of its mean; - where nothing is dark."
        )
    return sections


def _warnings(record: Mapping[str, Any]) -> list[str]:
    start, end = roofs_of(record["roofs"]["start"]), roofs_of(record["roofs"]["end"])
    lines = []
    if changes := moved(start, end):
        told = ", ".join(f"{_ROOFS[name]} by {100 * by:+.0f} %" for name, by in changes.items())
        lines.append(
            f"> **The machine was not steady:** from the start to the end of this run its roofs "
            f"moved: {told}. Compare times across configurations with care."
        )
    if record["interrupted"]:
        lines.append("> **Interrupted:** only what was measured until then is here.")
    return lines


def _measured_on(record: Mapping[str, Any]) -> str:
    environment, device = record["environment"], record["device"]
    profiles = " and ".join(f"{p['title']} (`{p['name']}`)" for p in record["profiles"])
    memory = environment["memory_bytes"] / 2**30
    return (
        f"**Measured on** {environment['cpu']} ({environment['usable_threads']} threads, "
        f"{memory:.0f} GiB, {environment['os']}) by {device['platform']} {device['driver']} on "
        f"`{device['name']}`.\n\n"
        f"**Modelled by its limits, not run:** {profiles}. Work-group sizes, local memory and "
        "buffer memory were held to its limits; every time below is a time of the machine above "
        f"and none of the modelled device.\n\n"
        f"{record['started_utc']} UTC, gibench {record['versions']['gibench']}, "
        f"seed {record['seed']}."
    )


def _frames(frames: pd.DataFrame, record: Mapping[str, Any]) -> str:
    axes, counts = recorded_axes(record), recorded_counts(record)
    rows = [
        (
            row["technique"],
            row["variant"],
            _cell(row["layout"]),
            row["scene"],
            row["profile"],
            row["workgroup_size"],
            *(_cell(row[name]) for name in (*axes, *counts, "receivers")),
            row["frames"],
            _cell(row["frames_to_rest"]),
            number(row["ms_to_rest"], 0),
            number(row["gi_ms"]),
            *(number(row[name]) for name in ("median_ms", "p95_ms", "p99_ms", "min_ms")),
            number(row["device_ms"]),
            number(row["fps"], 1),
            {True: "yes", False: "no"}.get(row["real_time"], ""),
            f"{row['memory_bytes'] / 2**20:,.1f} / {row['memory_budget_bytes'] / 2**20:,.0f}",
            row["status"],
            row["reason"],
        )
        for _, row in frames.iterrows()
    ]
    head = (
        *("technique", "variant", "layout", "scene", "profile", "work-group"),
        *(axis_title(name) for name in (*axes, *counts)),
        *(
            "receivers",
            "frames",
            "frames to rest",
            "ms to rest",
            "GI ms",
            "median ms",
            "p95 ms",
            "p99 ms",
            "min ms",
            "in kernels ms",
        ),
        *("frames/s", "real-time", "memory MiB / budget", "status", "reason"),
    )
    return _table(head, rows)


def _worst_frames(frames: pd.DataFrame, record: Mapping[str, Any]) -> list[str]:
    """The worst frames where they differ, in flight or among objects that move; nothing else."""
    judged = frames[frames["pace"].notna()]
    if judged.empty:
        return []
    head = (
        *("configuration", f"within {frame_budget_ms(record):g} ms", "p99 ms", "longest ms"),
        "stutter",
        *("machine: longest", "machine: stutter", "budget", "pace"),
    )
    rows = [
        (
            f"{heading(row, record)}, profile {row['profile']}",
            f"{100 * row['within_budget']:.1f} %",
            *(number(row[name]) for name in ("p99_ms", "longest_ms", "stutter")),
            *(number(row[name]) for name in ("machine_longest", "machine_stutter")),
            *(row["budget"], row["pace"]),
        )
        for _, row in judged.iterrows()
    ]
    told = (
        "*Stutter* is the largest ratio of neighbouring frames. *Machine* is the same of constant "
        f"work timed between frames, a frame's length of it ({BESIDE_PER_FRAME} pieces): its "
        "longest over its median, its largest ratio of neighbours. A budget *holds* where "
        f"{100 * HOLDS_SHARE:.0f} % of the frames keep it; a pace is *steady* where no frame takes "
        f"{STUTTER:.0f} times as long as its neighbour. What is bad is told only where frames kept "
        f"the device busy so long themselves, and {CLEAR:.0f} times what the machine alone did; "
        "otherwise this run *cannot tell*."
    )
    return ["## Worst frames", _table(head, rows), told]


def _passes(passes: pd.DataFrame, frames: pd.DataFrame, record: Mapping[str, Any]) -> list[str]:
    head = (
        *(
            "pass",
            "stage",
            "median ms",
            "mean ms",
            "stdev ms",
            "p95 ms",
            "p99 ms",
            "min ms",
            "max ms",
        ),
        *("MB", "Mflop", "Mrays", "GB/s", "GFLOP/s", "Mrays/s", "of roof", "status", "reason"),
    )
    sections = []
    for _, frame in frames.iterrows():
        rows = [
            (
                row["pass"],
                row["stage"],
                *(number(row[f"{name}_ms"], 3) for name in ("median", "mean", "stdev")),
                *(number(row[f"{name}_ms"], 3) for name in ("p95", "p99", "min", "max")),
                *(number(row[name] * 1e-6, 3) for name in ("bytes", "flops", "rays")),
                *(number(row[name]) for name in ("gb_per_s", "gflop_per_s", "mrays_per_s")),
                percent(row["roofline_fraction"]),
                row["status"],
                row["reason"],
            )
            for _, row in passes[passes["configuration"] == frame["configuration"]].iterrows()
        ]
        sections += [
            f"### {heading(frame, record)}, profile {frame['profile']}",
            _table(head, rows),
        ]
    return sections


def _roofs_section(record: Mapping[str, Any], passes: pd.DataFrame) -> str:
    start, end = record["roofs"]["start"], record["roofs"]["end"]
    again = record["roofs"].get("measured_again", True)
    rows = [
        (title, number(start[name]), number(end[name]) if again else "not measured again")
        for name, title in _ROOFS.items()
        if start[name] is not None
    ]
    return (
        "Measured in this run, at its start and at its end; *of roof* in the tables is the least "
        "time the better of the two allows for a pass's declared bytes, flops and rays, over its "
        "median time. The ray roof is of incoherent closest hits in a small scene: shadow rays and "
        "rays that run together can pass it, rays in a large scene cannot reach it. Data that stay "
        "in the cache can pass the bandwidth roof.\n\n"
        + _table(("roof", "start", "end"), rows)
        + ("\n\n![roofline](roofline.png)" if drawable(passes).any() else "")
    )


def _how(record: Mapping[str, Any], passes: pd.DataFrame, frames: pd.DataFrame) -> list[str]:
    """How the samples were taken, and what they suffer from."""
    entries = record["configurations"]
    lines = [_turns(entries)]
    for why in dict.fromkeys(entry.get("stopped", "") for entry in entries):
        if why:
            count = sum(entry.get("stopped") == why for entry in entries)
            lines.append(f"{count} of {len(entries)} configurations ended with {why}.")
    for rest in dict.fromkeys(entry.get("rest", "") for entry in entries):
        if rest:
            count = sum(entry.get("rest") == rest for entry in entries)
            lines.append(f"{count} of {len(entries)} configurations: {_rest_told(rest)}.")
    if cold := record.get("cold"):
        covered = "twice" if cold["covered"] else "only in part"
        lines.append(
            f"Caches were emptied before every frame by streaming {cold['streamed_bytes'] >> 20:,} "
            f"MiB; the {cold['cache_bytes'] >> 20:,} MiB last-level cache that the device reports "
            f"are covered {covered}."
        )
    for _, frame in frames.iterrows():
        title = f"{heading(frame, record)}, profile {frame['profile']}"
        mine = passes[passes["configuration"] == frame["configuration"]]
        rows = [("frame", frame), *((row["pass"], row) for _, row in mine.iterrows())]
        for name, row in rows:
            told = [row["remarks"]] if isinstance(row["remarks"], str) and row["remarks"] else []
            if not pd.isna(row["outliers"]) and row["outliers"]:
                told.append(f"{row['outliers']} of {row['frames']} times are outliers (kept)")
            if told:
                lines.append(f"{title}: {name}: {'; '.join(told)}.")
    lines = [line for line in lines if line]
    return ["## How it was measured", "\n".join(f"- {line}" for line in lines)] if lines else []


def _rest_told(rest: str) -> str:
    if rest.startswith("never"):
        return f"{rest}; timed once times had settled"
    return f"{rest} when timed" if rest == AT_REST else rest


def _turns(entries: Sequence[Mapping[str, Any]]) -> str:
    groups: dict[int, list[str]] = {}
    for entry in entries:
        groups.setdefault(entry.get("group", 1), []).append(str(entry["configuration"]))
    together = [numbers for numbers in groups.values() if len(numbers) > 1]
    if not together:
        return ""
    told = "; ".join(" ".join(numbers) for numbers in together)
    text = f"Configurations took turns in blocks of frames, in random order: {told}."
    if len(groups) > 1:
        text += " These groups ran one after the other, for want of memory for all at once."
    return text


def _pictured(record: Mapping[str, Any]) -> str:
    """Of which frame of the scene the images are, in words."""
    shown = {entry.get("pictured") for entry in record["configurations"]} - {None}
    if len(shown) != 1:
        return ""  # where nothing moves, it does not matter
    return f" (all of the scene's frame {shown.pop()})"


def _notes(record: Mapping[str, Any], frames: pd.DataFrame) -> list[str]:
    lines = []
    if record["arguments"]["save_images"]:
        lines.append(f"Images beneath `images/`{_pictured(record)}: {METHOD}.")
    flight = record.get("flight")
    if flight and flight["path"] != "rest":
        lines.append(
            f"The camera flew: {flight['rest_frames']} frames at rest, "
            f"{flight['flight_frames']} along the path '{flight['path']}', then at rest again; the "
            "same frame is the same view for every technique."
        )
    motion = record.get("motion")
    if motion and motion["path"] != "rest":
        told = "the scene says" if motion["path"] == "scene" else f"'{motion['path']}' says"
        lines.append(
            f"Objects moved as {told}; in the same frame they are in the same place for every "
            "technique."
        )
    for scene in record["scenes"]:
        lines.append(
            f"{scene['name']}: {scene['triangles']:,} triangles, content "
            f"{scene['content_hash'][:12]}."
        )
        lines += [f"{scene['name']}: {warning}." for warning in scene["warnings"]]
    for entry, (_, frame) in zip(record["configurations"], frames.iterrows(), strict=True):
        title = f"{heading(frame, record)}, profile {frame['profile']}"
        lines += [f"{title}: {note}." for note in entry["notes"]]
        if entry["reason"] and entry["status"] != "ok":
            lines.append(f"{title}: {entry['status']}: {entry['reason']}.")
    return ["## Notes", "\n".join(f"- {line}" for line in lines)] if lines else []


def _meaning(record: Mapping[str, Any]) -> str:
    width, height = record["image"]["width"], record["image"]["height"]
    points = [
        "A pass's time is the sum of its launches' OpenCL event times. A frame's time is the "
        "host's: from before the uploads of the frame until the queue is empty, launch gaps "
        "included; *in kernels* is what the passes take of it.",
        "*GI* is what the technique costs: a frame's passes of stage `gi` together, the lookup at "
        "the pixels too; without the camera's rays and direct light (`camera`) and without what "
        "puts objects in their place (`geometry`).",
        "*Frames to rest* and *ms to rest* are what a technique takes to become what is timed: "
        "until its surfels, probes or bounces are there (blank where it never rests or does not "
        "tell).",
        f"Real-time means a median of at most {REAL_TIME_MS} ms **on the machine measured**. It "
        "does not say that the modelled device is or is not real-time.",
        "Times of two runs on a shared machine differ by tens of percent; compare inside one run.",
        f"Memory is every buffer of the technique at its peak. The camera image is {width} x "
        f"{height}.",
        "All figures are computed from `samples.csv` and `run.json`.",
    ]
    return "\n".join(f"- {point}" for point in points)


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    def line(cells: Sequence[Any]) -> str:
        return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"

    return "\n".join([line(head), line(["---"] * len(head)), *(line(row) for row in rows)])


def _cell(value: Any) -> str:
    if pd.isna(value):
        return ""
    return f"{value:,}" if isinstance(value, int | np.integer) else str(value)
