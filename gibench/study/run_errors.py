"""Errors of a run's techniques against a quick path-traced truth, under standing lights.

As ``gibench quality`` finds them, but quicker: the truth is known to 5 % at some thousand of the
receivers, and a technique has some seconds to settle. ``quality`` is for figures to publish.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.errors import GibenchError
from gibench.reference import metrics
from gibench.reference.path_tracer import reference_irradiance
from gibench.scene.lightmap import Lightmap, some_receivers
from gibench.study.settle import Settled, SettleOptions, settle
from gibench.study.site import Site
from gibench.techniques.job import Job
from gibench.techniques.registry import Wakes, find_technique
from gibench.work import Worker

QUICK_ERROR = 0.05
"""Mean standard error of the truth over its mean. What noise adds to an error is taken off it."""
RECEIVERS = 4096
"""Drawn from all, each as likely as any: 1 of 64 of an error's own size is left to chance."""
SETTLE = SettleOptions(frames=512, seconds=45.0)
SMALL_IMAGE = (160, 90)
"""Pixels: for a technique whose light the camera has no part in."""


def run_errors(jobs: Sequence[tuple[int, Job]], site: Site, worker: Worker) -> list[dict[str, Any]]:
    """A row each of :data:`gibench.report.which_one.ERROR_COLUMNS`.

    Args:
        jobs: with the number of their configuration; nothing moves in their shots but lights, which
            stand still here.
        site: where they run.
        worker: who runs them.

    Raises:
        GibenchError: the truth cannot be computed.
    """
    return list(_rows(jobs, site, worker))


def _rows(jobs: Sequence[tuple[int, Job]], site: Site, worker: Worker) -> Iterator[dict[str, Any]]:
    shared = site.standing()
    for number, (configuration, job) in enumerate(jobs, 1):
        among = f"{number} of {len(jobs)}"
        try:
            settled = settle(_quick(job), SETTLE, shared, site.cl_device, worker, among)
        except GibenchError as error:
            yield {"configuration": configuration, "unsettled": f"not compared: {error}"}
            continue
        chosen, truth, stderr = site.kept(
            ("quick truth", job.scene, job.receivers),
            partial(_quick_truth, job, settled.lightmap, site),
        )
        yield {"configuration": configuration, **_errors(settled, chosen, truth, stderr)}


def _quick(job: Job) -> Job:
    """``job``, with a small image where that changes no light."""
    if Wakes.CAMERA in find_technique(job.technique).woken_by:
        return job
    width, height = SMALL_IMAGE
    return replace(job, shot=replace(job.shot, width=width, height=height))


def _errors(
    settled: Settled, chosen: npt.NDArray[np.intp], truth: Doubles, stderr: Doubles
) -> dict[str, Any]:
    result, area = settled.irradiance[chosen], settled.lightmap.receivers.area[chosen]
    off = metrics.relative_l2(result, truth, stderr, area)
    bias = metrics.bias(result, truth, stderr, area)
    still = settled.settled and not settled.unrested
    return {
        "rel_l2": off.value,
        "rel_l2_noise": off.noise,
        "bias": bias.value,
        "bias_noise": bias.noise,
        "uncovered": float((~settled.covered).mean()),
        "unsettled": "" if still else f"not settled after {settled.frames} frames",
    }


def _quick_truth(
    job: Job, lightmap: Lightmap, site: Site
) -> tuple[npt.NDArray[np.intp], Doubles, Doubles]:
    """The receivers chosen, their irradiance (n, 3) and its standard error, W/m2."""
    shared = site.standing()
    count = len(lightmap.receivers)
    rng = np.random.default_rng(job.seed)
    chosen = np.sort(rng.choice(count, min(count, RECEIVERS), replace=False))
    found = reference_irradiance(
        shared.scene(job.scene),
        some_receivers(lightmap, chosen),
        target_error=QUICK_ERROR,
        seed=1,
        store_dir=shared.cache_dir,
        executor=site.executor,
    )
    return chosen, found.value, found.stderr


def measurable(jobs: Sequence[tuple[int, Job]]) -> list[tuple[int, Job]]:
    """Those of ``jobs`` that have one truth: no object moves, and the camera rests."""
    return [
        (number, job)
        for number, job in jobs
        if not job.shot.motion.moves and not job.shot.flight.frames
    ]
