"""``gibench history show``: one self-contained page of all series. No network, no libraries."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.history.series import Series
from gibench.history.template import filled
from gibench.measure.statistics.steps import Step


def page(series: Sequence[Series], steps: Sequence[Sequence[Step]], beside: Path) -> str:
    """The page; ``steps`` are those of each series. Links to runs are relative to ``beside``."""
    runs = _runs(series, beside)
    numbers = {run["run"]: number for number, run in enumerate(runs)}
    data = {
        "runs": runs,
        "series": [_series(one, of, numbers) for one, of in zip(series, steps, strict=True)],
    }
    return filled("page", data)


def _runs(series: Sequence[Series], beside: Path) -> list[dict[str, Any]]:
    """All runs once, oldest first, each with what of its environment differs from the one before on
    that machine and runtime.
    """
    if not series:
        return []
    rows = pd.concat(
        [one.runs.assign(machine=one.machine, runtime=one.runtime) for one in series]
    ).drop_duplicates("run")
    rows = rows.sort_values(["started_utc", "run"])
    found: list[dict[str, Any]] = []
    last: dict[tuple[Any, Any], dict[str, str]] = {}
    for row in rows.itertuples():
        environment = _flat(json.loads(str(row.environment)))
        before = last.get((row.machine, row.runtime))
        last[row.machine, row.runtime] = environment
        found.append(
            {
                "run": row.run,
                "when": str(row.started_utc).removesuffix("NaT"),
                "revision": str(row.revision) + (" (changed)" if row.dirty else ""),
                "link": _link(Path(str(row.folder)), beside),
                "changed": [] if before is None else _changes(before, environment),
            }
        )
    return found


def _link(folder: Path, beside: Path) -> str:
    """To the run's report if there is one, else to its folder; empty where neither is there."""
    report = folder / "report.html"
    target = report if report.exists() else folder
    return os.path.relpath(target, beside.resolve()) if target.exists() else ""


def _flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    flat: dict[str, str] = {}
    for key, value in content.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key} ")
        else:
            flat[f"{prefix}{key}"] = str(value)
    return flat


def _changes(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    keys = sorted({*before, *after})
    return [
        f"{key}: {before.get(key, 'none')} to {after.get(key, 'none')}"
        for key in keys
        if before.get(key) != after.get(key)
    ]


def _series(one: Series, steps: Sequence[Step], numbers: Mapping[str, int]) -> dict[str, Any]:
    return {
        "name": one.name,
        "label": one.label,
        "technique": one.technique,
        "pass": one.pass_name,
        "unit": one.unit,
        "machine": f"{one.machine}; {one.runtime}",
        "runs": [numbers[run] for run in one.runs["run"]],
        "values": [float(f"{value:.6g}") for value in one.runs["median"]],
        "steps": [
            {"at": step.at, "ratio": round(step.ratio, 4), "low": round(step.low, 4)}
            | {"high": round(step.high, 4)}
            for step in steps
        ],
    }
