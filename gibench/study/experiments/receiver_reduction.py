"""Time and error with fewer receivers (Bennett 2019, section 6.6)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from gibench.measure.plan.view import choose_camera
from gibench.reference import metrics
from gibench.reference.metrics import Measure
from gibench.reference.path_tracer import Reference, reference_image
from gibench.report.images import tone_map
from gibench.report.plots import Axes, Picture, Series, panel, plot
from gibench.study.experiments.common import (
    RESTS,
    TIMES,
    Context,
    Experiment,
    Measuring,
    Point,
    markdown,
    published,
    published_section,
    timed,
)
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import FORMATS
from gibench.study.settle import settle
from gibench.study.through_camera import view
from gibench.techniques.job import Job
from gibench.work import Worker

_TIMED_IMAGE, _IMAGE = (1334, 750), (480, 270)
_RECEIVERS = (437_557, 199_406, 120_479, 56_581)
_ORDER, _PROBES = 2, 169
_ERRORS = ("bias", "rel_l2", "lab_l_mse", "ssim")
_NOISES = tuple(f"{name}_noise" for name in _ERRORS)


def _counts(context: Context) -> tuple[int, ...]:
    return (2000, 1000, 500) if context.quick else _RECEIVERS


def _scene(context: Context) -> str:
    # The built-in atrium stands for Sponza, which does not come with gibench.
    return context.scene_or("cornell-box" if context.quick else "atrium")[0]


def _job(context: Context, receivers: int) -> Job:
    probes = 12 if context.quick else _PROBES
    return context.srp(
        _scene(context), context.profiles[0], sh_order=_ORDER, probes=probes, receivers=receivers
    )


def _truth(context: Context) -> Reference:
    """The camera's image of indirect irradiance: it knows of no receivers, so it suits them all."""
    options, shot, shared = context.quality(), context.shot(_IMAGE), context.site.standing()
    scene = shared.scene(_scene(context))
    return reference_image(
        scene,
        choose_camera(scene, None),
        shot.width,
        shot.height,
        indirect_only=True,
        irradiance=True,
        target_error=options.target_error,
        paths=options.reference_paths,
        store_dir=shared.cache_dir,
        executor=shared.executor,
    )


def _points(context: Context) -> Iterator[Point]:
    for receivers in _counts(context):
        yield Point({"receivers": receivers}, _job(context, receivers))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job, site, shot = unit.point.job, context.site, context.shot(_IMAGE)
    times, standing = timed(context, job, worker, _TIMED_IMAGE), site.standing()
    still = replace(job, shot=shot)
    settled = settle(still, context.quality().settle, standing, site.cl_device, worker)
    scene = standing.scene(job.scene)
    camera = choose_camera(scene, None)
    seen = view(scene, settled.lightmap, camera, shot.width, shot.height)
    image = seen.of(settled.irradiance)
    truth = _truth(context)
    found = _errors(image, truth, seen.seen)
    values = {name: found[name].value for name in _ERRORS}
    noises = dict(zip(_NOISES, (found[name].noise for name in _ERRORS), strict=True))
    count = len(settled.lightmap.receivers)
    rows = [{**times, "receivers_made": count, **values, **noises}]
    return Found(rows, arrays={f"image {job.receivers}": image})


def _errors(image: Any, truth: Reference, seen: Any) -> dict[str, Measure]:
    exposure = metrics.default_exposure(truth.value[seen])
    x, y, s = image[seen], truth.value[seen], truth.stderr[seen]
    whole = np.where(seen[..., None], truth.value, 0.0)
    error = np.where(seen[..., None], truth.stderr, 0.0)
    return {
        "bias": metrics.bias(x, y, s),
        "rel_l2": metrics.relative_l2(x, y, s),
        "lab_l_mse": metrics.lab_l_mse(x, y, s, exposure=exposure),
        "ssim": metrics.ssim(image, whole, error, seen, exposure=exposure),
    }


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"].sort_values("receivers")
    counts = ok["receivers"].tolist()
    plot(
        kept.path / "receiver-reduction",
        [
            Axes(
                "time",
                "receivers",
                "median frame, ms",
                [Series("", counts, ok["time_ms"].tolist())],
            ),
            Axes(
                "error against the path-traced image",
                "receivers",
                "relative L2 error, %",
                [Series("", counts, (100 * ok["rel_l2"]).tolist())],
            ),
        ],
        "Times of this machine under the profile's limits, not of the device it models.",
    )
    truth = _truth(context)
    exposure = metrics.default_exposure(truth.value)
    row = [Picture("path-traced", tone_map(truth.value, exposure))]
    for receivers in counts[::-1]:
        image = kept.array(f"image {receivers}")
        if image is not None and image.shape == truth.value.shape:
            row.append(Picture(f"{receivers:,} receivers", tone_map(image, exposure)))
    panel(kept.path / "receiver-reduction-pictures", [row], "Indirect irradiance.")
    theirs = published("frame_times")
    theirs = theirs[(theirs["where"] == "section 6.6") & (theirs["pass"] == "frame")]
    return "\n\n".join(
        (
            f"Order {_ORDER}, {_PROBES} probes. Errors are of the camera's image of indirect "
            "irradiance against a path-traced one that knows of no receivers, so that lost detail "
            "counts.",
            markdown(ok[["receivers", "receivers_made", *TIMES, *_ERRORS]], FORMATS),
            "![time and error](receiver-reduction.png)",
            "![pictures](receiver-reduction-pictures.png)",
            published_section(theirs.drop(columns=["technique", "pass"])),
        )
    )


EXPERIMENT = Experiment(
    name="receiver-reduction",
    title="Time and error with fewer receivers",
    source="section 6.6 of Bennett 2019",
    profiles=("iphone7",),
    keys=("receivers",),
    columns=(*TIMES, "receivers_made", *_ERRORS, *_NOISES, *RESTS),
    points=_points,
    measure=_measure,
    present=_present,
    truth=lambda context, job: _truth(context).key,
)
