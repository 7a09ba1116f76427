"""Techniques at settings that cost the same, or that are as far off: what no paper compares.

Each technique's ``SPEC`` declares its knobs. The first is searched for the value that comes to the
target, at every combination of the others; of those that come to it the truest is taken, or the
cheapest where it is the error that is to be the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.errors import CannotRun
from gibench.measure.session.rest import warm_up
from gibench.measure.session.session import Session
from gibench.reference import metrics
from gibench.report.limits import METRICS
from gibench.report.plots import Picture
from gibench.report.which_one import GI_BUDGET_MS
from gibench.study.errors import errors
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import result_panel, trace_truth, truth_of
from gibench.study.kept_light import SettledLight, settled_light, within_limits
from gibench.study.ladder import nearest, off, search
from gibench.study.quality import group_of
from gibench.study.quality_rows import settings_in_words
from gibench.study.regions import WHOLE
from gibench.techniques.job import Job
from gibench.techniques.registry import TechniqueSpec, find_technique, techniques
from gibench.techniques.technique import GI
from gibench.work import Worker

IMAGE = (320, 180)
RECEIVERS = 20_000
ERROR_TARGET = 0.2
MET = 0.10
"""Of the target: what is called the same."""
_QUICK_RUNGS = 2  # measured of a knob where it is to be quick
_QUICK_RECEIVERS = 300
_KEYS = ("scene", "technique", "profile")
_ERRORS = ("rel_l2", "rel_l2_noise", "bias", "flip")
_COLUMNS = ("settings", "target", "gi_ms", *_ERRORS, "memory_bytes", "tried", "met", "label")


@dataclass(frozen=True)
class _Rungs:
    """A technique's first knob, the others held.

    Attributes:
        jobs: from cheap to dear.
        figures: those measured, by rung.
    """

    jobs: Sequence[Job]
    figures: Mapping[int, float]

    def best(self, target: float) -> tuple[Job, float]:
        """The job that comes nearest to ``target``, and its figure."""
        rung = nearest(self.figures, target)
        return self.jobs[rung], self.figures[rung]


def _points(context: Context) -> Iterator[Point]:
    shared = context.site.standing()
    receivers = _QUICK_RECEIVERS if context.quick else RECEIVERS
    for path in context.scene_or("cornell-box"):
        scene = shared.scene(path)
        for profile in context.profiles:
            for spec in techniques().values():
                if not spec.knobs(scene):
                    continue
                own = context.transport if spec.name == "srp" else {}
                job = context.of(spec.name, path, profile, receivers, **own)
                values = (scene.name, spec.name, profile.name)
                yield Point(dict(zip(_KEYS, values, strict=True)), job)


def _time_ms(context: Context, job: Job, worker: Worker) -> float:
    """Median GI ms, at rest or once it has been waited for; inf where it does not fit the profile.

    Raises:
        GibenchError: a pass failed.
    """
    site = context.site
    try:
        with Session.open(job, site.standing(), site.cl_device) as session:
            session.prepare(whole=True)
            session.compile()
            of_gi = [item.name for item in session.prepared if item.stage == GI]
            warmup, count = (1, 3) if context.quick else (5, context.frames)
            with worker.alone():
                rest = warm_up(session, warmup, context.waits)
                times = [session.frame(rest.frames + n).pass_ms for n in range(count)]
        return float(np.median([sum(one[name] for name in of_gi) for one in times]))
    except CannotRun:
        return float("inf")


def _light(context: Context, job: Job, worker: Worker) -> SettledLight:
    """What it settles on, within its profile; settled once for all searches in a cache folder.

    Raises:
        CannotRun: it does not fit the profile.
        GibenchError: a pass failed.
    """
    options = context.quality().settle
    return settled_light(job, options, context.site, worker, within=within_limits(job))[0]


def _error_of(context: Context, job: Job, worker: Worker) -> float:
    """Relative L2 error of the settled light; inf where it does not fit the profile.

    Raises:
        GibenchError: a pass failed.
    """
    truth = group_of(job, context.quality(), context.site).truth
    try:
        light = _light(context, job, worker).irradiance
    except CannotRun:
        return float("inf")
    return metrics.relative_l2(light, truth.value, truth.stderr, truth.area).value


def _ladders(context: Context, job: Job) -> Iterator[Sequence[Job]]:
    """The first knob's jobs, from cheap to dear, at every combination of the others.

    Raises:
        CannotRun: its bake takes minutes and was never begun.
    """
    spec, shared = find_technique(job.technique), context.site.standing()
    scene = shared.scene(job.scene)
    _refuse_long_bake(spec, job, context)
    first, *others = spec.knobs(scene)
    held = list(product(*(knob.rungs for knob in others)))
    for values in held[:1] if context.quick else held:
        own = dict(zip((knob.setting for knob in others), values, strict=True))
        yield [replace(job, settings=replace(job.settings, **own, **{first.setting: value}))
               for value in first.rungs]  # fmt: skip


def _refuse_long_bake(spec: TechniqueSpec, job: Job, context: Context) -> None:
    shared = context.site.standing()
    if not spec.long_bake:
        return
    scene = shared.scene(job.scene)
    lightmap = shared.lightmap(job.scene, job.receivers or scene.receivers)
    if shared.bake_seconds(spec, job.settings, scene, lightmap) == 0:
        raise CannotRun(
            f"the bake of {spec.name} takes minutes",
            mend=f"bake it once: gibench bake --technique {spec.name} --scene {job.scene} "
            f"--receivers {job.receivers}",
        )


def _searched(
    context: Context, unit: Measuring, worker: Worker, target: float, *, by_time: bool
) -> tuple[list[_Rungs], int]:
    """What each ladder's search measured, and how many rungs in all.

    Raises:
        CannotRun: no rung runs.
        GibenchError: a pass failed.
    """
    job = replace(unit.point.job, shot=context.shot(IMAGE))
    found, tried = [], 0
    for jobs in _ladders(context, job):

        def measure(rung: int, jobs: Sequence[Job] = jobs) -> float:
            figure = _time_ms if by_time else _error_of
            return figure(context, jobs[rung], worker)

        most = _QUICK_RUNGS if context.quick else 8
        figures = search(len(jobs), measure, target, rising=by_time, most=most)
        tried += len(figures)
        if np.isfinite(list(figures.values())).any():
            found.append(_Rungs(jobs, figures))
    if not found:
        raise CannotRun(f"{job.technique} fits the profile at no setting")
    return found, tried


def _judged(context: Context, job: Job, worker: Worker) -> tuple[dict[str, Any], Doubles]:
    """Errors, memory and remarks of the settled light, and the light (n, 3)."""
    light = _light(context, job, worker)
    found = errors(group_of(job, context.quality(), context.site).truth, light.irradiance, {})
    of = found[WHOLE]
    row = {name: of[name].value for name in ("rel_l2", "bias", "flip")}
    row["rel_l2_noise"] = of["rel_l2"].noise
    return {**row, "memory_bytes": light.memory_bytes, "reason": light.remark()}, light.irradiance


def _row(context: Context, worker: Worker, job: Job, label: str) -> tuple[dict[str, Any], Doubles]:
    """All figures of the chosen settings, and their irradiance."""
    row, light = _judged(context, job, worker)
    gi = _time_ms(context, job, worker)
    words = settings_in_words(job.settings)
    return {**row, "settings": words, "gi_ms": gi, "label": label}, light


def _equal(context: Context, unit: Measuring, worker: Worker, *, by_time: bool) -> Found:
    """The settings of a technique that come to the target, and of several the best otherwise."""
    target = context.target or (GI_BUDGET_MS if by_time else ERROR_TARGET)
    ladders, tried = _searched(context, unit, worker, target, by_time=by_time)
    best = [rungs.best(target) for rungs in ladders]
    met = [job for job, found in best if off(found, target) <= np.log1p(MET)]
    # Where none comes to it, all are above or below: the nearest is taken.
    jobs = met or [min(best, key=lambda one: off(one[1], target))[0]]
    label = " ".join(str(value) for value in unit.point.key.values())
    judge = _error_of if by_time else _time_ms
    others = {id(job): judge(context, job, worker) for job in jobs} if len(jobs) > 1 else {}
    chosen = min(jobs, key=lambda job: others.get(id(job), 0.0))
    row, light = _row(context, worker, chosen, label)
    # By the figure that is shown: a time is measured again for it.
    comes = off(row["gi_ms" if by_time else "rel_l2"], target) <= np.log1p(MET)
    row |= {"target": target, "tried": tried, "met": bool(comes)}
    return Found([row], arrays={label: light})


def _equal_time(context: Context, unit: Measuring, worker: Worker) -> Found:
    """The truest settings of a technique that take the target's GI ms."""
    return _equal(context, unit, worker, by_time=True)


def _equal_error(context: Context, unit: Measuring, worker: Worker) -> Found:
    """The cheapest settings of a technique that are as far off as the target."""
    return _equal(context, unit, worker, by_time=False)


def _present(context: Context, kept: Kept, table: pd.DataFrame, *, by_time: bool) -> str:
    ok = table[table["status"] == "ok"].copy()
    ok["met"] = ok["met"].astype(str) == "True"  # text, where another row has none
    same, other = ("gi_ms", "rel_l2") if by_time else ("rel_l2", "gi_ms")
    metric = METRICS["gi_ms" if by_time else "error"]
    parts = [_said(by_time)]
    jobs = {tuple(point.key.values()): point.job for point in _points(context)}
    for (scene, profile), group in ok.groupby(["scene", "profile"], sort=False):
        ordered = group.sort_values(["met", other], ascending=[False, True])
        level = metric.told(float(group["target"].iloc[0]))
        parts.append(f"## {scene}, profile {profile}: {level}")
        shown = ordered.assign(
            MiB=ordered["memory_bytes"] / 2**20,
            met=[_comes(row, same) for _, row in ordered.iterrows()],
        )
        columns = [
            *("technique", "settings", "gi_ms", "rel_l2", "bias", "flip", "MiB", "tried", "met"),
        ]
        names = {"gi_ms": "GI ms", "rel_l2": "rel. L2", "flip": "FLIP", "met": "comes to it"}
        formats = {"GI ms": ".2f", "rel. L2": ".1%", "bias": "+.1%", "FLIP": ".3f", "MiB": ".1f"}
        parts.append(markdown(shown[columns].rename(columns=names), formats))
        job = jobs[(scene, ordered["technique"].iloc[0], profile)]
        parts.append(_pictures(context, kept, job, ordered, f"{scene}-{profile}"))
    return "\n\n".join(parts)


def _comes(row: pd.Series, same: str) -> str:
    """Whether a technique comes to the target; if not, on which side its nearest lies."""
    if row["met"]:
        return "yes"
    return "no, more" if row[same] > row["target"] else "no, less"


def _said(by_time: bool) -> str:
    width, height = IMAGE
    searched = (
        "Every technique at settings that take the same GI ms on this machine; of those that do, "
        "the truest."
    )
    if not by_time:
        searched = (
            "Every technique at settings that are as far off the truth (relative L2 of the "
            "settled indirect irradiance); of those that are, the cheapest."
        )
    return (
        f"{searched} The first knob of its `SPEC` is searched at every combination of the others; "
        f"*comes to it* is within {MET:.0%}. *tried* counts what was measured on the way. "
        f"{RECEIVERS:,} receivers, image {width} x {height}, lights standing."
    )


def _pictures(context: Context, kept: Kept, job: Job, ordered: pd.DataFrame, name: str) -> str:
    """Reference and results, their signed differences, and FLIP maps below."""
    truth = truth_of(context, job, IMAGE).truth
    labels = [str(label) for label in ordered["label"]]
    maps: list[Picture | None] = [None]
    for label in labels:
        values = kept.array(label)
        if values is None:
            continue
        try:
            found = metrics.flip_map(truth.view.of(values), truth.seen, truth.view.seen)
        except CannotRun:  # flip-evaluator is not installed
            break
        mean = float(found[truth.view.seen].mean())
        maps.append(Picture(f"{label}: FLIP, mean {mean:.3f}", found, "magma", (0.0, 1.0)))
    return result_panel(kept, name, truth, labels, [maps] if len(maps) > 1 else [])


def _present_time(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    return _present(context, kept, table, by_time=True)


def _present_error(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    return _present(context, kept, table, by_time=False)


EQUAL_TIME = Experiment(
    name="equal-time",
    title="All techniques at the same GI ms: how far off each is",
    source="nobody: a comparison of this suite",
    profiles=("vega56",),
    keys=_KEYS,
    columns=_COLUMNS,
    points=_points,
    measure=_equal_time,
    present=_present_time,
    truth=trace_truth,
    target="GI ms, 3 by default",
)
EQUAL_ERROR = Experiment(
    name="equal-error",
    title="All techniques equally far off: what each costs",
    source="nobody: a comparison of this suite",
    profiles=("vega56",),
    keys=_KEYS,
    columns=_COLUMNS,
    points=_points,
    measure=_equal_error,
    present=_present_error,
    truth=trace_truth,
    target="relative L2 error, 0.2 by default",
)
