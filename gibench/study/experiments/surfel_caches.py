"""The studies of surfel caches (Jendersie et al. 2016, section 5.3): what they share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from statistics import median
from typing import Any, Final

import pandas as pd

from gibench.measure.session.session import Session
from gibench.study.experiments.common import Context, Measuring, published, published_section
from gibench.study.experiments.kept import Found
from gibench.study.experiments.side_by_side import compared
from gibench.study.regions import WHOLE
from gibench.techniques.job import Job
from gibench.work import Worker

TECHNIQUE: Final = "surfel-cache"
HIGH: Final = {"surfels": 131_072, "links": 254, "sh_bands": 4, "caches": 10_585}
"""The settings 1 of table 2."""
MODERATE: Final = {"surfels": 32_768, "links": 128, "sh_bands": 3, "caches": 10_585}
"""The settings 2 of table 2."""
_QUICK: Final = {"surfels": 512, "links": 16, "caches": 300, "relaxation": 2}

RECEIVERS: Final = 20_000
"""Points that it is compared on; no frame of it reads receivers."""

GI_PASSES: Final = ("surfel_lighting", "pull", "cache_lighting", "dilation", "forward_render")
PASS_TIMES: Final = tuple(f"{name}_ms" for name in (*GI_PASSES, "camera"))
ERRORS: Final = ("bias", "rel_l2", "lab_l_mse", "flip")
ERROR_COLUMNS: Final = (*ERRORS, *(f"{name}_noise" for name in ERRORS))
IMAGE: Final = (640, 360)


def surfel_job(context: Context, **settings: Any) -> Job:
    """Surfel caches with these settings on the experiment's scene."""
    # The built-in atrium stands for Sponza, which does not come with gibench.
    scene = context.scene_or("cornell-box" if context.quick else "atrium")[0]
    if not context.quick:
        return context.of(TECHNIQUE, scene, context.profiles[0], RECEIVERS, **settings)
    few = {name: min(settings.get(name, most), most) for name, most in _QUICK.items()}
    return context.of(TECHNIQUE, scene, context.profiles[0], 1500, **{**settings, **few})


def quickly(context: Context, own: Iterable[int], quick: Iterable[int]) -> tuple[int, ...]:
    """An axis' values, or few small ones."""
    return tuple(quick if context.quick else own)


def pass_times(
    context: Context, job: Job, worker: Worker, image: tuple[int, int] | None = None
) -> dict[str, Any]:
    """Median time of every pass, ms, and the memory.

    Raises:
        CannotRun: the profile or budget forbids it.
        GibenchError: a pass failed.
    """
    job = replace(job, shot=context.shot(image or IMAGE))
    with Session.open(job, context.site.moving(), context.site.cl_device) as session:
        session.prepare(whole=True)
        session.compile()
        warmup, count = (1, 3) if context.quick else (5, context.frames)
        with worker.alone():
            frames = [session.frame(number) for number in range(warmup + count)][warmup:]
        times = {n: median(f.pass_ms[n] for f in frames) for n in frames[0].pass_ms}
        both = ("cache_lighting_map", "cache_lighting_grid")
        times["cache_lighting"] = sum(times.pop(name) for name in both)
        counts = session.counts()
        return {
            **{f"{name}_ms": times[name] for name in (*GI_PASSES, "camera")},
            "frames": len(frames),
            "memory_bytes": session.memory_bytes,
            "caches": counts["caches"],
        }


def errors_of(context: Context, unit: Measuring, worker: Worker) -> Mapping[str, Any]:
    """Errors of a point over the whole scene against the path-traced truth, or those taken.

    Raises:
        GibenchError: it cannot run.
    """
    taken = None if context.taken is None else context.taken.of(unit.point.key)
    if taken is not None:
        return taken
    found: Found = compared(context, unit.point.job, worker, IMAGE, unit.name)
    (whole,) = [row for row in found.rows if row["region"] == WHOLE]
    return {name: whole[name] for name in (*ERROR_COLUMNS, "reason")}


def theirs(where: str) -> str:
    """Their own figures of a table or figure."""
    table: pd.DataFrame = published("surfel_caches")
    chosen = table[table["where"] == where].dropna(axis=1, how="all")
    return published_section(chosen)
