"""The tables of a run, made from its stored samples and its record. No input or output here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from gibench.measure.plan.stopping import median_interval
from gibench.measure.runfolder.axes import KEYS, recorded_axes, recorded_counts, steady_counts
from gibench.measure.statistics.diagnostics import health
from gibench.measure.statistics.summary import (
    NAN,
    REAL_TIME_MS,
    Roofs,
    best_of,
    least_ms,
    per_second,
    summarize,
)
from gibench.measure.statistics.worst import worst_frames
from gibench.techniques.registry import declared_counts
from gibench.techniques.technique import CAMERA, GEOMETRY, GI, Work

_WHOLE = (
    *("receivers", "workgroup_size", "configuration", "outliers", "bytes", "flops", "rays"),
    "frames_to_rest",
)
_WORK = ("flops", "bytes_read", "bytes_written", "rays", "atomics")


def pass_columns(record: Mapping[str, Any]) -> tuple[str, ...]:
    """The columns of a run's ``passes.csv``."""
    return (
        *KEYS,
        *recorded_axes(record),
        "pass",
        *steady_counts(record.get("counts", declared_counts())),
        *("receivers", "frames"),
        *("mean_ms", "median_ms", "stdev_ms", "p95_ms", "p99_ms", "min_ms", "max_ms"),
        *("bytes", "flops", "rays", "gb_per_s", "gflop_per_s", "mrays_per_s", "roofline_fraction"),
        *("status", "reason", "configuration", "stage"),
        *("ci_low_ms", "ci_high_ms", "outliers", "remarks"),
    )


def frame_columns(record: Mapping[str, Any]) -> tuple[str, ...]:
    """The columns of a run's ``frames.csv``."""
    return (
        *KEYS,
        *recorded_axes(record),
        *recorded_counts(record),
        *("receivers", "frames", "gi_ms"),
        *("mean_ms", "median_ms", "p95_ms", "p99_ms", "min_ms", "fps", "real_time"),
        *("memory_bytes", "memory_budget_bytes", "status", "reason"),
        *("device_ms", "gap_ms", "warmup", "configuration"),
        *("ci_low_ms", "ci_high_ms", "outliers", "stopped", "remarks"),
        *("rest", "frames_to_rest", "ms_to_rest"),
        *("within_budget", "longest_ms", "stutter", "machine_longest", "machine_stutter"),
        *("budget", "pace"),
    )


def run_roofs(record: Mapping[str, Any]) -> Roofs:
    """The roofs a run's tables are held against: the best of its start and its end."""
    start, end = (roofs_of(record["roofs"][when]) for when in ("start", "end"))
    return best_of(start, end)


def passes_table(samples: pd.DataFrame, record: Mapping[str, Any]) -> pd.DataFrame:
    """One row per pass and configuration (columns: :func:`pass_columns`).

    Args:
        samples: the content of ``samples.csv``.
        record: the content of ``run.json``.
    """
    roofs = run_roofs(record)
    times = {
        key: group["time_ms"].to_numpy(np.float64)
        for key, group in samples.groupby(["configuration", "pass"], sort=False)
    }
    rows = []
    for entry in record["configurations"]:
        for item in entry["passes"]:
            mine = times.get((entry["configuration"], item["pass"]), np.empty(0))
            summary = summarize(mine)
            work = Work(**{name: item[name] for name in _WORK})
            nbytes = work.bytes_read + work.bytes_written
            median = summary.median_ms
            rows.append(
                {
                    **entry,
                    **asdict(summary),
                    **_steadiness(mine),
                    "pass": item["pass"],
                    "stage": item.get("stage", ""),
                    "workgroup_size": item.get("workgroup_size", entry["workgroup_size"]),
                    "frames": summary.count,
                    "bytes": nbytes,
                    "flops": work.flops,
                    "rays": work.rays,
                    "gb_per_s": per_second(nbytes, median, 1e9),
                    "gflop_per_s": per_second(work.flops, median, 1e9),
                    "mrays_per_s": per_second(work.rays, median, 1e6),
                    "roofline_fraction": least_ms(work, roofs) / median if median > 0 else NAN,
                    "status": item["status"],
                    "reason": item["reason"],
                }
            )
    return _frame(rows, pass_columns(record))


def frames_table(samples: pd.DataFrame, record: Mapping[str, Any]) -> pd.DataFrame:
    """One row per configuration (columns: :func:`frame_columns`).

    A frame's time is the host's: from before its uploads until the queue is empty again.
    ``device_ms`` is the median of what its kernels take together, ``gap_ms`` the median of the
    rest. ``gi_ms`` is the median of what the passes of stage ``gi`` take together: what the
    technique costs. It is blank in runs from before passes had stages. ``rest`` says whether the
    technique was at rest when it was timed, ``frames_to_rest`` and ``ms_to_rest`` what filling took
    until then; blank where it does not tell, and in runs from before it did. Where a pass could not
    run there is no whole frame, so the times are blank. ``within_budget`` is the share of frames of
    at most :func:`frame_budget_ms`, ``stutter`` the largest ratio of neighbours; ``budget`` and
    ``pace``
    judge them where the machine was timed beside them (:mod:`gibench.measure.statistics.worst`).

    Args:
        samples: the content of ``samples.csv``.
        record: the content of ``run.json``.
    """
    frames = samples.groupby(["configuration", "frame"], sort=False).agg(
        wall=("frame_wall_ms", "first"), device=("time_ms", "sum")
    )
    gi_ms = gi_ms_of(samples, record)
    rows = []
    for entry in record["configurations"]:
        times = frames[frames.index.get_level_values(0) == entry["configuration"]]
        row = {**entry, **asdict(summarize([])), "frames": len(times)}
        if len(times) and all(item["status"] == "ok" for item in entry["passes"]):
            walls = times["wall"].to_numpy(np.float64)
            summary = summarize(walls)
            row |= {
                **asdict(summary),
                **_steadiness(walls),
                **_worst(walls, entry, frame_budget_ms(record)),
                "fps": 1e3 / summary.median_ms,
                "real_time": bool(summary.median_ms <= REAL_TIME_MS),
                "gi_ms": gi_ms[entry["configuration"]],
                "device_ms": float(times["device"].median()),
                "gap_ms": float((times["wall"] - times["device"]).median()),
            }
        rows.append(row)
    return _frame(rows, frame_columns(record))


def gi_ms_of(samples: pd.DataFrame, record: Mapping[str, Any]) -> dict[int, float]:
    """By configuration, the median over frames of its passes of stage ``gi`` together."""
    found = {}
    for entry in record["configurations"]:
        number, stages = (
            entry["configuration"],
            {p["pass"]: p.get("stage") for p in entry["passes"]},
        )
        found[number] = NAN
        if not set(stages.values()) <= {CAMERA, GEOMETRY, GI}:
            continue
        mine = samples[samples["configuration"] == number]
        gi = mine["time_ms"].where(mine["pass"].map(stages) == GI, 0.0)
        found[number] = float(gi.groupby(mine["frame"]).sum().median())
    return found


def frame_budget_ms(record: Mapping[str, Any]) -> float:
    """What a frame of a run may take, ms: as it was asked for (``--budget-ms``)."""
    asked = record.get("arguments", {}).get("budgets") or {}
    return float(asked.get("frame_ms", REAL_TIME_MS))


def _worst(
    walls: npt.NDArray[np.float64], entry: Mapping[str, Any], budget_ms: float
) -> dict[str, Any]:
    """The worst frames; judged where constant work was timed beside them, as in flight."""
    own, beside = (entry.get(name) or () for name in ("own_ms", "beside_ms"))
    found = asdict(worst_frames(walls, own, beside, budget_ms))
    return found if beside else {**found, "budget": None, "pace": None}


def _steadiness(times_ms: npt.NDArray[np.float64]) -> dict[str, Any]:
    """How well the median is known (95 %) and what the times suffer from."""
    found = health(times_ms)
    low, high = median_interval(times_ms) if len(times_ms) else (NAN, NAN)
    return {
        "ci_low_ms": low,
        "ci_high_ms": high,
        "outliers": found.outliers,
        "remarks": "; ".join(found.in_words()),
    }


def csv_text(table: pd.DataFrame) -> str:
    """The table as CSV: blank where a figure does not apply, six significant digits."""
    return str(table.to_csv(index=False, float_format="%.6g", lineterminator="\n"))


def whole_numbers(table: pd.DataFrame, rows: Sequence[Mapping[str, Any]]) -> None:
    """Make the columns that hold whole numbers alone, and blanks, whole."""
    for name in table.columns:
        there = [row[name] for row in rows if row.get(name) is not None]
        if there and all(
            isinstance(value, int | np.integer) and not isinstance(value, bool) for value in there
        ):
            table[name] = table[name].astype("Int64")


def _frame(rows: list[dict[str, Any]], columns: tuple[str, ...]) -> pd.DataFrame:
    table = pd.DataFrame([{name: row.get(name) for name in columns} for row in rows])
    table = table.reindex(columns=list(columns))
    whole_numbers(table, rows)
    for name in _WHOLE:
        if name in table:
            table[name] = table[name].astype("Float64").round().astype("Int64")
    return table


def roofs_of(entry: Mapping[str, Any]) -> Roofs:
    """One measurement of the roofs as ``run.json`` has it."""
    return Roofs(**{name: NAN if value is None else value for name, value in entry.items()})
