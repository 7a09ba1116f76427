"""SRP's interpolation against plain blending (Silvennoinen and Lehtinen 2017, figure 8)."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import (
    COLUMNS,
    FORMATS,
    SHOWN,
    compared,
    result_panel,
    trace_truth,
    truth_of,
)
from gibench.techniques.job import Job
from gibench.work import Worker

_IMAGE = (480, 270)
_PROBES = (5, 109)  # of figure 8
_KINDS = ("spatial", "visibility", "srp")


def _job(context: Context, probes: int, kind: str) -> Job:
    scene = context.scene_or("cornell-box")[0]
    receivers = 1500 if context.quick else 10_000
    return context.srp(
        scene, context.profiles[0], probes=probes, receivers=receivers, interpolation=kind
    )


def _label(probes: int, kind: str) -> str:
    return f"{kind}, {probes} probes"


def _counts(context: Context) -> tuple[int, ...]:
    return _PROBES[:1] if context.quick else _PROBES


def _points(context: Context) -> Iterator[Point]:
    for probes in _counts(context):
        for kind in _KINDS:
            job = _job(context, probes, kind)
            yield Point({"probes": probes, "interpolation": kind}, job)


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    point = unit.point
    label = _label(point.key["probes"], point.key["interpolation"])
    return compared(context, point.job, worker, _IMAGE, label)


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    whole = ok[ok["region"] == "whole"]
    group = truth_of(context, _job(context, _PROBES[0], "srp"), _IMAGE)
    parts = [
        "*spatial*: probes blended by distance alone, in the receiver's own direction (Bennett "
        "2019, eq. 4.3). *visibility*: that, from the probes the receiver sees. *srp*: reprojected "
        "and mutually visible (eq. 4.6). Everything else is the same: probes, their harmonics, "
        "rays, compression.",
        markdown(whole[["probes", "interpolation", *SHOWN]], FORMATS),
    ]
    for probes in _counts(context):
        labels = [_label(probes, kind) for kind in _KINDS]
        parts.append(result_panel(kept, f"interpolation-{probes}", group.truth, labels))
    parts.append("The paper shows pictures and prints no figures for this.")
    return "\n\n".join(parts)


EXPERIMENT = Experiment(
    name="interpolation",
    title="SRP's interpolation against plain blending on the same probes",
    source="figure 8 of Silvennoinen and Lehtinen 2017",
    profiles=("iphone7",),
    keys=("probes", "interpolation"),
    columns=COLUMNS,
    points=_points,
    measure=_measure,
    present=_present,
    timed=False,
    truth=trace_truth,
)
