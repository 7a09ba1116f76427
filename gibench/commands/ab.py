"""``gibench ab``, and :func:`gibench.ab`."""

from __future__ import annotations

import os
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.device.selection import first_device, list_devices
from gibench.errors import BadInput, CheckFailed, GibenchError, printable
from gibench.measure.compare import ab as checks
from gibench.measure.compare.ab import AbOptions, AbResult
from gibench.measure.compare.kernel_trees import kernel_tree
from gibench.measure.compare.lockstep import SideFailed
from gibench.measure.compare.paired import alarmed, undecided
from gibench.measure.compare.replicate import Place
from gibench.measure.machine.environment import device_record, environment, versions
from gibench.measure.plan.stopping import Patience
from gibench.progress import progress
from gibench.report.comparison import Comparison, Row
from gibench.scene.load import is_file
from gibench.scene.model import Scene
from gibench.techniques.job import Job


@within_bounds
def ab(
    old: str,
    new: str = ".",
    scene: str = "cornell-box",
    technique: str = "srp",
    variant: str = "tuned",
    layout: str | None = None,
    device_profile: str = "iphone7",
    sh_order: int | None = None,
    probes: int | None = None,
    receivers: int | None = None,
    workgroup_size: int | None = None,
    settings: asked.SettingsAsked = None,
    resolution: str = "320x180",
    threshold: str = "5%",
    replicates: int | None = None,
    seconds: float = 100.0,
    frames: int = 24,
    warmup_frames: int = 1000,
    warmup_seconds: float = 30.0,
    seed: int = 0,
    cache_dir: str | Path | None = None,
) -> Comparison:
    """Time one kernel tree against another, as ``gibench ab`` does; its help says what everything
    is. It runs on PoCL, or on the device that PYOPENCL_CTX names.

    Raises:
        BadInput: an input is wrong, or the baseline does not run.
        GibenchError: the new tree does not run.
    """
    (job,) = asked.jobs_of(locals())
    started = datetime.now(UTC)
    limit = asked.percentage(threshold)
    cache = asked.cache_folder(cache_dir)
    device = first_device()
    place = Place(str(cache), device=list_devices().index(device))
    where = _scene_in_words(job, checks.bake_once(job, cache))
    how = AbOptions(
        limit,
        replicates,
        seconds=seconds,
        frames=frames,
        patience=Patience(warmup_frames, warmup_seconds),
        seed=seed,
    )
    with tempfile.TemporaryDirectory() as folder:
        first, second = (kernel_tree(name, Path(folder)) for name in (old, new))
        try:
            with progress(f"{old} against {new}", replicates or how.most) as advance:
                result = checks.check(job, place, first, second, how, advance)
        except SideFailed as error:
            if error.side == "OLD":
                raise BadInput(
                    f"the baseline does not run: {error}",
                    mend="nothing was compared; give a baseline that this gibench can run",
                ) from error
            raise GibenchError(f"{error}; nothing was compared") from error
    slower = alarmed(result.judged)
    image = f"{job.shot.width} x {job.shot.height}"
    failed = CheckFailed(f"slower by more than {threshold}: {', '.join(slower)}")
    title = f"gibench ab: {technique} ({_shape(job)}) on {where}, {image}"
    return Comparison(
        title=title,
        rows=_rows(result),
        remarks=_remarks(result, limit),
        facts={
            "schema_version": 1,
            "kind": "ab",
            "title": title,
            "old": {"name": result.old.name, "kernels": result.old.content_hash},
            "new": {"name": result.new.name, "kernels": result.new.content_hash},
            "threshold": limit,
            "slower": slower,
            "seconds": round(result.seconds, 1),
            "warmup": result.warmup,
            "rest": result.rest,
            "measured": _measured(device, started),
            "log_ratios": result.log_ratios,
            "output_difference": result.output_difference,
        },
        error=failed if slower else None,
    )


def _scene_in_words(job: Job, scene: Scene) -> str:
    """A built-in scene's name; a file's with what is in it, as others may have its name: what is
    compared, and a history's series, goes by it.
    """
    if not is_file(job.scene):
        return job.scene
    return f"{printable(Path(job.scene).name)} ({scene.content_hash()[:8]})"


def _shape(job: Job) -> str:
    return " ".join(filter(None, (job.variant, job.layout)))


def _measured(device: Any, started: datetime) -> dict[str, Any]:
    """When and on what, for 'gibench history'."""
    record = device_record(device)
    return {
        "started_utc": started.strftime("%Y-%m-%d %H:%M:%S"),
        "environment": environment(),
        "versions": versions(),
        "device": f"{record['platform']} {record['driver']} on {record['name']}",
    }


def _rows(result: AbResult) -> list[Row]:
    return [
        Row("", name, result.old_ms[name], result.new_ms[name], judged)
        for name, judged in result.judged.items()
    ]


def _remarks(result: AbResult, limit: float) -> list[str]:
    pairs = max(len(values) for values in result.log_ratios.values())
    remarks = [
        f"{pairs} pairs of fresh processes in {result.seconds:.0f} s, frame by frame in turns; "
        f"threshold {100 * limit:.3g} %. frame: wall time; passes: device time. Old: "
        f"{result.old.name} ({result.old.content_hash[:12]}), new: {result.new.name} "
        f"({result.new.content_hash[:12]})."
    ]
    if (load := os.getloadavg()[0]) > 1.5 * (os.cpu_count() or 1):
        remarks.append(
            f"The machine is busy (load {load:.1f} on {os.cpu_count()} threads): intervals are "
            "wide and a slowdown may be missed."
        )
    if result.rest:
        remarks.append(f"Timed before it was itself: {result.rest} (--warmup-frames).")
    elif result.warmup > AbOptions.warmup:
        remarks.append(f"Each process was at rest before it was timed, {result.warmup} frames on.")
    if result.old.content_hash == result.new.content_hash:
        remarks.append("Old and new are the same kernels.")
    if rows := undecided(result.judged):
        remarks.append(
            f"Ambiguous: {', '.join(rows)}. More replicates may tell (--replicates "
            f"{2 * max(pairs, 12)})."
        )
    moved = {name: by for name, by in result.output_difference.items() if not by <= 1e-6}
    if moved:
        told = ", ".join(f"{name} by {by:.2g}" for name, by in moved.items())
        remarks.append(f"What they compute differs (relative root mean square): {told}.")
    return remarks
