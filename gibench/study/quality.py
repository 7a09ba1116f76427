"""``gibench quality``: techniques against the path-traced truth, on the same receivers."""

from __future__ import annotations

import hashlib
import logging
import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from gibench.arrays import Doubles
from gibench.errors import BadInput, GibenchError
from gibench.measure.plan.view import choose_camera
from gibench.measure.runfolder.axes import Axis, axis_values
from gibench.reference.path_tracer import check_paths, reference_irradiance
from gibench.scene.lightmap import Receivers
from gibench.study.ahead import bake_ahead, site_for
from gibench.study.errors import Truth
from gibench.study.frozen import FrozenShared
from gibench.study.hidden import open_receivers
from gibench.study.quality_rows import Group, QualityOptions, refused, result_names, rows_of
from gibench.study.receivers_file import read_reference
from gibench.study.regions import read_regions
from gibench.study.settle import refuse_motion, settle
from gibench.study.site import Site
from gibench.study.through_camera import view
from gibench.study.watched import Watch, object_lag
from gibench.techniques.job import Job
from gibench.work import Executor, Serial, Worker, elsewhere, run_in_order

_LOG = logging.getLogger(__name__)

_EFFECTIVE, _EVEN = 500.0, 0.2
"""Of so many receivers of one area, or this share of all, a mean over the surface is sure enough:
with errors of half the mean from one to the next, 2 % are one standard deviation."""


@dataclass
class QualityOutcome:
    """What came out.

    Attributes:
        rows: of :func:`gibench.study.quality_rows.columns`; one per configuration and region.
        groups: finished ones.
        first_error: the first thing that went wrong.
        interrupted: whether Ctrl-C ended it early.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    groups: list[Group] = field(default_factory=list)
    first_error: GibenchError | None = None
    interrupted: bool = False


Take = Callable[[Group, str], None]
Keep = Callable[[int, Sequence[dict[str, Any]]], None]


def check_target_error(target: float) -> None:
    """Refuse a target error that is never reached.

    Raises:
        BadInput: it is not a finite number above 0.
    """
    if not (math.isfinite(target) and target > 0):
        raise BadInput(
            f"a target error of {target:g} is never reached",
            where="--target-error",
            mend="give a relative error above 0, for instance 0.02",
        )


def check_views(jobs: Sequence[Job], options: QualityOptions, site: Site) -> None:
    """Refuse what is wrong with scenes, cameras and regions before anything long.

    Raises:
        BadInput: naming it.
        CannotRun: objects move, and are not held.
    """
    check_target_error(options.target_error)
    check_paths(options.reference_paths, "--reference-paths")
    for job in jobs:
        refuse_motion(job.shot)
        scene = site.standing(options.light_frame).scene(job.scene)
        job.shot.motion.of(scene)
        camera = choose_camera(scene, job.shot.camera)
        read_regions(scene, camera, options.regions, job.shot.width, job.shot.height)
    if options.reference is not None and not options.reference.is_file():
        raise BadInput("no such file", where=options.reference)


@dataclass(frozen=True)
class _Unit:
    """A job to compare: plain data.

    Attributes:
        job: the job.
        result: its result's name.
        number: counted from 1.
        of: how many there are.
    """

    job: Job
    result: str
    number: int
    of: int

    @property
    def name(self) -> str:
        """In messages."""
        return self.result

    @property
    def timed(self) -> bool:
        """Its frames are timed."""
        return True


@dataclass(frozen=True)
class _Study:
    """What all jobs of a comparison share: plain data."""

    options: QualityOptions
    site: Site
    axes: Sequence[Axis]


@dataclass(frozen=True)
class _Compared:
    """What became of a job: rows, and its irradiance (n, 3) or why there is none."""

    rows: list[dict[str, Any]]
    irradiance: Doubles | None = None
    error: GibenchError | None = None


def compare(
    jobs: Sequence[Job],
    options: QualityOptions,
    site: Site,
    *,
    axes: Sequence[Axis] = (),
    executor: Executor | None = None,
    take: Take | None = None,
    keep: Keep | None = None,
    done: Container[int] = (),
) -> QualityOutcome:
    """Settle every job and compare it with the reference of its receivers.

    Jobs that share receivers come next to each other, as ``grid`` has them. One that
    cannot run is told in its row, and the others go on.

    Args:
        jobs: to compare.
        options: how.
        site: where techniques run.
        axes: settings with a column of their own.
        executor: computes the jobs, one after another by default; frames, which are timed, run one
            job at a time whatever it is.
        take: called with the group and the result's name whenever a result is there.
        keep: called with a job's number, counted from 1, and its rows as soon as they are there.
        done: numbers of configurations that are left out, as their rows are kept from before.

    Raises:
        BadInput: the scene, camera, a region, the reference's file or its target error is wrong.
    """
    check_views(jobs, options, site)
    names = result_names(jobs)
    outcome = QualityOutcome()

    def told(unit: _Unit, found: _Compared) -> None:
        group = group_of(unit.job, options, site)
        if group not in outcome.groups:
            outcome.groups.append(group)
        outcome.first_error = outcome.first_error or found.error
        outcome.rows += found.rows
        if keep is not None:
            keep(unit.number, found.rows)
        if found.irradiance is not None:
            group.results[unit.result] = found.irradiance
            if take is not None:
                take(group, unit.result)

    units = [
        _Unit(job, name, number, len(jobs))
        for number, (job, name) in enumerate(zip(jobs, names, strict=True), 1)
        if number not in done
    ]
    one_by_one = Serial(says_unit=False)
    try:
        there = site
        if elsewhere(executor):
            mine = [unit.job for unit in units]
            bake_ahead(mine, site)
            truths = {group_of(job, options, site).reference_key for job in mine} - {""}
            there = site_for(executor, mine, site, truths)
        run_in_order(executor or one_by_one, _compared, _Study(options, there, axes), units, told)
    except KeyboardInterrupt:
        outcome.interrupted = True
    return outcome


def _compared(study: _Study, unit: _Unit, worker: Worker) -> _Compared:
    """Settle one job and hold it against the truth."""
    options, site, job = study.options, study.site, unit.job
    group = group_of(job, options, site)
    shared = site.standing(options.light_frame)
    among = f"{unit.number} of {unit.of}"
    watch = Watch.over(shared) if options.watched else None
    seen, then = (watch.shared, watch.observe) if watch else (shared, None)
    try:
        settled = settle(job, options.settle, seen, site.cl_device, worker, among, then)
        if watch and settled.irradiance.any():
            half, nearly = object_lag(job, shared, site.cl_device, worker, settled.frames)
            settled.observed = replace(settled.observed, lag_object_half=half, lag_object_95=nearly)
    except GibenchError as error:
        row = refused(job, group, options, unit.result, error)
        return _Compared([row | axis_values(job, study.axes)], error=error)
    rows = rows_of(settled, group, options, unit.result)
    return _Compared([row | axis_values(job, study.axes) for row in rows], settled.irradiance)


def group_of(job: Job, options: QualityOptions, site: Site) -> Group:
    """The receivers of ``job`` and their reference, path-traced or from a file; the same object for
    the same receivers, as long as the site is kept.

    Raises:
        BadInput: a target error, bounces, region or file that is wrong.
    """
    key = "group", job.scene, job.receivers, job.shot, options
    return site.kept(key, partial(_new_group, job, options, site.standing(options.light_frame)))


def too_few(receivers: Receivers) -> str | None:
    """Why means over these receivers say little of the surface, in a line; None where they do."""
    count, effective = len(receivers), receivers.effective
    if effective >= min(_EFFECTIVE, _EVEN * count):
        return None
    return (
        f"the {count:,} receivers are so few for its many parts that means over the surface rest "
        f"on {effective:,.0f} of them, which stand for whole walls; ask for more (--receivers "
        f"{2 * count:,})"
    )


def _new_group(job: Job, options: QualityOptions, shared: FrozenShared) -> Group:
    scene, shot = shared.scene(job.scene), job.shot
    camera = choose_camera(scene, shot.camera)
    receivers = job.receivers or scene.receivers
    lightmap = shared.lightmap(job.scene, receivers)
    if (few := too_few(lightmap.receivers)) is not None:
        _LOG.warning("%s: %s", scene.name, few)
    if (motion := shot.motion.of(scene)) is not None:
        lightmap = motion.lightmap_in(scene, lightmap, options.light_frame)
        scene = motion.scene_in(scene, options.light_frame)
    about = {
        "scene": scene.content_hash(),
        "scene_name": scene.name,
        "light": hashlib.sha256(repr(scene.lights).encode()).hexdigest(),
        "light_frame": options.light_frame,
        "bounces": options.bounces,
    }
    if options.reference is not None:
        stored = read_reference(options.reference, lightmap, about)
        value, stderr, paths, key = stored.value, stored.stderr, stored.paths, ""
    else:
        found = reference_irradiance(
            scene,
            lightmap,
            bounces=options.bounces,
            target_error=options.target_error,
            paths=options.reference_paths,
            seed=options.reference_seed,
            store_dir=shared.cache_dir,
            executor=shared.executor,
        )
        value, stderr, paths, key = found.value, found.stderr, found.paths, found.key
    seen = view(scene, lightmap, camera, shot.width, shot.height)
    truth = Truth.of(value, stderr, lightmap.receivers.area, seen)
    masks = read_regions(scene, camera, options.regions, shot.width, shot.height)
    about |= {"paths": paths, "camera": camera.name}
    outside = open_receivers(scene, lightmap)
    return Group(
        f"{scene.name}-{receivers}", scene, lightmap, truth, masks, outside, about,
        reference_key=key,
    )  # fmt: skip
