"""``gibench explain``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.commands import asked
from gibench.commands.frame_traces import trace_frame, warmed_up
from gibench.commands.project import ProjectedRun, machine_profiles
from gibench.commands.project_own import project_own
from gibench.device import Device
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput, CannotRun, CheckFailed, GibenchError, printable
from gibench.measure.plan.grid import with_layouts
from gibench.measure.runfolder.folder import SCHEMA_VERSION
from gibench.measure.session.enqueue import PreparedPass
from gibench.measure.session.session import Session, check_job
from gibench.measure.session.shared import Shared
from gibench.profiles import DeviceProfile
from gibench.report import explain as told
from gibench.report.explain_plot import write_reuse
from gibench.report.tables import csv_text
from gibench.techniques.job import Job
from gibench.trace.extra import require_extra
from gibench.trace.facts import SIMD_WIDTHS, LaunchFacts
from gibench.trace.own_kernel import Extent, defines_of, own_request, sides_of
from gibench.trace.request import Sampling, TraceRequest

Row = dict[str, Any]


@dataclass(frozen=True)
class Explanation:
    """What launches do.

    Attributes:
        folder: with ``explain.csv``, ``explain.md`` and the reuse curves.
        table: a row per launch.
        profile: whose units the figures are set against.
        projected: ranges of times of one's own kernels, where they were asked for.
        error: what is not fine: some launch could not be traced.
    """

    folder: Path
    table: pd.DataFrame = field(repr=False)
    profile: DeviceProfile
    projected: ProjectedRun | None
    error: GibenchError | None


def explain(
    device_profile: str = "iphone7",
    scene: str = "cornell-box",
    technique: asked.Texts = ("srp",),
    variant: asked.Texts = ("tuned",),
    kernel: asked.Texts = (),
    arg: Sequence[str] = (),
    define: asked.Texts = (),
    items: int | str | None = None,
    group: int | str | None = None,
    project: asked.Texts = (),
    layout: asked.Texts | None = None,
    sh_order: asked.Numbers = None,
    probes: asked.Numbers = None,
    receivers: asked.Numbers = None,
    workgroup_size: asked.Sizes = None,
    settings: asked.SettingsAsked = None,
    frame: int | None = None,
    resolution: str | tuple[int, int] = "1334x750",
    camera: str | int | None = None,
    camera_path: str = "rest",
    rest_frames: int = 0,
    flight_frames: int = 240,
    motion: str = "rest",
    out: str | Path | None = None,
    seed: int = 0,
    cache_dir: str | Path | None = None,
) -> Explanation:
    """Trace launches, as ``gibench explain`` does; its help says what everything is.

    Raises:
        BadInput: an input is wrong.
        CannotRun: the extra is missing, or a technique does not fit the profile.
        GibenchError: the folder cannot be written.
    """
    given = locals()
    own = ("arg", "define", "items", "group", "project")
    arguments = asked.recorded(given, "variant", "frame", *own)
    arguments["motion"] = printable(Path(motion).name)
    arguments |= {"command": "explain", "kernel": [Path(k).name for k in asked.several(kernel)]}
    require_extra()
    profile = asked.load_profiles([device_profile])[0]
    files, names = _kernels(asked.several(kernel))
    if not files and (alien := next((name for name in own if given[name]), None)):
        raise BadInput(
            f"--{alien} is for a kernel of your own",
            mend="add --kernel FILE.cl:NAME; 'gibench run --project' projects techniques",
        )
    devices = machine_profiles(asked.several(project))
    rows: list[Row] = []
    jobs: list[Job] = []
    if not files or names:
        jobs = asked.jobs_of(given)
    cl_device = select_cl_device(None)
    jobs = with_layouts(jobs, cl_device)
    shared = Shared(asked.cache_folder(cache_dir), seed)
    for job in jobs:
        check_job(job, shared)
    requests = []
    if files:
        sizes = [size for size in asked.workgroup_sizes(workgroup_size) if isinstance(size, int)]
        size = sizes[0] if sizes else profile.default_workgroup_size
        extent = Extent(
            (size,) if group is None else sides_of(str(group), "--group"),
            () if items is None else sides_of(str(items), "--items"),
        )
        device, macros = Device(profile, cl_device), defines_of(asked.several(define))
        requests = [own_request(device, file, name, arg, extent, macros) for file, name in files]
    folder = asked.folder_for(out, "explain", [profile.name], arguments)
    folder.write_record({"schema_version": SCHEMA_VERSION, "arguments": arguments})
    for request in requests:
        rows.append(_own_row(request, profile))
    projected = None
    if devices:
        projected = project_own(requests, devices, shared.cache_dir / "traces")
        projected.write(folder)
    for job in jobs:
        rows += _job_rows(job, shared, cl_device, frame, names)
    if names and not any(row["status"] != "skipped" for row in rows):
        raise BadInput(f"no pass asked for runs {names[0]}", mend="see 'gibench explain -t ...'")
    table = pd.DataFrame(rows, columns=told.columns(rows))
    folder.write_text("explain.csv", csv_text(table))
    folder.write_text("explain.md", "\n".join(f"- {line}" for line in told.told(table)) + "\n")
    write_reuse(folder.path, table)
    return Explanation(folder.path, table, profile, projected, _verdict(rows, folder.path))


def _kernels(texts: Sequence[str]) -> tuple[list[tuple[Path, str]], list[str]]:
    """Kernels of a user's files, and names of gibench's own (``srp/tuned.cl:probe_update``)."""
    from gibench.resources import data

    files, names = [], []
    for text in texts:
        file, colon, name = text.rpartition(":")
        if not (file and colon and name):
            raise BadInput(
                f"--kernel '{text}' is not FILE:NAME",
                mend="write for instance --kernel mine.cl:blur",
            )
        if Path(file).is_file():
            files.append((Path(file), name))
        elif data("kernels_cl").joinpath(*file.split("/")).is_file():
            names.append(text)
        else:
            raise BadInput(
                f"there is no kernel file {file}",
                mend="give the path of an OpenCL C file, or one beneath kernels_cl",
            )
    return files, names


def _own_row(request: TraceRequest, profile: DeviceProfile) -> Row:
    row: Row = {"technique": "", "variant": "", "layout": "", "scene": "", "profile": profile.name}
    row |= {"pass": request.label, "kernel": request.kernel, "launch": 0, "frame": 0}
    return row | _outcome(_traced(request, profile), profile, 0.0)


def _traced(request: TraceRequest, profile: DeviceProfile) -> LaunchFacts | GibenchError:
    """What a launch does, or why that is not known."""
    from gibench.trace.analysis import analyse
    from gibench.trace.trace import trace_launch

    widths = sorted({*SIMD_WIDTHS, min(profile.simd_width, max(SIMD_WIDTHS))})
    try:
        return analyse(trace_launch(request, Sampling()), widths, _own_caches(profile))
    except GibenchError as error:
        return error


def _own_caches(profile: DeviceProfile) -> tuple[int, ...]:
    """The nominal L1 of a unit, and the shared L2; none where the profile has no machine part."""
    machine = profile.machine
    return () if machine is None else (int(machine.l1_bytes.nominal), int(machine.l2_bytes.nominal))


def _outcome(found: LaunchFacts | GibenchError, profile: DeviceProfile, declared: float) -> Row:
    """The figures of a launch with their sentence, or why there are none."""
    if isinstance(found, GibenchError):
        status = "skipped" if isinstance(found, CannotRun) else "failed"
        return {"status": status, "reason": str(found)}
    sentence = told.sentence(found, profile, declared)
    return {**told.row(found, profile), "sentence": sentence, "status": "ok", "reason": ""}


def _job_rows(
    job: Job, shared: Shared, cl_device: Any, asked_frame: int | None, names: Sequence[str]
) -> list[Row]:
    """A row per launch of the job's frame ``asked_frame``, or the first at rest, buffers as the
    launch finds them.
    """
    with Session.open(job, shared, cl_device) as session:
        session.prepare()
        begun = warmed_up(session) if asked_frame is None else 0
        frame = begun if asked_frame is None else asked_frame
        launched = trace_frame(
            session, frame, lambda each: _traced(each, job.profile), names, begun
        )
        heads = {item.name: _head(job, session, item, frame) for item in session.prepared}
        work = {item.name: item.work for item in session.prepared} | session.counted()
    declared = {name: each.bytes_read + each.bytes_written for name, each in work.items()}
    rows = []
    for each in launched:
        name = each.item.name
        alone = declared[name] if len(each.item.launches) == 1 else 0.0
        if each.found is None:
            outcome: Row = {"status": each.item.status, "reason": each.item.problem}
        else:
            outcome = _outcome(each.found, job.profile, alone)
        head = heads[name] | {"kernel": each.kernel, "launch": each.place}
        rows.append({**head, **outcome, "declared_bytes": declared[name]})
    return _with_declared(rows)


def _head(job: Job, session: Session, item: PreparedPass, frame: int) -> Row:
    return {
        "technique": job.technique,
        "variant": job.variant,
        "layout": job.layout or "",
        "scene": session.world.scene.name,
        "profile": job.profile.name,
        "pass": item.name,
        "frame": frame,
    }


def _with_declared(rows: list[Row]) -> list[Row]:
    """Bytes of DRAM behind the shown cache over what the pass declares, all its launches
    together.
    """
    key = f"dram_bytes_{told.SHOWN_CACHE >> 10}k"
    for row in rows:
        same = [other for other in rows if other["pass"] == row["pass"]]
        if row.get("declared_bytes") and all(other["status"] == "ok" for other in same):
            moved = sum(other[key] for other in same)
            row["dram_over_declared"] = moved / row["declared_bytes"]
    return rows


def _verdict(rows: Sequence[Row], folder: Path) -> GibenchError | None:
    failed = [row for row in rows if row["status"] == "failed"]
    if failed:
        return CheckFailed(str(failed[0]["reason"]), mend=f"the others are in {folder}")
    if not any(row["status"] == "ok" for row in rows):
        reason = str(rows[0]["reason"]) if rows else "nothing was launched"
        return CannotRun(reason)
    return None
