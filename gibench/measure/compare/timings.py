"""What can be compared: run folders of gibench and files of pytest-benchmark."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gibench.device import SIMT
from gibench.errors import BadInput
from gibench.measure.compare.lockstep import FRAME
from gibench.measure.compare.recorded import RowKey, Timings
from gibench.measure.runfolder.axes import plain_settings, recorded_axes
from gibench.measure.runfolder.folder import RECORD
from gibench.measure.runfolder.stored_run import StoredRun, read_run
from gibench.techniques.camera_path import REST
from gibench.techniques.object_motion import SCENE
from gibench.techniques.registry import axis_title, declared_counts, techniques

_MEND = "give a run's folder, a folder of such folders, or a JSON file of pytest-benchmark"


def read_timings(path: Path, name: str) -> Timings:
    """The times beneath ``path``: a run's folder, a JSON file of pytest-benchmark, or a folder that
    holds several of one kind, each of them one process.

    Args:
        path: where.
        name: of the side, for messages.

    Raises:
        BadInput: nothing is there, something is damaged, or the processes do not belong together.
    """
    if not path.exists():
        raise BadInput(f"{name} is missing", where=path, mend=_MEND)
    sources = _sources(path)
    if not sources:
        raise BadInput(f"{name} holds nothing to compare", where=path, mend=_MEND)
    timings: Timings | None = None
    for source in sources:
        one = _of_benchmark(source, name) if source.is_file() else _of_run(read_run(source), name)
        if timings is None:
            timings = one
            continue
        if one.identity != timings.identity:
            raise BadInput(f"{name}: its processes are of different runs", where=source, mend=_MEND)
        for key, times in one.rows.items():
            timings.rows.setdefault(key, []).extend(times)
        timings.failed |= one.failed
        timings.add_versions(one.versions)
    assert timings is not None
    return timings


def _sources(path: Path) -> list[Path]:
    if path.is_file() or (path / RECORD).exists():
        return [path]
    runs = sorted(one.parent for one in path.glob(f"*/{RECORD}"))
    return runs or sorted(path.glob("*.json"))


def _of_run(run: StoredRun, name: str) -> Timings:
    record = run.record
    timings = Timings(name, _identity(record), versions=_versions(record))
    by_pass = run.samples.groupby(["configuration", "pass"], sort=False)["time_ms"]
    by_frame = run.samples.groupby(["configuration", "frame"], sort=False)["frame_wall_ms"].first()
    for entry in record["configurations"]:
        label, number = configuration_label(entry, record), entry["configuration"]
        passes = {item["pass"]: item for item in entry["passes"]}
        whole = entry["frames"] > 0 and all(item["status"] == "ok" for item in passes.values())
        if whole:
            timings.rows[label, FRAME] = [by_frame.loc[number].to_numpy(np.float64)]
        else:
            timings.failed[label, FRAME] = entry["reason"] or entry["status"]
        for title, item in passes.items():
            if (number, title) in by_pass.groups and item["status"] == "ok":
                times = by_pass.get_group((number, title)).to_numpy(np.float64)
                timings.rows[label, title] = [times]
            else:
                timings.failed[label, title] = item["reason"] or item["status"]
    return timings


def configuration_label(entry: Mapping[str, Any], record: Mapping[str, Any]) -> str:
    """A configuration of ``run.json`` in words that tell it from every other."""
    # Only of simt, so that runs from before there were layouts keep their names: they are wide.
    variant = f"{entry['variant']}{' simt' if entry.get('layout') == SIMT else ''}"
    parts = [f"{entry['technique']} ({variant}) on {entry['scene']}"]
    parts.append(f"profile {entry['profile']}")
    parts += [
        f"{axis_title(name)} {entry[name]}"
        for name in recorded_axes(record)
        if entry.get(name) is not None
    ]
    # Not those in whose number chance has a part, such as the surfels alive at the end.
    counts = {**entry, **entry.get("counts", {})}
    sizes = {name: counts.get(of) for name, of in declared_counts().items()}
    sizes["receivers"] = entry.get("receivers")
    parts += [f"{size:,} {name}" for name, size in sizes.items() if size]
    auto = entry.get("auto_workgroup")
    parts.append("work-group auto" if auto else f"work-group {entry['workgroup_size']}")
    return ", ".join(parts)


def _versions(record: Mapping[str, Any]) -> dict[str, str]:
    found = {**record.get("versions", {}), "python": record["environment"].get("python")}
    return {name: str(version) for name, version in found.items() if version is not None}


def _identity(record: Mapping[str, Any]) -> dict[str, Any]:
    environment, device = record["environment"], record["device"]
    identity: dict[str, Any] = {
        "processor": environment.get("cpu"),
        "usable threads": environment.get("usable_threads"),
        "OpenCL device": device.get("name"),
        "OpenCL platform": device.get("platform"),
        "OpenCL driver": device.get("driver"),
        "OpenCL variables": environment.get("variables"),
        "image size": record.get("image"),
        "seed": record["seed"],
        "camera's flight": _flight(record),
        "objects' motion": _motion(record),
        "caches emptied before frames": bool(record.get("cold")),
    }
    for profile in record["profiles"]:
        identity[f"profile {profile['name']}"] = profile.get("content_hash")
    for scene in record.get("scenes", ()):
        identity[f"scene {scene['name']}"] = scene["content_hash"]
    for entry in record["configurations"]:
        label = configuration_label(entry, record)
        identity[f"settings of {label}"] = _settings(entry)
        identity[f"camera of {label}"] = entry.get("camera")
    return identity


def _settings(entry: Mapping[str, Any]) -> dict[str, Any]:
    """The technique's settings; those from before a setting was there have its default."""
    settings: dict[str, Any] = entry.get("settings") or {}
    spec = techniques().get(entry["technique"])
    return {**plain_settings(spec.settings_type()), **settings} if spec else settings


def _flight(record: Mapping[str, Any]) -> Any:
    """None where the camera rests, as it does in every run from before there were flights."""
    flight = record.get("flight") or {"path": REST}
    return None if flight["path"] == REST else flight


def _motion(record: Mapping[str, Any]) -> Any:
    """None where objects rest, as they do in every run from before any moved."""
    motion = record.get("motion") or {"path": REST}
    if motion["path"] == REST:
        return None
    described = {scene["name"]: scene.get("motions_hash") for scene in record.get("scenes", ())}
    return motion if motion["path"] != SCENE else {**motion, "scenes": described}


def _of_benchmark(file: Path, name: str) -> Timings:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        machine, benchmarks = content["machine_info"], content["benchmarks"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{name} is no JSON file of pytest-benchmark", where=file) from error
    processor = machine.get("cpu", {})
    identity = {
        "processor": processor.get("brand_raw") or processor.get("brand"),
        "processors": processor.get("count"),
        "system": machine.get("system"),
        "architecture": machine.get("machine"),
    }
    rows: dict[RowKey, list[Any]] = {}
    for one in benchmarks:
        data = one.get("stats", {}).get("data")
        if not data:
            raise BadInput(
                f"{name}: '{one.get('fullname')}' holds no samples",
                where=file,
                mend="save it with --benchmark-json FILE or with --benchmark-save-data",
            )
        rows["", str(one["fullname"])] = [np.asarray(data, np.float64) * 1e3]
        if one.get("extra_info"):
            identity[f"extra_info of {one['fullname']}"] = one["extra_info"]
    told = {
        "python": machine.get("python_version"),
        "git": (content.get("commit_info") or {}).get("id"),
    }
    versions = {what: str(version) for what, version in told.items() if version}
    return Timings(name, identity, rows, versions=versions)
