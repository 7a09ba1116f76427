"""``gibench report``: runs as one self-contained HTML page. No network, no libraries.

The page is a template (``page.html`` beside this file, with its style and script) and the runs'
data as JSON in it; the script draws tables, bars, distributions and the roofline as inline SVG.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd

from gibench.measure.compare.timings import configuration_label
from gibench.report.faults import profile_of, profiled
from gibench.report.loaded import LoadedQuality, LoadedRun, answers_of
from gibench.report.markdown import report as markdown_report
from gibench.report.plots import pass_colors, technique_colors
from gibench.report.projected import WARNING, WHOLE_FRAME, WHOLE_GI, range_text
from gibench.report.tables import run_roofs
from gibench.report.which_one import NUMBERS, Answer, cells, headings

MOST_SAMPLES = 400
"""Times shown per distribution: more are thinned evenly, quantiles kept."""
MOST_IMAGE_BYTES = 24 << 20

_FRAME_COLUMNS = {
    "median_ms": "median ms",
    "p95_ms": "p95 ms",
    "p99_ms": "p99 ms",
    "min_ms": "min ms",
    "device_ms": "in kernels ms",
    "gap_ms": "gap ms",
    "fps": "frames/s",
    "real_time": "real-time",
    "frames": "frames",
    "rest": "rest",
    "frames_to_rest": "frames to rest",
    "ms_to_rest": "ms to rest",
    "within_budget": "within budget",
    "longest_ms": "longest ms",
    "stutter": "stutter",
    "pace": "pace",
    "memory_mib": "memory MiB",
    "memory_budget_mib": "budget MiB",
    "outliers": "outliers",
    "status": "status",
    "reason": "reason",
    "remarks": "remarks",
}
_PASS_COLUMNS = {
    "pass": "pass",
    "median_ms": "median ms",
    "mean_ms": "mean ms",
    "stdev_ms": "stdev ms",
    "p95_ms": "p95 ms",
    "p99_ms": "p99 ms",
    "gb_per_s": "GB/s",
    "gflop_per_s": "GFLOP/s",
    "mrays_per_s": "Mrays/s",
    "roofline_fraction": "of roof",
    "outliers": "outliers",
    "status": "status",
    "reason": "reason",
}


def page(runs: Sequence[LoadedRun], qualities: Sequence[LoadedQuality] = ()) -> str:
    """The page of ``runs``, aligned by configuration, with the errors of ``qualities``."""
    data = _data(runs)
    data["errors"] = [one for found in qualities for one in _errors(found)]
    data["faults"] = [one for found in qualities for one in _faults(found)]
    named = (*data["configurations"], *data["errors"], *data["faults"])
    data["colors"] = technique_colors(one["technique"] for one in named)
    passes = [item["name"] for one in data["configurations"] for item in one["passes"]]
    data["pass_colors"] = pass_colors(passes)
    text = json.dumps(data, ensure_ascii=False, allow_nan=False)
    # '</' inside a script element would end it.
    return _template("page.html").replace("/*DATA*/null", text.replace("</", "<\\/"))


def _template(name: str) -> str:
    folder = files("gibench.report")
    text = folder.joinpath(name).read_text(encoding="utf-8")
    style = folder.joinpath("page.css").read_text(encoding="utf-8")
    script = folder.joinpath("page.js").read_text(encoding="utf-8")
    return text.replace("/*STYLE*/", style).replace("/*SCRIPT*/", script)


def _data(runs: Sequence[LoadedRun]) -> dict[str, Any]:
    names = _names(runs)
    configurations, frames, passes = [], [], []
    for name, run in zip(names, runs, strict=True):
        for entry in run.record["configurations"]:
            label = configuration_label(entry, run.record)
            number = entry["configuration"]
            frame = run.frames[run.frames["configuration"] == number].iloc[0].copy()
            for name_of in ("memory", "memory_budget"):
                frame[f"{name_of}_mib"] = frame[f"{name_of}_bytes"] / 2**20
            mine = run.passes[run.passes["configuration"] == number]
            frames.append([name, label, *(_plain(frame[c]) for c in _FRAME_COLUMNS)])
            passes += [
                [name, label, *(_plain(row[c]) for c in _PASS_COLUMNS)]
                for _, row in mine.iterrows()
            ]
            kind = {"technique": entry["technique"], "variant": entry["variant"]}
            configurations.append(_configuration(name, label, run, number, frame, mine) | kind)
    budget = MOST_IMAGE_BYTES
    images = []
    for name, run in zip(names, runs, strict=True):
        for path in sorted((run.path / "images").glob("*/*.png")):
            content = path.read_bytes()
            budget -= len(content)
            if budget < 0:
                break
            images.append(
                {
                    "title": f"{name}: {path.parent.name}, {path.stem}",
                    "src": "data:image/png;base64," + base64.b64encode(content).decode(),
                }
            )
    return {
        "runs": [_run(name, run) for name, run in zip(names, runs, strict=True)],
        "answers": [
            _answer(name, run, found)
            for name, run in zip(names, runs, strict=True)
            for found in answers_of(run.path, run.record, run.frames)
        ],
        "projected": [
            one for name, run in zip(names, runs, strict=True) for one in _projected(name, run)
        ],
        "projected_warning": WARNING,
        "frames": _table(_FRAME_COLUMNS, frames),
        "passes": _table(_PASS_COLUMNS, passes),
        "configurations": sorted(configurations, key=lambda one: one["label"]),
        "images": images,
        "left_out": budget < 0,
    }


def _answer(name: str, run: LoadedRun, found: Answer) -> dict[str, Any]:
    """Which one, of a scene and a profile: cells with what they sort by."""
    labels = {
        entry["configuration"]: configuration_label(entry, run.record)
        for entry in run.record["configurations"]
    }
    rows: list[list[Any]] = []
    for _, row in found.table.iterrows():
        first, *rest = cells(row)
        figures, words = rest[: len(NUMBERS)], rest[len(NUMBERS) :]
        shown = [
            {"text": text, "value": _plain(row[column])}
            for text, column in zip(figures, NUMBERS, strict=True)
        ]
        rows.append([name, labels[row["configuration"]], first, *shown, *words])
    return {
        "title": f"{found.scene}, profile {found.profile}",
        "run": name,
        "sentence": found.sentence,
        "projected": found.projected,
        "columns": ["run", "configuration", *headings(found.table)],
        "rows": rows,
    }


def _projected(name: str, run: LoadedRun) -> list[dict[str, Any]]:
    """Projected ranges, device by device: bars of whole frames and GI, and a table of passes."""
    if run.projected is None:
        return []
    labels = {
        entry["configuration"]: configuration_label(entry, run.record)
        for entry in run.record["configurations"]
    }
    found = []
    for device, group in run.projected.groupby("device", sort=False):
        bars, rows = [], []
        for _, row in group.iterrows():
            label, text = labels[row["configuration"]], range_text(row)
            reason = row["projection_reason"]
            words = [row["bound_by"], row["driven_by"], reason]
            shown = {"text": text, "value": _plain(row["projected_low_ms"])}
            rows.append([name, label, row["pass"], shown, row["verdict"], *map(_plain, words)])
            if row["pass"] in (WHOLE_FRAME, WHOLE_GI) and not pd.isna(row["projected_low_ms"]):
                bars.append(
                    {
                        "label": label,
                        "whole": _WHOLE[row["pass"]],
                        "low": _plain(row["projected_low_ms"]),
                        "high": _plain(row["projected_high_ms"]),
                        "text": text,
                        "verdict": row["verdict"],
                    }
                )
        found.append(
            {
                "title": f"On {device}",
                "run": name,
                "bars": bars,
                "columns": list(_PROJECTED_COLUMNS),
                "rows": rows,
            }
        )
    return found


_WHOLE = {WHOLE_FRAME: "frame", WHOLE_GI: "GI"}
_PROJECTED_COLUMNS = (
    *("run", "configuration", "pass", "PROJECTED range", "verdict"),
    *("bound by", "driven by", "reason"),
)


def _table(columns: Mapping[str, str], rows: list[list[Any]]) -> dict[str, Any]:
    """Rows of the same configuration one below the other, whatever run they are of."""
    named = ["run", "configuration", *columns.values()]
    return {"columns": named, "rows": sorted(rows, key=lambda row: row[1])}


def _errors(quality: LoadedQuality) -> list[dict[str, Any]]:
    """The whole scene's errors, for the plot against time; errors of regions stay in the files."""
    rows = quality.table[quality.table["region"] == "whole"]
    return [
        {
            "label": f"{row['technique']} on {row['scene']}",
            "technique": row["technique"],
            "settings": _plain(row["settings"]) or "",
            "error": _plain(row["rel_l2"]),
            "bias": _plain(row["bias"]),
            "time": _plain(row["time_ms"]),
            "memory_mib": _plain(row["memory_bytes"] / 2**20),
        }
        for _, row in rows.iterrows()
        if row["rel_l2"] > 0 and row["time_ms"] > 0
    ]


def _faults(quality: LoadedQuality) -> list[dict[str, Any]]:
    """The faults of each result, as a profile."""
    known = "technique" in quality.table and "result" in quality.table
    return [
        {
            "label": f"{row['result']} on {row['scene']}",
            "technique": row["technique"],
            "bars": profile_of(row),
        }
        for row in (profiled(quality.table) if known else [])
    ]


def _names(runs: Sequence[LoadedRun]) -> list[str]:
    """Each run's folder name; numbered where two are called the same."""
    names = [run.path.resolve().name for run in runs]
    return [
        name if names.count(name) == 1 else f"{name} #{number}"
        for number, name in enumerate(names, 1)
    ]


def _run(name: str, run: LoadedRun) -> dict[str, Any]:
    record, roofs = run.record, run_roofs(run.record)
    environment, device = record["environment"], record["device"]
    profiles = ", ".join(str(one.get("title", one["name"])) for one in record["profiles"])
    head = markdown_report(run.passes, run.frames, record).split("## Frames")[0]
    return {
        "name": name,
        "measured_on": f"{environment['cpu']} by {device['platform']} {device['driver']}",
        "modelled": profiles,
        "when": record.get("started_utc", ""),
        "warnings": [line[2:] for line in head.splitlines() if line.startswith("> ")],
        "roofs": {
            "gb_per_s": roofs.gb_per_s,
            "gflop_per_s": roofs.fma_gflop_per_s,
        },
    }


def _configuration(
    name: str, label: str, run: LoadedRun, number: int, frame: pd.Series, mine: pd.DataFrame
) -> dict[str, Any]:
    samples = run.samples[run.samples["configuration"] == number]
    shown = []
    for _, row in mine.iterrows():
        times = samples[samples["pass"] == row["pass"]]["time_ms"].to_numpy(np.float64)
        if len(times):
            nbytes, flops = float(row["bytes"] or 0), float(row["flops"] or 0)
            shown.append(
                {
                    "name": row["pass"],
                    "median": _plain(row["median_ms"]),
                    "times": _thinned(times),
                    "intensity": flops / nbytes if nbytes and flops else None,
                    "gflop_per_s": _plain(row["gflop_per_s"]),
                }
            )
    walls = samples.groupby("frame")["frame_wall_ms"].first().to_numpy(np.float64)
    return {
        "run": name,
        "label": label,
        "median": _plain(frame["median_ms"]),
        "times": _thinned(walls),
        "passes": shown,
    }


def _thinned(times: Any) -> list[float]:
    ordered = np.sort(times)
    if len(ordered) > MOST_SAMPLES:
        ordered = np.quantile(ordered, np.linspace(0, 1, MOST_SAMPLES))
    return [round(float(value), 5) for value in ordered]


def _plain(value: Any) -> Any:
    if value is None or (not isinstance(value, str) and pd.isna(value)):
        return None
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value
