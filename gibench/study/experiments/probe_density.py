"""Error against probe density (Silvennoinen and Lehtinen 2017, section 5.2, figure 10)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from gibench.report.plots import Axes, Picture, Series, plot
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
from gibench.techniques.registry import find_technique
from gibench.techniques.srp.bake.operator_norm import operator_norm
from gibench.work import Worker

_IMAGE = (480, 270)
_PROBES = (2, 10, 29)  # of figure 10
_NORM_RAYS = 1024  # per receiver; its map needs no more
_NORM_LIMIT = 1.0  # black alone has 1


def _counts(context: Context) -> tuple[int, ...]:
    return _PROBES[:2] if context.quick else _PROBES


def _label(probes: int) -> str:
    return f"{probes} probes"


def _job(context: Context, probes: int) -> Job:
    scene = context.scene_or("cornell-box")[0]
    receivers = 500 if context.quick else 8000
    return context.srp(scene, context.profiles[0], probes=probes, receivers=receivers)


def _points(context: Context) -> Iterator[Point]:
    for probes in _counts(context):
        yield Point({"probes": probes}, _job(context, probes))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job, shared, probes = unit.point.job, context.site.standing(), unit.point.key["probes"]
    found = compared(context, job, worker, _IMAGE, _label(probes))
    scene = shared.scene(job.scene)
    lightmap, bake = shared.baked(
        find_technique(job.technique), job.settings, job.scene, job.receivers or scene.receivers
    )
    norms = operator_norm(
        scene,
        lightmap,
        bake.probes,
        replace(job.settings.bake_settings(), transport_rays=_NORM_RAYS),
        directions=64 if context.quick else 1024,
        seed=context.site.seed,
    )
    mean = float((norms * lightmap.receivers.area).sum() / lightmap.receivers.area.sum())
    arrays = {**found.arrays, f"norm {probes}": np.repeat(norms[:, None], 3, axis=1)}
    return Found([{**row, "operator_norm": mean} for row in found.rows], arrays=arrays)


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    whole = ok[ok["region"] == "whole"].sort_values("probes")
    counts = whole["probes"].tolist()
    plot(
        kept.path / "probe-density",
        [
            Axes(
                "error against the reference",
                "probes",
                "relative L2 error, %",
                [Series("", counts, (100 * whole["rel_l2"]).tolist())],
            ),
            Axes(
                "mean operator norm (eq. 12)",
                "probes",
                "share of the ideal's norm",
                [Series("", counts, whole["operator_norm"].tolist())],
            ),
        ],
        "Cornell Box, order 7.",
    )
    group = truth_of(context, _job(context, _PROBES[0]), _IMAGE)
    limits = (0.0, _NORM_LIMIT)
    maps: list[Picture | None] = [None]
    for probes in counts:
        norms = kept.array(f"norm {probes}")
        if norms is not None and len(norms) == len(group.truth.value):
            image = group.truth.view.of(norms)[..., 0]
            maps.append(Picture(f"{_label(probes)}: operator norm", image, "viridis", limits))
    shown = result_panel(
        kept, "probe-density-pictures", group.truth, [_label(n) for n in counts], [maps]
    )
    return "\n\n".join(
        (
            "*operator_norm*: the norm of the round trip's error over all lightings of a receiver, "
            "as a share of the norm of irradiance itself, mean over the surface.",
            markdown(whole[["probes", "operator_norm", *SHOWN]], FORMATS),
            "![errors](probe-density.png)",
            shown,
            "The paper shows pictures and prints no figures for this.",
        )
    )


EXPERIMENT = Experiment(
    name="probe-density",
    title="Error against probe density, with the operator norm",
    source="section 5.2 and figure 10 of Silvennoinen and Lehtinen 2017",
    profiles=("iphone7",),
    keys=("probes",),
    columns=("operator_norm", *COLUMNS),
    points=_points,
    measure=_measure,
    present=_present,
    timed=False,
    truth=trace_truth,
)
