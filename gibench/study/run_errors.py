"""Errors of a run's techniques against a quick path-traced truth, under standing lights.

As ``gibench quality`` finds them, but quicker: the truth is known to 5 % at some thousand of the
receivers, and a technique has some seconds to settle. ``quality`` is for figures to publish.
Profiles share what a technique settles on (:mod:`gibench.study.kept_light`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.errors import GibenchError
from gibench.measure.statistics.faults import dark, leak
from gibench.reference import metrics
from gibench.reference.path_tracer import reference_irradiance
from gibench.scene.lightmap import Lightmap, some_receivers
from gibench.study.hidden import open_receivers
from gibench.study.kept_light import settled_light
from gibench.study.settle import SettleOptions
from gibench.study.site import Site
from gibench.techniques.job import Job
from gibench.techniques.registry import Wakes, find_technique
from gibench.work import Worker

QUICK_ERROR = 0.05
"""Mean standard error of the truth over its mean. What noise adds to an error is taken off it."""
RECEIVERS = 4096
"""Drawn from all, each as likely as any: 1 of 64 of an error's own size is left to chance."""
SETTLE = SettleOptions(frames=1024)
SETTLE_SECONDS = 90.0
"""As ``quality`` settles it, but no longer than a first run can bear."""
NO_LIGHT = "not compared: no indirect light in the scene"
SMALL_IMAGE = (160, 90)
"""Pixels: for a technique whose light the camera has no part in."""


@dataclass(frozen=True)
class QuickTruth:
    """The truth at some receivers.

    Attributes:
        chosen: (n,) their numbers among all.
        value: (n, 3) irradiance, W/m2.
        stderr: (n, 3) its standard error.
        area: (n,) m2.
        open: (n,) whether they see the front of surfaces, or the sky, alone: into what lies inside
            of walls no light leaks that anyone sees.
    """

    chosen: npt.NDArray[np.intp]
    value: Doubles
    stderr: Doubles
    area: Doubles
    open: npt.NDArray[np.bool_]


def run_errors(
    jobs: Sequence[tuple[int, Job]], site: Site, worker: Worker, seconds: float = SETTLE_SECONDS
) -> list[dict[str, Any]]:
    """A row each of :data:`gibench.report.which_one.ERROR_COLUMNS`.

    Args:
        jobs: with the number of their configuration; nothing moves in their shots but lights, which
            stand still here.
        site: where they run.
        worker: who runs them.
        seconds: of frames at most that each may take to settle.

    Raises:
        GibenchError: the truth cannot be computed.
    """
    return list(_rows(jobs, site, worker, replace(SETTLE, seconds=seconds)))


def _rows(
    jobs: Sequence[tuple[int, Job]], site: Site, worker: Worker, options: SettleOptions
) -> Iterator[dict[str, Any]]:
    for number, (configuration, job) in enumerate(jobs, 1):
        among = f"{number} of {len(jobs)}"
        try:
            settled, lightmap = settled_light(_quick(job), options, site, worker, among)
        except GibenchError as error:
            yield {"configuration": configuration, "unsettled": f"not compared: {error}"}
            continue
        truth = site.kept(
            ("quick truth", job.scene, job.receivers),
            partial(quick_truth, job, lightmap, site),
        )
        if not truth.value.any():
            yield {"configuration": configuration, "unsettled": NO_LIGHT}
            continue
        still = settled.settled and not settled.unrested
        yield {
            "configuration": configuration,
            **errors_of(settled.irradiance, truth),
            "uncovered": float((~settled.covered).mean()),
            "change": settled.change,
            "unsettled": "" if still else f"not settled after {settled.frames} frames",
        }


def _quick(job: Job) -> Job:
    """``job``, with a small image where that changes no light."""
    if Wakes.CAMERA in find_technique(job.technique).woken_by:
        return job
    width, height = SMALL_IMAGE
    return replace(job, shot=replace(job.shot, width=width, height=height))


def errors_of(irradiance: Doubles, truth: QuickTruth) -> dict[str, float]:
    """Errors of ``irradiance`` (all receivers, 3), W/m2; ``leak`` is nan where nothing is dark."""
    result = irradiance[truth.chosen]
    given = truth.value, truth.stderr, truth.area
    off, bias = metrics.relative_l2(result, *given), metrics.bias(result, *given)
    nowhere = dark(*given, truth.open)
    return {
        "rel_l2": off.value,
        "rel_l2_noise": off.noise,
        "bias": bias.value,
        "bias_noise": bias.noise,
        "leak": leak(result, *given, truth.open),
        "dark_area": float(truth.area[nowhere].sum() / truth.area.sum()),
    }


def quick_truth(job: Job, lightmap: Lightmap, site: Site) -> QuickTruth:
    """The truth at receivers drawn from ``lightmap``, under standing lights.

    Raises:
        GibenchError: it cannot be computed.
    """
    shared = site.standing()
    scene, count = shared.scene(job.scene), len(lightmap.receivers)
    rng = np.random.default_rng(job.seed)
    chosen = np.sort(rng.choice(count, min(count, RECEIVERS), replace=False))
    some = some_receivers(lightmap, chosen)
    found = reference_irradiance(
        scene,
        some,
        target_error=QUICK_ERROR,
        seed=1,
        store_dir=shared.cache_dir,
        executor=site.executor,
    )
    area = some.receivers.area.astype(np.float64)
    return QuickTruth(chosen, found.value, found.stderr, area, open_receivers(scene, some))


def measurable(jobs: Sequence[tuple[int, Job]]) -> list[tuple[int, Job]]:
    """Those of ``jobs`` that have one truth: no object moves, and the camera rests."""
    return [
        (number, job)
        for number, job in jobs
        if not job.shot.motion.moves and not job.shot.flight.frames
    ]
