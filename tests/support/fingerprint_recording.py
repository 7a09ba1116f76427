"""Recording of fingerprints (see ``fingerprints.py``): what a checkout computes, had through its
command line.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from PIL import Image

Array = npt.NDArray[Any]
Figures = dict[str, "float | str | None"]

FORMAT = 1
FIGURES = ("bytes", "flops", "rays")
SEED = "5"
SMALL = ("--receivers", "2000", "--probes", "8", "--resolution", "160x90", "--seed", SEED)
FRAMES = ("--frames", "8", "--warmup", "24")
# Surfels cover the picture in few frames, so that their sums and lists are long enough to tell.
DENSE = ("--set", "gibs.placement_chance=0.8")
# Settings that older checkouts have under another name: where it is, what it was.
RENAMED = {"srp.probe_update=half": "srp.probe_update_fraction=0.5"}
VARIANTS = ("--variant", "published", "--variant", "tuned")
ENVIRONMENT = ("LD_PRELOAD", "POCL_AFFINITY", "POCL_WORK_GROUP_METHOD", "OCL_ICD_VENDORS")
# In a bake's cache, what tells of the making and not of the made.
NOT_CONTENT = {"key", "seconds", "ray_seconds"}


@dataclass(frozen=True)
class Job:
    """One command line whose result is recorded.

    Attributes:
        name: of the scenario; items are keyed by it.
        kind: run, quality or bake.
        threads: POCL_MAX_PTHREAD_COUNT.
        arguments: of ``gibench KIND``.
        quick: part of a quick recording.
        own_cache: a cache folder of its own, so that it is baked anew.
    """

    name: str
    kind: str
    threads: int
    arguments: tuple[str, ...]
    quick: bool = True
    own_cache: bool = False


def each(option: str, *values: str) -> tuple[str, ...]:
    """``option`` repeated for every value."""
    return tuple(word for value in values for word in (option, value))


def jobs() -> list[Job]:
    """All that a full recording runs."""
    every = each("-t", "srp", "gibs", "ddgi", "direct")
    indirect = each("-t", "srp", "gibs", "ddgi")
    moving = each("-t", "gibs", "ddgi", "direct")
    orders = each("--sh-order", "2", "7")
    sizes = each("-w", "64", "256")
    grid = (*every, *VARIANTS, *orders, *sizes, *SMALL, *FRAMES, *DENSE)
    truth = (*indirect, *VARIANTS, "-w", "64", *SMALL, "--sh-order", "2", "--frames", "64")
    truth = (*truth, "--reference-paths", "64", "--target-error", "0.5", *DENSE)
    bake = ("-t", "srp", "--receivers", "2000", "--probes", "8", "--seed", SEED)
    listed = [
        Job(f"bake SH {order}, {n} threads", "bake", n, (*bake, "--sh-order", order), n == 1, True)
        for n in (1, 2)
        for order in ("2", "7")
    ]
    listed += [Job(f"box, {n} threads", "run", n, grid, n == 1) for n in (1, 2)]
    listed += [Job(f"quality, {n} threads", "quality", n, truth, n == 1) for n in (1, 2)]
    hall = ("--scene", "hall", "--motion", "scene", "-w", "64", *SMALL, *FRAMES, *DENSE)
    flight = ("--camera-path", "flight", "--rest-frames", "20", "--flight-frames", "60")
    listed += [
        Job("hall, motion", "run", 1, (*moving, *hall)),
        Job("box, flight", "run", 1, (*every, *flight, "-w", "64", *SMALL, *FRAMES, *DENSE), False),
    ]
    settings = {
        "A": ("srp.storage=fp32", "ddgi.storage=fp32", "gibs.grid=perspective"),
        "B": ("srp.storage=snorm16", "ddgi.relocation=false", "gibs.estimator=multi-scale"),
        "C": (
            *("srp.bounces=false", "srp.probe_update=half", "ddgi.classification=false"),
            *("gibs.ray_guiding=true", "gibs.depth_moments=false"),
        ),
        "D": (
            *("srp.interpolation=visibility", "ddgi.scrolling=true", "ddgi.counts=4x4x4"),
            *("gibs.grid=perspective", "gibs.estimator=multi-scale"),
        ),
    }
    for name, values in settings.items():
        arguments = (*indirect, *VARIANTS, "--sh-order", "2", "-w", "64", *SMALL, *FRAMES)
        arguments = (*arguments, *DENSE, *each("--set", *values))
        if name == "D":
            arguments = (*arguments, *flight)
        listed.append(Job(f"settings {name}", "run", 1, arguments, name in "AB"))
    return listed


@dataclass
class Recording:
    """What was found.

    Attributes:
        about: revision, device and environment.
        arrays: by item, kept in the ``.npz``: pictures and receivers.
        passes: by configuration, then pass: bytes, flops, rays.
        frames: by configuration: the sums, and what ``frames.csv`` says of memory and status.
        bakes: by scenario, arrays of the cache as (name, shape, type, SHA-256, key in the npz).
        failures: scenarios that did not run, and what was said.
        seconds: by scenario.
    """

    about: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, Array] = field(default_factory=dict)
    passes: dict[str, dict[str, Figures]] = field(default_factory=dict)
    frames: dict[str, Figures] = field(default_factory=dict)
    bakes: dict[str, list[list[str]]] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Write the ``.json`` and the ``.npz`` beside it."""
        names = {name: f"a{number}" for number, name in enumerate(self.arrays)}
        content: dict[str, Any] = {names[name]: values for name, values in self.arrays.items()}
        np.savez_compressed(path.with_suffix(".npz"), allow_pickle=False, **content)
        plain: dict[str, Any] = {"format": FORMAT, **self.__dict__}
        plain["arrays"] = {
            name: {"held": names[name], "sha256": digest(values)}
            for name, values in self.arrays.items()
        }
        path.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")

    @staticmethod
    def load(path: Path) -> Recording:
        """Read what :meth:`save` wrote."""
        plain = json.loads(path.read_text(encoding="utf-8"))
        if plain.pop("format") != FORMAT:
            raise SystemExit(f"{path}: of another format; record it again")
        with np.load(path.with_suffix(".npz"), allow_pickle=False) as held:
            plain["arrays"] = {n: held[item["held"]] for n, item in plain["arrays"].items()}
        return Recording(**plain)


def digest(values: Array) -> str:
    """SHA-256 of an array's type, shape and content."""
    head = f"{values.dtype.str} {values.shape} ".encode()
    return hashlib.sha256(head + np.ascontiguousarray(values).tobytes()).hexdigest()


def record(root: Path, python: Path, out: Path, quick: bool, only: str | None) -> int:
    """Run every scenario and write what came out; 1 if one did not run."""
    found = Recording(about={"root": str(root), "quick": quick, "python": str(python)})
    with tempfile.TemporaryDirectory(prefix="fingerprints-") as temporary:
        work = Path(temporary)
        for number, job in enumerate(jobs()):
            if (quick and not job.quick) or (only is not None and not re.search(only, job.name)):
                continue
            folder = work / f"{number}"
            cache = work / ("cache" if not job.own_cache else f"cache-{number}")
            started = time.monotonic()
            said = gibench(root, python, work, job, folder, cache)
            if said is not None:
                found.failures[job.name] = said
            elif job.kind == "run":
                read_run(found, job.name, folder)
            elif job.kind == "quality":
                read_quality(found, job.name, folder)
            else:
                read_bake(found, job.name, cache)
            found.seconds[job.name] = round(time.monotonic() - started, 1)
            print(f"{job.name}: {found.seconds[job.name]} s{' FAILED' if said else ''}", flush=True)
    out.parent.mkdir(parents=True, exist_ok=True)
    found.save(out)
    for name, said in found.failures.items():
        print(f"{name}: {said}", file=sys.stderr)
    return 1 if found.failures else 0


def known(root: Path, argument: str) -> str:
    """``argument``, or what a checkout of before its setting was renamed takes instead."""
    if argument not in RENAMED:
        return argument
    technique, name = argument.split("=")[0].split(".")
    written = (root / "gibench" / "techniques" / technique).rglob("*.py")
    there = any(re.search(rf"^    {name}: ", path.read_text(), re.MULTILINE) for path in written)
    return argument if there else RENAMED[argument]


def gibench(
    root: Path, python: Path, work: Path, job: Job, folder: Path, cache: Path
) -> str | None:
    """Run one job; what it said if it failed."""
    home = work / "home"
    home.mkdir(exist_ok=True)
    kernels = Path.home() / ".cache" / "pocl" / "kcache"
    environment = {
        "POCL_CACHE_DIR": str(kernels),
        **os.environ,
        "POCL_MAX_PTHREAD_COUNT": str(job.threads),
        "PYTHONPATH": str(root),
        "HOME": str(home),
        "XDG_CACHE_HOME": str(home / "cache"),
        "COLUMNS": "200",
        "NO_COLOR": "1",
    }
    arguments = [known(root, argument) for argument in job.arguments]
    command = [str(python), "-m", "gibench", job.kind, *arguments, "--cache-dir", str(cache)]
    if job.kind != "bake":
        command += ["--out", str(folder)]
    if job.kind == "run":
        command.append("--save-images")
    done = subprocess.run(
        [*command, "-q"], cwd=home, env=environment, capture_output=True, text=True, check=False
    )
    return None if done.returncode == 0 else f"exit {done.returncode}: {done.stderr.strip()[-600:]}"


def read_run(found: Recording, scenario: str, folder: Path) -> None:
    """Pictures, passes and frames of a run folder."""
    about_machine(found, json.loads((folder / "run.json").read_text(encoding="utf-8")))
    frames = pd.read_csv(folder / "frames.csv")
    labels = {row["configuration"]: label(scenario, row) for row in frames.to_dict("records")}
    for row in frames.to_dict("records"):
        kept = ("memory_bytes", "probes", "receivers", "frames", "warmup", "status", "reason")
        found.frames[labels[row["configuration"]]] = {name: plain(row.get(name)) for name in kept}
    passes = pd.read_csv(folder / "passes.csv")
    for row in passes.to_dict("records"):
        figures = {name: plain(row.get(name)) for name in (*FIGURES, "status", "reason")}
        found.passes.setdefault(labels[row["configuration"]], {})[str(row["pass"])] = figures
    for name, items in found.passes.items():
        for figure in FIGURES:
            values = [item[figure] for item in items.values()]
            total = sum(float(value) for value in values if value is not None)
            found.frames.setdefault(name, {})[f"sum of {figure}"] = total
    for path in sorted((folder / "images").rglob("*.png")):
        number = re.match(r"\d+", path.relative_to(folder / "images").parts[0])
        configuration = int(number[0]) if number else int(frames["configuration"].iloc[0])
        with Image.open(path) as image:
            found.arrays[f"{labels[configuration]}: {path.stem}.png"] = np.asarray(image)


def label(scenario: str, row: dict[Any, Any]) -> str:
    """What tells a configuration from the others of its scenario."""
    words = [str(row["technique"]), str(row["variant"]), f"w{row['workgroup_size']}"]
    order = plain(row.get("sh_order"))
    if order is not None:
        words.append(f"SH {int(float(order))}")
    return f"{scenario}: {' '.join(words)}"


def plain(value: Any) -> float | str | None:
    """A table's cell for JSON; nothing for an empty one."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return None
    return value if isinstance(value, str) else float(value)


def about_machine(found: Recording, run: dict[str, Any]) -> None:
    """Device, versions and revision, from the first run."""
    if "device" in found.about:
        return
    device = run.get("device") or {}
    found.about["device"] = {n: device.get(n) for n in ("name", "platform_version", "driver")}
    found.about["versions"] = run.get("versions")
    found.about["variables"] = {n: os.environ[n] for n in ENVIRONMENT if n in os.environ}


def read_quality(found: Recording, scenario: str, folder: Path) -> None:
    """The arrays of ``receivers.npz``."""
    with np.load(folder / "receivers.npz", allow_pickle=False) as held:
        for name in held.files:
            if held[name].dtype.kind in "fiub":
                found.arrays[f"{scenario}: {name}"] = held[name]


def read_bake(found: Recording, scenario: str, cache: Path) -> None:
    """Every array of every file of the cache."""
    listed = found.bakes.setdefault(scenario, [])
    for path in sorted(cache.rglob("*")):
        if not path.is_file():
            continue
        for name, values in arrays_in(path.read_bytes()):
            if name in NOT_CONTENT:
                continue
            held = f"{scenario}: {name} {values.dtype} {values.shape} #{len(listed)}"
            listed.append([name, str(values.shape), values.dtype.str, digest(values), held])
            found.arrays[held] = values


def arrays_in(content: bytes) -> Iterator[tuple[str, Array]]:
    """Arrays in an ``.npz``, whatever precedes it, or an ``.npy``; none in any other file."""
    if content.startswith(b"\x93NUMPY"):
        yield "npy", np.load(io.BytesIO(content), allow_pickle=False)
        return
    start = content.find(b"PK\x03\x04", 0, 4096)
    if start < 0 or not zipfile.is_zipfile(io.BytesIO(content[start:])):
        return
    with np.load(io.BytesIO(content[start:]), allow_pickle=False) as held:
        for name in held.files:
            yield name, held[name]
