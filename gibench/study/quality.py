"""``gibench quality``: techniques against the path-traced truth, on the same receivers."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any

from gibench.arrays import Doubles
from gibench.errors import BadInput, CannotRun, GibenchError
from gibench.measure.machine.environment import without_paths
from gibench.measure.plan.view import choose_camera
from gibench.measure.runfolder.axes import Axis, axis_values
from gibench.measure.runfolder.results import FAILED, OK, SKIPPED
from gibench.reference.metrics import Measure
from gibench.reference.path_tracer import check_paths, reference_irradiance
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.study.errors import METRICS, Truth, errors, errors_among
from gibench.study.frozen import FrozenShared
from gibench.study.hidden import open_receivers
from gibench.study.receivers_file import read_reference
from gibench.study.regions import WHOLE, Mask, read_regions
from gibench.study.settle import Settled, SettleOptions, refuse_motion, settle
from gibench.study.site import Site
from gibench.study.through_camera import view
from gibench.techniques.job import Job
from gibench.techniques.registry import declared_counts
from gibench.work import Executor, Serial, Worker, run_in_order

DEFAULT_TARGET_ERROR = 0.02
"""Mean standard error over mean irradiance; the bias over many receivers is known far better."""


def columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """The columns of ``quality.csv``, with one for each of ``axes``."""
    return (
        *("technique", "scene", "settings", "bias", "rel_mse", "lab_l_mse", "flip", "time_ms"),
        *("memory_bytes", "rel_l2", "ssim", "region"),
        *(f"{name}_noise" for name in METRICS),
        *("result", "variant", "profile", "workgroup_size"),
        *(axis.column for axis in axes),
        *declared_counts(),
        *("receivers", "camera", "light_frame", "bounces", "reference_paths", "reference_error"),
        *("frames", "settled", "change", "memory_budget_bytes", "status", "reason"),
        *("uncovered", "bias_covered", "bias_covered_noise"),
        *("hidden", "bias_open", "bias_open_noise", "rel_l2_open", "rel_l2_open_noise"),
        *("rest", "frames_to_rest", "ms_to_rest"),
    )


@dataclass(frozen=True)
class QualityOptions:
    """How techniques are compared with the truth.

    Attributes:
        settle: when a technique counts as settled.
        light_frame: the lights stand still where they are in this frame.
        bounces: of the reference; None for any number.
        target_error: of the reference, mean standard error over mean irradiance.
        regions: as typed (see :func:`gibench.study.regions.read_regions`).
        reference: ``receivers.npz`` whose reference is taken instead of path tracing.
        reference_seed: of the path tracer.
        reference_paths: per receiver at most; None for as many as the target error takes.
        flip: whether FLIP is wanted, which takes longer than all other metrics together.
    """

    settle: SettleOptions = field(default_factory=SettleOptions)
    light_frame: int = 0
    bounces: int | None = None
    target_error: float = DEFAULT_TARGET_ERROR
    regions: tuple[str, ...] = ()
    reference: Path | None = None
    reference_seed: int = 1
    reference_paths: int | None = None
    flip: bool = True


@dataclass(eq=False)
class Group:
    """Configurations on the same receivers: one ``receivers.npz``.

    Attributes:
        name: scene and receivers, for a folder.
        scene: with standing lights.
        lightmap: the receivers.
        truth: the reference.
        regions: masks by name.
        open: (n,) receivers that are wholly outside of geometry (:mod:`gibench.study.hidden`).
        about: what the reference is of.
        results: (n, 3) irradiance by name.
    """

    name: str
    scene: Scene
    lightmap: Lightmap = field(repr=False)
    truth: Truth = field(repr=False)
    regions: dict[str, Mask] = field(repr=False)
    open: Mask = field(repr=False)
    about: dict[str, Any]
    results: dict[str, Doubles] = field(default_factory=dict, repr=False)


@dataclass
class QualityOutcome:
    """What came out.

    Attributes:
        rows: of :func:`columns`; one per configuration and region.
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
        CannotRun: objects move.
    """
    check_target_error(options.target_error)
    check_paths(options.reference_paths, "--reference-paths")
    for job in jobs:
        refuse_motion(job.shot)
        scene = site.standing(options.light_frame).scene(job.scene)
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
        run_in_order(executor or one_by_one, _compared, _Study(options, site, axes), units, told)
    except KeyboardInterrupt:
        outcome.interrupted = True
    return outcome


def _compared(study: _Study, unit: _Unit, worker: Worker) -> _Compared:
    """Settle one job and hold it against the truth."""
    options, site, job = study.options, study.site, unit.job
    group = group_of(job, options, site)
    shared = site.standing(options.light_frame)
    among = f"{unit.number} of {unit.of}"
    try:
        settled = settle(job, options.settle, shared, site.cl_device, worker, among)
    except GibenchError as error:
        row = _refused(job, group, options, unit.result, error)
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


def _new_group(job: Job, options: QualityOptions, shared: FrozenShared) -> Group:
    scene, shot = shared.scene(job.scene), job.shot
    camera = choose_camera(scene, shot.camera)
    receivers = job.receivers or scene.receivers
    lightmap = shared.lightmap(job.scene, receivers)
    about = {
        "scene": scene.content_hash(),
        "scene_name": scene.name,
        "light": hashlib.sha256(repr(scene.lights).encode()).hexdigest(),
        "light_frame": options.light_frame,
        "bounces": options.bounces,
    }
    if options.reference is not None:
        stored = read_reference(options.reference, lightmap, about)
        value, stderr, paths = stored.value, stored.stderr, stored.paths
    else:
        found = reference_irradiance(
            scene,
            lightmap,
            bounces=options.bounces,
            target_error=options.target_error,
            paths=options.reference_paths,
            seed=options.reference_seed,
            store_dir=shared.cache_dir,
        )
        value, stderr, paths = found.value, found.stderr, found.paths
    seen = view(scene, lightmap, camera, shot.width, shot.height)
    truth = Truth.of(value, stderr, lightmap.receivers.area, seen)
    masks = read_regions(scene, camera, options.regions, shot.width, shot.height)
    about |= {"paths": paths, "camera": camera.name}
    outside = open_receivers(scene, lightmap)
    return Group(f"{scene.name}-{receivers}", scene, lightmap, truth, masks, outside, about)


def rows_of(
    settled: Settled, group: Group, options: QualityOptions, name: str
) -> list[dict[str, Any]]:
    """One row of :func:`columns` per region."""
    found = errors(group.truth, settled.irradiance, group.regions, with_flip=options.flip)
    common = _keys(settled.job, group, options, name) | {
        "time_ms": settled.times.median_ms,
        "memory_bytes": settled.memory_bytes,
        **{name: settled.counts.get(name) for name in declared_counts()},
        "frames": settled.frames,
        "settled": settled.settled,
        "change": settled.change,
        "status": OK,
        "reason": "; ".join(filter(None, (_unsettled(settled), settled.unrested))),
        "rest": settled.rest,
        "frames_to_rest": settled.frames_to_rest,
        "ms_to_rest": settled.ms_to_rest,
    }
    rows = [
        {**common, "region": region, **_figures(measures)} for region, measures in found.items()
    ]
    rows[0] |= _cover(settled, group) | _among_open(settled, group)
    return rows


def settings_in_words(settings: Any) -> str:
    """The settings that differ from the defaults, ``name=value`` joined by commas."""
    changed = [
        f"{item.name}={getattr(settings, item.name)}"
        for item in fields(settings)
        if getattr(settings, item.name) != item.default
    ]
    return ", ".join(changed) or "default"


def result_names(jobs: Sequence[Job]) -> list[str]:
    """A name for the result of each of ``jobs``.

    The technique's own where it is the only one on its receivers, with more in words otherwise;
    two never share one.
    """
    names: list[str] = []
    for mine in jobs:
        others = [
            c
            for c in jobs
            if c.technique == mine.technique
            and (c.scene, c.receivers) == (mine.scene, mine.receivers)
        ]
        parts = [mine.technique]
        for differs in (
            lambda c: settings_in_words(c.settings),
            lambda c: c.variant,
            lambda c: c.profile.name,
            lambda c: f"work-group {c.group_size}",
        ):
            if len({differs(other) for other in others}) > 1:
                parts.append(differs(mine))
        names.append(", ".join(parts))
    return names


def _figures(measures: dict[str, Measure]) -> dict[str, float]:
    values = {name: measures[name].value for name in METRICS}
    return values | {f"{name}_noise": measures[name].noise for name in METRICS}


def _cover(settled: Settled, group: Group) -> dict[str, float]:
    """How many receivers the technique says nothing of, and the bias over the others."""
    measure = errors_among(group.truth, settled.irradiance, settled.covered)["bias"]
    return {
        "uncovered": int((~settled.covered).sum()),
        "bias_covered": measure.value,
        "bias_covered_noise": measure.noise,
    }


def _among_open(settled: Settled, group: Group) -> dict[str, float]:
    """How many receivers lie in part inside of geometry, and the errors over the others."""
    found = errors_among(group.truth, settled.irradiance, group.open)
    named = {f"{name}_open": found[name] for name in ("bias", "rel_l2")}
    return {
        "hidden": int((~group.open).sum()),
        **{name: measure.value for name, measure in named.items()},
        **{f"{name}_noise": measure.noise for name, measure in named.items()},
    }


def _keys(
    job: Job,
    group: Group,
    options: QualityOptions,
    name: str,
) -> dict[str, Any]:
    return {
        "technique": job.technique,
        "scene": group.scene.name,
        "settings": settings_in_words(job.settings),
        "result": name,
        "variant": job.variant,
        "profile": job.profile.name,
        "workgroup_size": job.group_size,
        "receivers": len(group.lightmap.receivers),
        "camera": group.about["camera"],
        "light_frame": options.light_frame,
        "bounces": options.bounces,
        "reference_paths": group.about["paths"],
        "reference_error": group.truth.relative_error,
        "memory_budget_bytes": job.profile.memory_budget_bytes,
    }


def _refused(
    job: Job,
    group: Group,
    options: QualityOptions,
    name: str,
    error: GibenchError,
) -> dict[str, Any]:
    status = SKIPPED if isinstance(error, CannotRun) else FAILED
    keys = _keys(job, group, options, name)
    return {**keys, "region": WHOLE, "status": status, "reason": without_paths(str(error))}


def _unsettled(settled: Settled) -> str:
    if settled.settled:
        return ""
    return (
        f"not settled after {settled.frames} frames: the mean irradiance still moved by "
        f"{100 * settled.change:+.2g} % while they doubled"
    )
