"""The record of a run: what ``run.json`` holds beside the samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gibench.errors import BadInput, printable
from gibench.measure.machine.environment import (
    device_record,
    environment,
    machine_text,
    versions,
    without_paths,
)
from gibench.measure.plan.stopping import Plan
from gibench.measure.runfolder.axes import Axis
from gibench.measure.runfolder.folder import SCHEMA_VERSION, RunFolder
from gibench.measure.session.cold import ColdFacts
from gibench.measure.session.live import RunOutcome
from gibench.measure.session.shared import Shared
from gibench.measure.statistics.summary import Roofs
from gibench.profiles import DeviceProfile
from gibench.scene.motion.file import motions_hash
from gibench.techniques.job import Job
from gibench.techniques.registry import declared_counts


def begin_record(
    arguments: Mapping[str, Any],
    jobs: Sequence[Job],
    plan: Plan,
    axes: Sequence[Axis],
    cl_device: Any,
    roofs: Roofs,
    cold: ColdFacts | None = None,
) -> dict[str, Any]:
    """What is known before the first of ``jobs``, all of one shot and seed; ``cold`` where caches
    are emptied.
    """
    first = jobs[0]
    shot, flight = first.shot, first.shot.flight
    profiles = {job.profile.name: job.profile for job in jobs}
    return {
        "schema_version": SCHEMA_VERSION,
        "finished": False,
        "interrupted": False,
        "started_utc": datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "arguments": dict(arguments),
        "seed": first.seed,
        "axes": [axis.column for axis in axes],
        "counts": declared_counts(),
        "image": {"width": shot.width, "height": shot.height},
        "plan": asdict(plan),
        "motion": shot.motion.record(),
        "flight": {**asdict(flight), "path": Path(flight.path).name},
        "cold": cold.record() if cold else None,
        "versions": versions(),
        "environment": environment(),
        "device": device_record(cl_device),
        "profiles": [_profile(profile) for profile in profiles.values()],
        "roofs": _roofs(asdict(roofs), None),
        "scenes": [],
        "configurations": [],
    }


def study_record(
    arguments: Mapping[str, Any], cl_device: Any, there: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """``run.json`` of ``quality``, ``advise`` and ``experiment``: what was asked, and where.

    Args:
        arguments: what was asked.
        cl_device: of this machine.
        there: of the machine that is timed, where it is another.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "arguments": dict(arguments),
        "seed": arguments["seed"],
        "versions": versions(),
        "environment": environment(),
        "device": device_record(cl_device),
        **(there or {}),
    }


def on_one_machine(
    folder: RunFolder, record: Mapping[str, Any], *, complete: bool
) -> dict[str, Any]:
    """``record`` for a folder that may hold results already: these, and what is still to come, are
    of one machine.

    Args:
        folder: the folder.
        record: made here and now.
        complete: whether nothing is to be measured any more: the machine is then the earlier one.

    Raises:
        BadInput: what is there was measured on another kind of machine.
    """
    before = folder.record()
    if before is None or not {"environment", "device"} <= set(before):
        return dict(record)
    kept = {key: before[key] for key in ("shards",) if key in before}
    theirs, mine = (machine_text(one["environment"], one["device"]) for one in (before, record))
    if theirs == mine:
        return {**record, **kept}
    if not complete:
        raise BadInput(
            f"what it holds was measured on {theirs}, and this is {mine}",
            where=folder.path,
            mend="give another folder with --out: times of two machines are not compared",
        )
    machine = ("environment", "device", "versions", "roofs")
    return {**record, **kept, **{key: before[key] for key in machine if key in before}}


def finish_record(
    record: Mapping[str, Any],
    outcome: RunOutcome,
    axes: Sequence[Axis],
    shared: Shared,
    roofs: Roofs | None,
) -> dict[str, Any]:
    """The record with what came out; ``roofs`` as they are now, None if not measured again."""
    return {
        **record,
        "finished": True,
        "interrupted": outcome.interrupted,
        "write_error": None if outcome.write_error is None else outcome.write_error.what,
        "finished_utc": datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "roofs": _roofs(record["roofs"]["start"], roofs),
        "scenes": _scenes(outcome, shared),
        "configurations": [result.record(axes) for result in outcome.results],
    }


def _roofs(start: Mapping[str, Any], end: Roofs | None) -> dict[str, Any]:
    """Roofs at the start and at the end: again those of the start where none were measured."""
    return {
        "start": start,
        "end": asdict(end) if end else start,
        "measured_again": end is not None,
    }


def _scenes(outcome: RunOutcome, shared: Shared) -> list[dict[str, Any]]:
    asked = dict.fromkeys(result.job.scene for result in outcome.results)
    scenes = [(name, shared.scene(name)) for name in asked]
    return [
        {
            "name": scene.name,
            "file": printable(Path(name).name),
            "triangles": len(scene.triangles),
            "content_hash": scene.content_hash(),
            "motions_hash": motions_hash(scene.motions),
            "warnings": [without_paths(warning) for warning in scene.warnings],
        }
        for name, scene in scenes
    ]


def _profile(profile: DeviceProfile) -> dict[str, Any]:
    return asdict(replace(profile, figures=dict(profile.figures)))
