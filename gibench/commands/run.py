"""``gibench run``, and :func:`gibench.run`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.commands import asked
from gibench.device.device import select_cl_device
from gibench.errors import GibenchError, printable
from gibench.measure.plan.grid import job_label
from gibench.measure.plan.stopping import Patience, Plan
from gibench.measure.run import Measured, verdict
from gibench.measure.run import run as measure
from gibench.measure.runfolder.folder import SAMPLES, RunFolder
from gibench.measure.runfolder.results import JobResult
from gibench.measure.session.session import check_job
from gibench.measure.session.shared import Shared
from gibench.profiles import DeviceProfile
from gibench.report.images import ImageWriter
from gibench.report.markdown import report
from gibench.report.projection import PROJECTED, projected_section
from gibench.report.roofline import write_roofline
from gibench.report.tables import csv_text, frames_table, passes_table
from gibench.techniques.job import Job
from gibench.trace.extra import require_extra
from gibench.work import Executor


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
    """

    folder: Path
    record: dict[str, Any]
    samples: pd.DataFrame = field(repr=False)
    passes: pd.DataFrame = field(repr=False)
    frames: pd.DataFrame = field(repr=False)
    error: GibenchError | None
    ran: int
    projected: pd.DataFrame | None = field(default=None, repr=False)


def run(
    device_profile: asked.Texts = ("iphone7",),
    scene: asked.Texts = ("cornell-box",),
    technique: asked.Texts = ("srp", "direct"),
    variant: asked.Texts = ("tuned",),
    sh_order: asked.Numbers = None,
    probes: asked.Numbers = None,
    receivers: asked.Numbers = None,
    workgroup_size: asked.Sizes = None,
    settings: asked.SettingsAsked = None,
    frames: int | None = None,
    warmup: int | None = None,
    warmup_frames: int = 1000,
    warmup_seconds: float = 90.0,
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
    arguments = asked.recorded(
        given, "warmup", "warmup_frames", "warmup_seconds", "cold", "fit", "save_images"
    )
    arguments["motion"] = printable(Path(motion).name)
    projected_on = _projected_on(asked.several(project))
    jobs = asked.jobs_of(given)
    cl_device = select_cl_device(device)
    shared = Shared(asked.cache_folder(cache_dir), seed, executor)
    for job in jobs:
        check_job(job, shared)
    patience = Patience(warmup_frames, warmup_seconds)
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
        take_images=_ImageTaker(ImageWriter(folder.path / "images")) if save_images else None,
        write=write_tables,
    )
    result = _result(folder.path, measured)
    if not projected_on or not result.ran or measured.outcome.interrupted:
        return result
    table = _project(folder, jobs, measured, projected_on, shared, cl_device)
    return replace(result, projected=table)


def _projected_on(names: Sequence[str]) -> list[DeviceProfile]:
    if not names:
        return []
    from gibench.commands.project import machine_profiles

    require_extra()
    return machine_profiles(names)


def _project(
    folder: RunFolder,
    jobs: Sequence[Job],
    measured: Measured,
    profiles: Sequence[DeviceProfile],
    shared: Shared,
    cl_device: Any,
) -> pd.DataFrame:
    """Project what ran, and add it to the folder and its report."""
    from gibench.commands.project import project_jobs

    table = project_jobs(jobs, measured.record, profiles, shared, cl_device)
    folder.write_text(PROJECTED, csv_text(table))
    write_tables(folder, measured.record)
    return table


def write_tables(folder: RunFolder, record: Mapping[str, Any]) -> None:
    """Write the tables and the report of a run from its stored samples.

    Raises:
        GibenchError: the disk refuses.
    """
    _, passes, frames = _tables(folder.path, record)
    folder.write_text("passes.csv", csv_text(passes))
    folder.write_text("frames.csv", csv_text(frames))
    write_roofline(folder.path, passes, record)
    text = report(passes, frames, record)
    if (folder.path / PROJECTED).is_file():
        text += "\n" + projected_section(pd.read_csv(folder.path / PROJECTED))
    folder.write_text("report.md", text)


def _tables(
    path: Path, record: Mapping[str, Any]
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    samples = pd.read_csv(path / SAMPLES)
    return samples, passes_table(samples, record), frames_table(samples, record)


def _result(path: Path, measured: Measured) -> RunResult:
    outcome = measured.outcome
    error = verdict(outcome, path)
    ran = sum(result.frames > 0 for result in outcome.results)
    return RunResult(path, measured.record, *_tables(path, measured.record), error, ran)


@dataclass(frozen=True)
class _ImageTaker:
    writer: ImageWriter

    def __call__(self, result: JobResult, images: dict[str, Any]) -> None:
        label = f"{result.number:02d}-{job_label(result.job, result.scene)}"
        self.writer.write(result.scene, label, images)
