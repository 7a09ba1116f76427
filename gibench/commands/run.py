"""``gibench run``, and :func:`gibench.run`."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.commands.run_files import tables_of, write_tables
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput, GibenchError, Interrupted, printable
from gibench.measure.plan.grid import job_label, with_layouts
from gibench.measure.plan.shard import Shard, labels_of
from gibench.measure.plan.stopping import Patience, Plan
from gibench.measure.run import Measured, verdict
from gibench.measure.run import run as measure
from gibench.measure.runfolder.axes import axes_of
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.runfolder.results import OK, JobResult
from gibench.measure.session.session import check_job
from gibench.measure.session.shared import Shared
from gibench.measure.statistics.summary import REAL_TIME_MS
from gibench.profiles import DeviceProfile
from gibench.report.images import ImageWriter
from gibench.report.loaded import ERRORS, answers_of
from gibench.report.tables import csv_text
from gibench.report.which_one import ERROR_COLUMNS, GI_BUDGET_MS, Answer, Budgets
from gibench.scene.load import names_apart
from gibench.study.run_errors import SETTLE_SECONDS, measurable, run_errors
from gibench.study.site import Site
from gibench.techniques.job import Job
from gibench.techniques.registry import find_technique, techniques
from gibench.techniques.technique import GI
from gibench.trace.extra import require_extra
from gibench.work import Executor, Worker

if TYPE_CHECKING:
    from gibench.commands.project import ProjectedRun

_LOG = logging.getLogger(__name__)


NAMED_SECONDS, FIRST_LOOK_SECONDS = 180.0, 20.0
"""Of warm-up's frames, for techniques that were named and for a run of all."""


@dataclass(frozen=True)
class RunResult:
    """What a run left.

    Attributes:
        folder: with everything that was written.
        record: the content of ``run.json``.
        samples: one row per pass and frame.
        passes: one row per pass and configuration.
        frames: one row per configuration.
        error: what is not fine: some configuration failed, all were refused, or the run was
            interrupted. What was measured is in the tables all the same.
        ran: configurations of which frames were measured.
        projected: ranges on devices that are not here, where they were asked for.
        ratios: of projected times to the cheapest configuration's.
        answers: which technique fits, for each scene and profile.
        left_out: techniques that nobody named and the scene does not suit, with why.
    """

    folder: Path
    record: dict[str, Any]
    samples: pd.DataFrame = field(repr=False)
    passes: pd.DataFrame = field(repr=False)
    frames: pd.DataFrame = field(repr=False)
    error: GibenchError | None
    ran: int
    projected: pd.DataFrame | None = field(default=None, repr=False)
    ratios: pd.DataFrame | None = field(default=None, repr=False)
    answers: list[Answer] = field(default_factory=list, repr=False)
    left_out: tuple[str, ...] = ()


@within_bounds
def run(
    device_profile: asked.Texts = ("iphone7",),
    scene: asked.Texts = ("cornell-box",),
    technique: asked.Texts | None = None,
    variant: asked.Texts = ("tuned",),
    layout: asked.Texts | None = None,
    sh_order: asked.Numbers = None,
    probes: asked.Numbers = None,
    receivers: asked.Numbers = None,
    workgroup_size: asked.Sizes = None,
    settings: asked.SettingsAsked = None,
    frames: int | None = None,
    warmup: int | None = None,
    warmup_frames: int = 1000,
    warmup_seconds: float | None = None,
    cold: bool = False,
    resolution: str | tuple[int, int] = "1334x750",
    camera: str | int | None = None,
    camera_path: str = "rest",
    rest_frames: int = 60,
    flight_frames: int = 240,
    motion: str = "rest",
    fit: bool = False,
    save_images: bool = False,
    project: asked.Texts = (),
    quality: bool = True,
    settle_seconds: float = SETTLE_SECONDS,
    budget_ms: float = REAL_TIME_MS,
    gi_budget_ms: float = GI_BUDGET_MS,
    shard: str | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    device: int | None = None,
    cache_dir: str | Path | None = None,
    executor: Executor | None = None,
) -> RunResult:
    """Run techniques frame by frame, as ``gibench run`` does; its help says what everything is.

    All inputs are checked before any long work. A configuration that cannot run has its reason in
    the tables and the others go on; what the command line would end with is in ``error``.

    ``executor`` computes what is baked (:mod:`gibench.work.executors`); no result depends on it.
    Frames are timed one at a time, configurations in turns, whatever it is.

    Raises:
        BadInput: an input is wrong.
        CannotRun: no work-group size asked suits any profile asked.
        GibenchError: the folder cannot be written.
    """
    given = locals()
    budgets = _budgets(budget_ms, gi_budget_ms)
    if technique is None:
        given["technique"] = tuple(techniques())
    arguments = asked.recorded(
        *(given, "warmup", "warmup_frames", "warmup_seconds", "cold", "fit", "save_images"),
        *("quality", "settle_seconds"),
    )
    arguments["budgets"] = asdict(budgets)
    arguments["motion"] = printable(Path(motion).name)
    projected_on = _projected_on(asked.several(project))
    jobs = asked.jobs_of(given)
    cl_device = select_cl_device(device)
    jobs = with_layouts(jobs, cl_device)
    names = names_apart([job.scene for job in jobs])
    shared = Shared(asked.cache_folder(cache_dir), seed, executor, names)
    jobs, left_out = _suited(jobs, shared, all_techniques=technique is None)
    arguments["technique"] = list(dict.fromkeys(job.technique for job in jobs))
    axes, part, first = axes_of(jobs), Shard.parse(shard), 1
    if part is not None:
        arguments["shard"] = part.record(labels_of(jobs))
        first, jobs = arguments["shard"]["first"], part.share(jobs)
    seconds = _seconds_to_rest(warmup_seconds, named=technique is not None)
    patience = Patience(warmup_frames, seconds)
    flown = jobs[0].shot.flight.frames
    plan = Plan(frames=frames or flown or None, warmup=warmup, patience=patience)
    profiles = list(dict.fromkeys(job.profile.name for job in jobs))
    folder = asked.folder_for(out, "runs", profiles, arguments)
    measured = measure(
        jobs,
        plan,
        shared,
        cl_device,
        folder,
        arguments=arguments,
        fit=fit,
        cold=cold,
        axes=axes,
        first=first,
        take_images=_ImageTaker(ImageWriter(folder.path / "images")) if save_images else None,
        write=write_tables,
    )
    interrupted = False
    results = measured.outcome.results
    compared = measurable([(one.number, one.job) for one in results if _competes(one)])
    if quality and compared and not measured.outcome.ended:
        site = Site(shared.cache_dir, seed, device, executor, names=names)
        interrupted = not _keep_errors(folder, compared, site, settle_seconds)
        write_tables(folder, measured.record)
    result = _result(folder.path, measured, left_out, interrupted)
    if not projected_on or not result.ran or measured.outcome.interrupted:
        return result
    found = _project(folder, measured, projected_on, shared, cl_device)
    told = answers_of(folder.path, measured.record, result.frames)  # now with projected ranges
    return replace(result, projected=found.table, ratios=found.ratios, answers=told)


def _projected_on(names: Sequence[str]) -> list[DeviceProfile]:
    if not names:
        return []
    from gibench.commands.project import machine_profiles

    require_extra()
    return machine_profiles(names)


def _project(
    folder: RunFolder,
    measured: Measured,
    profiles: Sequence[DeviceProfile],
    shared: Shared,
    cl_device: Any,
) -> ProjectedRun:
    """Project what ran, and add it to the folder and its report."""
    from gibench.commands.project import project_jobs

    jobs = {one.number: one.job for one in measured.outcome.results}
    found = project_jobs(jobs, measured.record, profiles, shared, cl_device)
    found.write(folder)
    write_tables(folder, measured.record)
    return found


def _result(
    path: Path, measured: Measured, left_out: Sequence[str], interrupted: bool
) -> RunResult:
    outcome = measured.outcome
    error = verdict(outcome, path)
    if interrupted and error is None:
        error = Interrupted(f"interrupted before errors were known; all times are kept in {path}")
    ran = sum(result.frames > 0 for result in outcome.results)
    samples, passes, frames = tables_of(path, measured.record)
    return RunResult(
        folder=path,
        record=measured.record,
        samples=samples,
        passes=passes,
        frames=frames,
        error=error,
        ran=ran,
        answers=answers_of(path, measured.record, frames),
        left_out=tuple(left_out),
    )


def _seconds_to_rest(asked_for: float | None, *, named: bool) -> float:
    """How long warm-up waits for a technique to rest: at a first look at all of them, not long."""
    if asked_for is not None:
        return asked_for
    return NAMED_SECONDS if named else FIRST_LOOK_SECONDS


def _budgets(frame_ms: float, gi_ms: float) -> Budgets:
    for name, value in (("--budget-ms", frame_ms), ("--gi-budget-ms", gi_ms)):
        if not 0 < value < float("inf"):
            raise BadInput(f"{value:g} ms is no budget", where=name, mend="give more than 0")
    return Budgets(frame_ms, gi_ms)


def _suited(
    jobs: Sequence[Job], shared: Shared, *, all_techniques: bool
) -> tuple[list[Job], list[str]]:
    """The jobs that suit their scenes; of techniques that nobody named, those that do not are told.

    Raises:
        BadInput: a job that was asked for does not suit, or none does.
    """
    suited: list[Job] = []
    left_out: dict[str, None] = {}
    first: BadInput | None = None
    for job in jobs:
        try:
            check_job(job, shared)
            suited.append(job)
        except BadInput as error:
            if not all_techniques:
                raise
            first = first or error
            left_out.setdefault(f"{job.technique} is left out: {error}")
    if all_techniques:
        for job in [job for job in suited if _must_bake_long(job, shared)]:
            suited.remove(job)
            left_out.setdefault(
                f"{job.technique} is left out: its bake takes minutes; run it once with "
                f"--technique {job.technique}"
            )
    if not suited and first is not None:
        raise first
    return suited, list(left_out)


def _must_bake_long(job: Job, shared: Shared) -> bool:
    """Whether its bake takes minutes and was never begun."""
    spec = find_technique(job.technique)
    if not spec.long_bake:
        return False
    scene = shared.scene(job.scene)
    lightmap = shared.lightmap(job.scene, job.receivers or scene.receivers)
    return shared.bake_seconds(spec, job.settings, scene, lightmap) == 0


def _competes(result: JobResult) -> bool:
    """Whether it ran, as asked, and has any global illumination to compare."""
    gi = any(item.stage == GI for item in result.passes)
    return gi and result.frames > 0 and result.status == OK


def _keep_errors(
    folder: RunFolder, jobs: Sequence[tuple[int, Job]], site: Site, seconds: float
) -> bool:
    """Measure errors and write ``errors.csv``; whether nobody interrupted that."""
    try:
        rows = run_errors(jobs, site, Worker(), seconds)
    except KeyboardInterrupt:
        return False
    except GibenchError as error:
        _LOG.warning("errors were not measured: %s", error)
        return True
    folder.write_text(ERRORS, csv_text(pd.DataFrame(rows, columns=list(ERROR_COLUMNS))))
    return True


@dataclass(frozen=True)
class _ImageTaker:
    writer: ImageWriter

    def __call__(self, result: JobResult, images: dict[str, Any]) -> None:
        label = f"{result.number:02d}-{job_label(result.job, result.scene)}"
        self.writer.write(result.scene, label, images)
