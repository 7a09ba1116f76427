"""``gibench project``: times of a run's configurations on devices that are not here, as ranges."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.commands import asked
from gibench.commands.frame_traces import TracedLaunch, trace_frame, warmed_up
from gibench.commands.projected_ratios import Whole, ratio_table
from gibench.commands.run_files import write_tables
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput, GibenchError
from gibench.measure.plan.grid import job_label
from gibench.measure.runfolder.axes import plain_settings
from gibench.measure.runfolder.folder import SAMPLES, RunFolder
from gibench.measure.runfolder.results import OK
from gibench.measure.runfolder.stored_run import read_record
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.profiles import MACHINE_FIGURES, DeviceProfile, Machine
from gibench.project.model import Times, launch_times
from gibench.project.ranges import UNKNOWN, Total, range_of, ratio, together
from gibench.report.projected import COLUMNS, PROJECTED, RANKED, RATIOS, WHOLE_FRAME, WHOLE_GI
from gibench.report.tables import csv_text
from gibench.techniques.job import AUTO, Job
from gibench.techniques.technique import GI
from gibench.trace.extra import require_extra
from gibench.trace.kept_streams import streams_of
from gibench.trace.request import Sampling, TraceRequest
from gibench.trace.streams import WaveStreams

_SAMPLING = Sampling(runs=9, length=8, words=16 << 20, seconds=6.0, unroll=True)
"""Of each launch: places enough for images, whose edges differ from their middle."""
Row = dict[str, Any]
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Projection:
    """Projected ranges.

    Attributes:
        folder: of the run; has ``projected.csv``.
        table: a row for each configuration, device and pass, and for whole frames and their GI.
        ratios: of whole frames and their GI to the cheapest configuration's, of each device.
    """

    folder: Path
    table: pd.DataFrame = field(repr=False)
    ratios: pd.DataFrame = field(repr=False)


@dataclass(frozen=True)
class ProjectedRun:
    """Rows of ``projected.csv`` and of ``ratios.csv``."""

    table: pd.DataFrame
    ratios: pd.DataFrame

    def write(self, folder: RunFolder) -> None:
        """Put both into a run's folder.

        Raises:
            GibenchError: the disk refuses.
        """
        folder.write_text(PROJECTED, csv_text(self.table))
        folder.write_text(RATIOS, csv_text(self.ratios))


@dataclass(frozen=True)
class Projected:
    """Totals of a configuration on a device: of each pass, its GI and the frame."""

    passes: Mapping[str, Total | GibenchError]
    gi: Total | GibenchError
    frame: Total | GibenchError


def project(
    run: str | Path,
    device_profile: asked.Texts,
    cache_dir: str | Path | None = None,
    tell: Tell = lambda _: None,
) -> Projection:
    """Project a stored run's configurations onto devices, as ``gibench project`` does.

    Raises:
        BadInput: it is no run, its inputs are not here, or a profile has no machine part.
        CannotRun: the extra is missing.
        GibenchError: its folder cannot be written.
    """
    require_extra()
    profiles = machine_profiles(asked.several(device_profile))
    path = Path(run)
    record = read_record(path)
    shared = Shared(asked.cache_folder(cache_dir), int(record["seed"]))
    jobs = jobs_of_record(record, path, shared)
    found = project_jobs(jobs, record, profiles, shared, select_cl_device(None), tell)
    folder = RunFolder(path)
    found.write(folder)
    if (path / SAMPLES).is_file():
        write_tables(folder, record)  # its report has them too
    return Projection(path, found.table, found.ratios)


def machine_profiles(names: Sequence[str]) -> list[DeviceProfile]:
    """Profiles to project onto.

    Raises:
        BadInput: one is unknown, unsound, or has no machine part.
    """
    profiles = asked.load_profiles(names)
    for profile in profiles:
        if profile.machine is None:
            raise BadInput(
                f"profile {profile.name} has no machine part to project from",
                mend=f"add [machine] with {', '.join(MACHINE_FIGURES)}; see 'gibench profiles "
                "check'",
            )
    return profiles


def jobs_of_record(record: Mapping[str, Any], path: Path, shared: Shared) -> dict[int, Job]:
    """The jobs that ran of a stored run, by number of the configuration, made anew from what it was
    asked. Of that, a shard ran a part, and a technique that nobody named may be left out of some
    scene.

    Raises:
        BadInput: its inputs are not here.
    """
    given = record["arguments"]
    if given.get("motion", "rest") not in ("rest", "scene"):
        raise BadInput("objects moved as a file said that is not part of the run", where=path)
    all_asked = asked.jobs_of({**given, "seed": int(record["seed"])})
    found = {}
    for entry in record["configurations"]:
        if entry["status"] != OK:
            continue
        job = next((job for job in all_asked if _ran_as(job, entry, shared)), None)
        if job is None:
            raise BadInput(
                f"configuration {entry['configuration']} cannot be made again from what was asked",
                where=path,
                mend="run it anew with --project",
            )
        # Of another runtime's record: the layout that ran there, not the one preferred here.
        found[int(entry["configuration"])] = replace(job, layout=entry.get("layout") or job.layout)
    return found


def _ran_as(job: Job, entry: Mapping[str, Any], shared: Shared) -> bool:
    """Whether the configuration ``entry`` of a record is ``job``."""
    named = (job.technique, job.variant, job.profile.name)
    if named != (entry["technique"], entry["variant"], entry["profile"]):
        return False
    if job.layout not in (None, entry.get("layout")):
        return False
    if (job.workgroup_size == AUTO) != bool(entry.get("auto_workgroup")):
        return False
    if job.workgroup_size not in (AUTO, entry["workgroup_size"]):
        return False
    settings = plain_settings(job.settings)
    if entry.get("settings", settings) != settings:
        return False
    scene = shared.scene(job.scene)
    receivers = entry.get("receivers_asked")
    return scene.name == entry["scene"] and receivers in (None, job.receivers or scene.receivers)


def project_jobs(
    jobs: Mapping[int, Job],
    record: Mapping[str, Any],
    profiles: Sequence[DeviceProfile],
    shared: Shared,
    cl_device: Any,
    tell: Tell = lambda _: None,
) -> ProjectedRun:
    """The rows of ``projected.csv`` and ``ratios.csv``, for the configurations that ran.

    Args:
        jobs: of the run, by number of the configuration; those that ran.
        record: the content of its ``run.json``. With ``--fit`` receivers are lowered as they were.
        profiles: devices to project onto, each with a machine part.
        shared: what is loaded and baked.
        cl_device: executes the frames.
        tell: is told how far it is.
    """
    rows: list[Row] = []
    wholes: list[Whole] = []
    fit = bool(record["arguments"].get("fit"))
    for entry in record["configurations"]:
        if entry["status"] != OK:
            continue
        job = jobs[entry["configuration"]]
        tell(f"tracing {job_label(job, entry['scene'])}")
        head = {name: entry[name] for name in ("configuration", "technique", "variant", "scene")}
        head |= {"layout": entry.get("layout"), "profile": job.profile.name}
        for profile, found, stages in project_job(job, profiles, shared, cl_device, fit):
            here = head | {"device": profile.name}
            rows += _rows(here, found, stages, profile)
            gi = {WHOLE_GI: found.gi} if GI in stages.values() else {}
            wholes.append(Whole(here, {**gi, WHOLE_FRAME: found.frame}))
    return ProjectedRun(pd.DataFrame(rows, columns=list(COLUMNS)), ratio_table(wholes))


def project_job(
    job: Job,
    profiles: Sequence[DeviceProfile],
    shared: Shared,
    cl_device: Any,
    fit: bool = False,
) -> list[tuple[DeviceProfile, Projected, Mapping[str, str]]]:
    """A job's frame on every profile, with the stages of its passes; with ``fit`` at as many
    receivers as fit the job's own profile.
    """
    widths = sorted({min(profile.simd_width, 64) for profile in profiles})
    cache = shared.cache_dir / "traces"

    def look(request: TraceRequest) -> dict[int, WaveStreams]:
        return streams_of(request, widths, cache, _SAMPLING)

    with Session.open(job, shared, cl_device, fit=fit) as session:
        session.prepare()
        frame = warmed_up(session)
        launches = trace_frame(session, frame, look, begun=frame)
        stages = {item.name: str(item.stage) for item in session.prepared}
    return [(each, _projected(launches, each, stages), stages) for each in profiles]


def ranked(
    found: Mapping[int, Projected], profile: DeviceProfile, about: pd.DataFrame
) -> pd.DataFrame:
    """Settings by their projected GI, the fastest first, with how sure it is that each is slower
    than the one before it in the table and than the first.

    Args:
        found: by number of the setting.
        profile: what they are projected on.
        about: a row for each, by number: technique, variant, settings, receivers.
    """
    totals = {number: each.gi for number, each in found.items()}
    known = {n: each for n, each in totals.items() if isinstance(each, Total)}
    order = sorted(known, key=lambda number: float(known[number].times[0]))
    rows: list[Row] = []
    for place, number in enumerate([*order, *(n for n in totals if n not in known)]):
        total = totals[number]
        row = {name: about.loc[number, name] for name in RANKED[1:5]}
        row |= {"number": number, "device": profile.name, **projected_columns(total, profile)}
        if isinstance(total, Total):
            row["rank"] = place + 1
            if place:
                row["slower_than_last"] = ratio(total, known[order[place - 1]]).verdict
                row["slower_than_first"] = ratio(total, known[order[0]]).verdict
        rows.append(row)
    return pd.DataFrame(rows, columns=list(RANKED))


def _projected(
    launches: Sequence[TracedLaunch[dict[int, WaveStreams]]],
    profile: DeviceProfile,
    stages: Mapping[str, str],
) -> Projected:
    machine, width = machine_of(profile), min(profile.simd_width, 64)
    by_pass: dict[str, list[Times] | GibenchError] = {}
    for each in launches:
        times = by_pass.setdefault(each.item.name, [])
        if isinstance(times, GibenchError):
            continue
        if isinstance(each.found, GibenchError):
            by_pass[each.item.name] = each.found
        elif each.found is None:
            by_pass[each.item.name] = GibenchError(each.item.problem or "it cannot run")
        else:
            times.append(launch_times(each.found[width], machine))
    gi = [name for name in by_pass if stages[name] == GI]
    return Projected(
        {name: _total([found]) for name, found in by_pass.items()},
        _total([by_pass[name] for name in gi]),
        _total(list(by_pass.values())),
    )


def _total(parts: Sequence[list[Times] | GibenchError]) -> Total | GibenchError:
    launches: list[Times] = []
    for part in parts:
        if isinstance(part, GibenchError):
            return part
        launches += part
    return together(launches) if launches else GibenchError("nothing was launched in this frame")


def machine_of(profile: DeviceProfile) -> Machine:
    """The machine part of a profile that has one."""
    assert profile.machine is not None
    return profile.machine


def _rows(
    head: Row, found: Projected, stages: Mapping[str, str], profile: DeviceProfile
) -> list[Row]:
    totals = [(name, stages[name], total) for name, total in found.passes.items()]
    if GI in stages.values():
        totals.append((WHOLE_GI, str(GI), found.gi))
    totals.append((WHOLE_FRAME, "", found.frame))
    return [
        head | {"pass": name, "stage": stage} | projected_columns(total, profile)
        for name, stage, total in totals
    ]


def projected_columns(total: Total | GibenchError, profile: DeviceProfile) -> Row:
    """The columns of a projected time: a range, no point in it where it is wide."""
    if isinstance(total, GibenchError):
        return {"verdict": UNKNOWN, "projection_reason": str(total)}
    each = range_of(total, machine_of(profile))
    return {
        "projected_low_ms": each.low,
        "projected_nominal_ms": each.shown,
        "projected_high_ms": each.high,
        "bound_by": each.bound_by,
        "driven_by": each.driven_by,
        "verdict": each.verdict,
        "projection_reason": each.reason,
    }
