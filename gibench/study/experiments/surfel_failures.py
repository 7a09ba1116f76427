"""Where surfel caches fail, and an area light (Jendersie et al. 2016, section 5.2 and figure 5)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pandas as pd

from gibench.resources import data
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import (
    FORMATS,
    compared,
    result_panel,
    trace_truth,
    truth_of,
)
from gibench.study.experiments.surfel_caches import ERRORS, IMAGE, TECHNIQUE
from gibench.study.regions import WHOLE
from gibench.techniques.job import Job
from gibench.work import Worker

_SIZE: Final = {"surfels": 16_384, "caches": 5_000}
"""Of the others: enough for rooms of a few metres."""
AREA_LIGHT: Final = {"surfels": 40_000, "caches": 13_785}
"""Figure 5's."""
_CASES: Final[dict[str, tuple[tuple[str, dict[str, Any]], ...]]] = {
    "behind": (("kept", {"leave_out": False}), ("left out", {"leave_out": True})),
    "spot": (("32 links", {"links": 32}), ("254 links", {"links": 254})),
    "corridors": (
        ("32 links, kd-tree", {"links": 32, "hierarchy": "kd-tree"}),
        ("32 links, clustering", {"links": 32}),
        ("254 links, clustering", {"links": 254}),
    ),
    "panels": (
        ("2 bands", {"sh_bands": 2}),
        ("3 bands", {"sh_bands": 3}),
        ("run time", {"projection": "runtime"}),
    ),
    "stars": (
        ("2 bands", {**AREA_LIGHT, "sh_bands": 2}),
        ("3 bands", {**AREA_LIGHT, "sh_bands": 3}),
    ),
}
_SAYS: Final = {
    "behind": "Caches behind geometry: a block sunk into floor and wall. Those inside it see no "
    "light; kept, they darken the floor beside it, left out, their neighbours' mean stands there.",
    "spot": "Discontinuities in linkage: a small spot lights a few surfels of one wall. "
    "Neighbouring caches meet them in other clusters, and the fewer links, the coarser.",
    "corridors": "Bleeding through clusters: the upper corridor is black in truth. What it shows "
    "comes through clusters that hold surfels of both; `dark` is the mean there over the mean of "
    "all.",
    "panels": "An area light of nine coloured panels, its first bounce and its direct light from "
    "the same links.",
    "stars": "An area light with an image, four asterisks and a ring in the ceiling (figure 5).",
}
# What the truth calls black, over its mean.
_BLACK: Final = 1e-6


def _job(context: Context, case: str, settings: dict[str, Any]) -> Job:
    scene = str(data("scenes") / "surfel-caches" / f"{case}.toml")
    receivers = 1000 if context.quick else None
    settings = {**_SIZE, **settings}
    if context.quick:
        few = {"surfels": 512, "caches": 300, "relaxation": 2}
        settings = {**settings, **few, "links": min(64, settings.get("links", 64))}
    return context.of(TECHNIQUE, scene, context.profiles[0], receivers, **settings)


def _points(context: Context) -> Iterator[Point]:
    for case, choices in _CASES.items():
        for label, settings in choices:
            yield Point({"case": case, "setting": label}, _job(context, case, settings))


def _label(case: Any, setting: Any) -> str:
    return f"{case}, {setting}"


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    key, job = unit.point.key, unit.point.job
    label = _label(key["case"], key["setting"])
    found = compared(context, job, worker, IMAGE, label)
    (whole,) = [row for row in found.rows if row["region"] == WHOLE]
    truth = truth_of(context, job, IMAGE).truth
    value, weight = truth.value.mean(axis=1), np.asarray(truth.area, np.float64)
    own = found.arrays[label].mean(axis=1)
    black = value < _BLACK * np.average(value, weights=weight)
    dark = np.nan
    if black.any():
        dark = np.average(own[black], weights=weight[black]) / np.average(own, weights=weight)
    row = {name: whole[name] for name in (*ERRORS, "reason")}
    return Found([{**row, "dark": dark}], arrays=found.arrays)


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    parts = [markdown(ok[["case", "setting", *ERRORS, "dark"]], {**FORMATS, "dark": ".2e"})]
    for case, choices in _CASES.items():
        mine = ok[ok["case"] == case]
        if mine.empty:
            continue
        truth = truth_of(context, _job(context, case, choices[0][1]), IMAGE).truth
        labels = [_label(case, setting) for setting in mine["setting"]]
        parts += [_SAYS[case], result_panel(kept, f"surfel-failures-{case}", truth, labels)]
    return "\n\n".join(parts)


FAILURES = Experiment(
    name="surfel-failures",
    title="Surfel caches: where they fail, and an area light",
    source="section 5.2 and figure 5 of Jendersie et al. 2016",
    profiles=("iphone7",),
    keys=("case", "setting"),
    columns=(*ERRORS, "dark"),
    points=_points,
    measure=_measure,
    present=_present,
    truth=trace_truth,
)
