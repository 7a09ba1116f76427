"""``gibench quality``, and :func:`gibench.quality`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput, CheckFailed, GibenchError, Interrupted, printable
from gibench.measure.machine.environment import cpu_name
from gibench.measure.plan.grid import with_layouts
from gibench.measure.record import study_record
from gibench.measure.runfolder.axes import axes_of
from gibench.report.faults import plot_faults, profiled
from gibench.report.quality import quality_report, quality_table
from gibench.report.tables import csv_text
from gibench.scene.load import names_apart
from gibench.study.pictures import write_pictures
from gibench.study.quality import QualityOutcome, check_views, compare
from gibench.study.quality_rows import Group, QualityOptions, columns
from gibench.study.receivers_file import NAME, write_receivers
from gibench.study.settle import SettleOptions
from gibench.study.site import Site
from gibench.techniques.job import Job
from gibench.work import Executor


@dataclass(frozen=True)
class QualityResult:
    """What a comparison with the truth left.

    Attributes:
        folder: with everything that was written.
        table: one row per result and region: ``quality.csv``.
        groups: results that share receivers and their reference.
        error: what is not fine: something failed, was refused or interrupted.
    """

    folder: Path
    table: pd.DataFrame = field(repr=False)
    groups: list[Group] = field(repr=False)
    error: GibenchError | None

    @cached_property
    def receivers(self) -> pd.DataFrame:
        """One row per receiver: ``group``, position ``x y z`` (m), ``area`` (m2), and for the
        ``reference``, its standard error and every result the indirect irradiance of the three
        channels (W/m2), as ``<name> r``, ``<name> g`` and ``<name> b``.
        """
        parts = []
        for group in self.groups:
            receivers = group.lightmap.receivers
            values: dict[str, Any] = dict(zip("xyz", receivers.position.T, strict=True))
            values["area"] = receivers.area
            named = {"reference": group.truth.value, "reference stderr": group.truth.stderr}
            for name, irradiance in {**named, **group.results}.items():
                for channel, column in zip("rgb", np.asarray(irradiance).T, strict=True):
                    values[f"{name} {channel}"] = column
            parts.append(pd.DataFrame({"group": group.name, **values}))
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


_ALSO_RECORDED = (
    "light_frame",
    "bounces",
    "target_error",
    "reference_seed",
    "reference_paths",
    "region",
    "faults",
)


@within_bounds
def quality(
    device_profile: asked.Texts = ("iphone7",),
    scene: asked.Texts = ("cornell-box",),
    technique: asked.Texts = ("srp",),
    variant: asked.Texts = ("tuned",),
    layout: asked.Texts | None = None,
    sh_order: asked.Numbers = None,
    probes: asked.Numbers = None,
    receivers: asked.Numbers = None,
    workgroup_size: asked.Numbers = None,
    settings: asked.SettingsAsked = None,
    light_frame: int = 0,
    bounces: int | None = None,
    target_error: float = 0.02,
    reference: str | Path | None = None,
    reference_seed: int = 1,
    reference_paths: int | None = None,
    region: asked.Texts | None = None,
    frames: int = 512,
    faults: bool = True,
    resolution: str | tuple[int, int] = "1334x750",
    camera: str | int | None = None,
    camera_path: str = "rest",
    rest_frames: int = 60,
    flight_frames: int = 240,
    motion: str = "rest",
    out: str | Path | None = None,
    seed: int = 0,
    device: int | None = None,
    cache_dir: str | Path | None = None,
    executor: Executor | None = None,
) -> QualityResult:
    """Compare techniques with the path-traced truth, as ``gibench quality`` does; its help says
    what everything is.

    A configuration that cannot run has its reason in the table and the others go on; what the
    command line would end with is in ``error``.

    ``executor`` computes what is baked and what is compared (:mod:`gibench.work.executors`); no
    result depends on it, and frames are timed one configuration at a time.

    Raises:
        BadInput: an input is wrong.
        CannotRun: no work-group size asked suits any profile asked.
        GibenchError: the folder cannot be written.
    """
    given = locals()
    arguments = asked.recorded(given, *_ALSO_RECORDED)
    arguments["reference"] = reference and Path(reference).name
    arguments["motion"] = printable(Path(motion).name)
    cl_device = select_cl_device(device)
    jobs = [_held(job, light_frame) for job in with_layouts(asked.jobs_of(given), cl_device)]
    flight = jobs[0].shot.flight
    if frames <= flight.frames:
        raise BadInput(
            f"{frames} frames end before the camera is back from its flight of {flight.frames}",
            where="--frames",
            mend="give more, for light to settle after it",
        )
    names = names_apart([job.scene for job in jobs])
    site = Site(asked.cache_folder(cache_dir), seed, device, executor, names=names)
    several = len({(job.scene, job.receivers) for job in jobs}) > 1
    if reference is not None and several:
        raise BadInput(
            "--reference is of one scene and one number of receivers, and several are asked for"
        )
    how = QualityOptions(
        settle=SettleOptions(frames),
        light_frame=light_frame,
        bounces=bounces,
        target_error=target_error,
        regions=asked.several(region),
        reference=None if reference is None else Path(reference),
        reference_seed=reference_seed,
        reference_paths=reference_paths,
        watched=faults,
    )
    check_views(jobs, how, site)
    profiles = list(dict.fromkeys(job.profile.name for job in jobs))
    folder = asked.folder_for(out, "quality", profiles, arguments)
    record = study_record(arguments, cl_device) | {"motion": jobs[0].shot.motion.record()}
    folder.write_record(record)
    axes = axes_of(jobs)
    keeper = _Keeper(folder.path, several)
    outcome = compare(jobs, how, site, axes=axes, executor=executor, take=keeper)
    table = quality_table(outcome.rows, columns(axes))
    if outcome.rows:
        shared = site.standing(light_frame)
        scenes = [shared.scene(name) for name in dict.fromkeys(job.scene for job in jobs)]
        warnings = {found.name: found.warnings for found in scenes}
        folder.write_text("quality.csv", csv_text(table))
        folder.write_text("quality.md", quality_report(table, cpu_name(), warnings))
        if profiled(table):
            plot_faults(folder.path / "faults", table)
    return QualityResult(folder.path, table, outcome.groups, verdict(outcome, folder.path))


def _held(job: Job, frame: int) -> Job:
    """``job`` with what moves standing for ever where it is in ``frame``, as its lights do."""
    if not (motion := job.shot.motion).moves:
        return job
    return replace(job, shot=replace(job.shot, motion=replace(motion, held=frame)))


@dataclass(frozen=True)
class _Keeper:
    """Writes receivers and pictures as soon as a result is there."""

    folder: Path
    several: bool

    def __call__(self, group: Group, name: str) -> None:
        beneath = self.folder / group.name if self.several else self.folder
        truth = group.truth
        write_receivers(
            beneath / NAME, group.lightmap, truth.value, truth.stderr, group.results, group.about
        )
        write_pictures(beneath / "images", truth, name, group.results[name])


def verdict(outcome: QualityOutcome, folder: Path) -> GibenchError | None:
    """What a comparison comes down to where it is not fine: it was interrupted, nothing could be
    compared (the first reason), or something failed.
    """
    done = sum(row["status"] == "ok" for row in outcome.rows)
    if outcome.interrupted:
        return Interrupted(f"interrupted; {done} rows are kept in {folder}")
    if not done and outcome.first_error is not None:
        return outcome.first_error
    failed = [row for row in outcome.rows if row["status"] == "failed"]
    if failed:
        return CheckFailed(
            f"{len(failed)} configurations failed, the first because {failed[0]['reason']}",
            mend=f"what was compared is in {folder}",
        )
    return None
