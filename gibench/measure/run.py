"""A whole run: the machine's roofs, every job in turns, the roofs again, and the record of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gibench.errors import CannotRun, CheckFailed, GibenchError, Interrupted
from gibench.measure.machine import roofs as machine_roofs
from gibench.measure.plan.stopping import Plan
from gibench.measure.record import begin_record, finish_record
from gibench.measure.runfolder.axes import Axis, axes_of
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.session.cold import CacheFlush
from gibench.measure.session.interrupts import Interrupts
from gibench.measure.session.live import RunOutcome, TakeImages
from gibench.measure.session.loop import run_jobs
from gibench.measure.session.shared import Shared
from gibench.techniques.job import Job

Write = Callable[[RunFolder, Mapping[str, Any]], None]


@dataclass(frozen=True)
class Measured:
    """What a run left.

    Attributes:
        record: the content of ``run.json``.
        axes: settings with a column of their own.
        outcome: what became of the jobs.
    """

    record: dict[str, Any]
    axes: tuple[Axis, ...]
    outcome: RunOutcome


def run(
    jobs: Sequence[Job],
    plan: Plan,
    shared: Shared,
    cl_device: Any,
    folder: RunFolder,
    *,
    arguments: Mapping[str, Any],
    fit: bool = False,
    cold: bool = False,
    take_images: TakeImages | None = None,
    axes: Sequence[Axis] | None = None,
    first: int = 1,
    write: Write | None = None,
) -> Measured:
    """Measure ``jobs``, all of one shot and seed, into ``folder``.

    Ctrl-C or a full disk ends it early; what was measured is kept and recorded.

    Args:
        jobs: to run, those that share a bake next to each other.
        plan: how many frames.
        shared: what is loaded and baked.
        cl_device: executes.
        folder: where samples and the record go.
        arguments: what was asked, for the record.
        fit: lower the receivers until a job fits its profile.
        cold: empty the caches before every frame.
        take_images: is given every finished job's images.
        axes: settings with a column of their own; by default those of ``jobs``.
        first: number of the first configuration.
        write: writes the tables, given the whole record.

    Raises:
        BadInput: a scene, its camera or settings for it are wrong.
        GibenchError: not even the head of the samples can be written.
    """
    columns, profile = tuple(axes or axes_of(jobs)), jobs[0].profile
    flush = CacheFlush(profile, cl_device) if cold else None
    roofs = machine_roofs.measure_roofs(profile, cl_device)
    facts = flush.facts if flush else None
    record = begin_record(arguments, jobs, plan, columns, cl_device, roofs, facts)
    folder.write_record(record)
    outcome = run_jobs(
        jobs,
        plan,
        shared,
        cl_device,
        folder,
        axes=columns,
        first=first,
        fit=fit,
        take_images=take_images,
        flush=flush,
    )
    after = None
    with Interrupts() as interrupts:
        try:
            with interrupts.work():
                if not outcome.ended:
                    after = machine_roofs.measure_roofs(profile, cl_device)
        except KeyboardInterrupt:
            outcome.interrupted = True
        record = finish_record(record, outcome, columns, shared, after)
        try:
            folder.write_record(record)
            if write is not None:
                write(folder, record)
        except GibenchError as error:
            outcome.write_error = outcome.write_error or error
        outcome.interrupted |= interrupts.came()
    return Measured(record, columns, outcome)


def verdict(outcome: RunOutcome, folder: Path) -> GibenchError | None:
    """What a run comes down to where it is not fine: it was interrupted, nothing could run (the
    first reason), or something failed.
    """
    kept = f"{outcome.samples:,} samples are kept in {folder}"
    if outcome.interrupted:
        return Interrupted(f"interrupted; {kept}")
    if outcome.write_error is not None:
        where = outcome.write_error.where
        return GibenchError(f"{outcome.write_error.what}; {kept}", where=where)
    first = outcome.first_error
    if outcome.samples == 0 and isinstance(first, GibenchError):
        return first
    if outcome.samples == 0 and first is not None:
        raise first
    if outcome.samples == 0:
        return CannotRun("no pass of any configuration ran", mend=f"see {folder / 'report.md'}")
    failed = [result for result in outcome.results if result.status == "failed"]
    if failed:
        return CheckFailed(
            f"{len(failed)} of {len(outcome.results)} configurations failed, the first because "
            f"{failed[0].reason}",
            mend=f"what was measured is in {folder}",
        )
    return None
