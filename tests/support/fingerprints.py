"""Fingerprints of what must not change while the house is rebuilt.

Everything is had through the command line, ``PYTHON -m gibench`` with ``PYTHONPATH`` at a checkout,
and from the files that it leaves: any revision can be recorded, whatever its modules are called::

    python fingerprints.py record --root CHECKOUT --python PYTHON OUT.json [--quick]
    python fingerprints.py compare BEFORE.json AFTER.json [--self SECOND_BEFORE.json ...]

``record`` leaves ``OUT.json`` with hashes and figures, and the arrays beside it in ``OUT.npz``:

* pictures: the pixels of every image of ``gibench run --save-images``, by run, technique, variant,
  work-group size and SH order;
* passes: bytes, flops and rays of each, and their sums over a frame's passes;
* receivers: the arrays of ``gibench quality``'s ``receivers.npz``, the reference among them;
* bakes: every array in every file of a bake's cache, whatever the files are called.

``compare`` prints a Markdown table of what differs (``--all``: of everything) and exits 1 if
anything differs by more than the 'before' revision differs from itself: with ``--self``, by more
than ``--slack`` times as much, in the largest and in the mean difference; without, at all. Passes
that came or went are listed apart and are no failure, nor are the figures of the passes beside them
while the frame's sum stays.

Needs NumPy, pandas and Pillow. Hashes hold for one processor and one OpenCL compiler.
"""

from __future__ import annotations

import argparse
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
from collections import defaultdict
from collections.abc import Iterator, Sequence
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
            *("srp.bounces=false", "srp.probe_update_fraction=0.5", "ddgi.classification=false"),
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


# Recording


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
    command = [str(python), "-m", "gibench", job.kind, *job.arguments, "--cache-dir", str(cache)]
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


# Comparing


@dataclass(frozen=True)
class Distance:
    """How far one thing is from another.

    Attributes:
        largest: of the absolute differences; infinite where shapes or texts differ.
        mean: of the absolute differences.
        relative: the largest difference over the value before, or over a thousandth of the largest
            value before, where that is more.
    """

    largest: float
    mean: float
    relative: float

    @property
    def same(self) -> bool:
        """Bit for bit."""
        return self.largest == 0.0

    def within(self, selves: Sequence[Distance], slack: float) -> bool:
        """No more than ``slack`` times the most of ``selves``, all in all."""
        if self.same:
            return True
        if not selves or not np.isfinite(self.largest):
            return False
        largest, mean = max(one.largest for one in selves), max(one.mean for one in selves)
        return self.largest <= slack * largest and self.mean <= slack * mean

    def __str__(self) -> str:
        if self.same:
            return "same"
        if not np.isfinite(self.largest):
            return "differs in shape, type or text"
        return f"differs by {self.largest:.3g} / {self.relative:.3g}"


NOWHERE_NEAR = Distance(np.inf, np.inf, np.inf)
SAME = Distance(0.0, 0.0, 0.0)


def distance(before: Array, after: Array) -> Distance:
    """Between arrays."""
    if digest(before) == digest(after):
        return SAME
    if (
        before.shape != after.shape
        or before.dtype != after.dtype
        or before.dtype.kind not in "fiub"
    ):
        return NOWHERE_NEAR
    old, new = (values.astype(np.float64) for values in (before, after))
    if not np.array_equal(np.isfinite(old), np.isfinite(new)):
        return NOWHERE_NEAR
    old, new = (values[np.isfinite(values)] for values in (old, new))
    apart = np.abs(old - new)
    # Same to the last figure and yet another hash: -0 for 0, or another NaN; told, as tiny.
    largest = max(float(apart.max(initial=0.0)), np.finfo(np.float64).tiny)
    floor = max(1e-3 * float(np.abs(old).max(initial=0.0)), np.finfo(np.float64).tiny)
    relative = float((apart / np.maximum(np.abs(old), floor)).max(initial=0.0))
    return Distance(largest, float(apart.mean()) if apart.size else 0.0, relative)


def figure_distance(before: float | str | None, after: float | str | None) -> Distance:
    """Between figures or texts."""
    if before == after:
        return SAME
    if isinstance(before, (int, float)) and isinstance(after, (int, float)):
        apart = abs(before - after)
        return Distance(apart, apart, apart / max(abs(before), np.finfo(np.float64).tiny))
    return NOWHERE_NEAR


@dataclass(frozen=True)
class Row:
    """One thing compared."""

    what: str
    before: str
    after: str
    apart: Distance
    selves: tuple[Distance, ...]
    verdict: str

    def __str__(self) -> str:
        own = max(self.selves, key=lambda one: one.largest, default=None)
        cells = (self.what, self.before, self.after, str(self.apart), own or "", self.verdict)
        return "| " + " | ".join(str(cell) for cell in cells) + " |"


class Comparison:
    """Rows, and what is told beside them."""

    def __init__(self, before: Recording, after: Recording, second: list[Recording], slack: float):
        self.before, self.after, self.second, self.slack = before, after, second, slack
        self.rows: list[Row] = []
        self.passes_changed: list[str] = []
        self.notes: list[str] = []

    def everything(self) -> None:
        """Compare all that both tried; what only one tried is a note."""
        tried = [set(one.seconds) for one in (self.before, self.after)]
        for name in sorted(tried[0] ^ tried[1]):
            self.notes.append(f"only recorded {'before' if name in tried[0] else 'after'}: {name}")
        self.both = tried[0] & tried[1]
        for key in ("device", "variables"):
            old, new = self.before.about.get(key), self.after.about.get(key)
            if old != new:
                self.notes.append(f"another {key}: {old} before, {new} after")
        for name in sorted(self.both):
            old, new = (one.failures.get(name) for one in (self.before, self.after))
            if old or new:
                apart = SAME if old and new else NOWHERE_NEAR
                cells = ("failed" if old else "ran", "failed" if new else "ran")
                self.add(f"{name}: runs", *cells, apart, ())
        self.arrays()
        self.figures()
        self.bakes()

    def add(
        self,
        what: str,
        before: str,
        after: str,
        apart: Distance,
        selves: Sequence[Distance],
        excused: str | None = None,
    ) -> None:
        """One row with its verdict."""
        if apart.same:
            verdict = "same"
        elif apart.within(selves, self.slack):
            verdict = "within its own"
        else:
            verdict = excused or "DIFFERS"
        self.rows.append(Row(what, before, after, apart, tuple(selves), verdict))

    def shared(self, name: str) -> bool:
        """Whether both recordings tried the scenario that an item is of."""
        return name.split(": ")[0] in self.both

    def arrays(self) -> None:
        """Pictures and receivers."""
        both = (self.before, self.after)
        baked = {item[4] for one in both for items in one.bakes.values() for item in items}
        names = {**self.before.arrays, **self.after.arrays}
        for name in (n for n in names if n not in baked and self.shared(n)):
            old, new = self.before.arrays.get(name), self.after.arrays.get(name)
            apart = NOWHERE_NEAR if old is None or new is None else distance(old, new)
            selves = [
                distance(old, one.arrays[name])
                for one in self.second
                if old is not None and name in one.arrays
            ]
            self.add(name, short(old), short(new), apart, selves)

    def figures(self) -> None:
        """Frames' sums and passes."""
        for name in (n for n in {**self.before.frames, **self.after.frames} if self.shared(n)):
            old, new = self.before.frames.get(name, {}), self.after.frames.get(name, {})
            for figure in {**old, **new}:
                what = f"{name}: {figure}"
                selves = self.own(lambda one, n=name: one.frames.get(n), old, figure)
                self.figure(what, old.get(figure), new.get(figure), selves)
        for name in (n for n in {**self.before.passes, **self.after.passes} if self.shared(n)):
            passes = self.before.passes.get(name, {}), self.after.passes.get(name, {})
            gone, come = (sorted(set(passes[i]) - set(passes[1 - i])) for i in (0, 1))
            if gone or come:
                told = f"gone: {', '.join(gone) or 'none'}; new: {', '.join(come) or 'none'}"
                self.passes_changed.append(f"{name}: {told}")
            for one in (n for n in passes[0] if n in passes[1]):
                for figure in passes[0][one]:
                    selves = self.own(
                        lambda r, n=name, p=one: r.passes.get(n, {}).get(p), passes[0][one], figure
                    )
                    old_value, new_value = (p[one].get(figure) for p in passes)
                    excused = None
                    if (gone or come) and self.sum_stays(name, figure):
                        excused = "moved to another pass"
                    what = f"{name}: {one}: {figure}"
                    self.figure(what, old_value, new_value, selves, excused)

    def sum_stays(self, name: str, figure: str) -> bool:
        """Whether a configuration's passes have in all what they had."""
        key = f"sum of {figure}"
        old, new = (one.frames.get(name, {}).get(key) for one in (self.before, self.after))
        return old is not None and old == new

    def own(self, of: Any, old: Figures, figure: str) -> list[Distance]:
        """How far the second recordings' figure is from the first's."""
        others = [of(one) for one in self.second]
        return [
            figure_distance(old.get(figure), one.get(figure)) for one in others if one is not None
        ]

    def figure(
        self,
        what: str,
        old: float | str | None,
        new: float | str | None,
        selves: list[Distance],
        excused: str | None = None,
    ) -> None:
        """A row of a figure."""
        self.add(what, shown(old), shown(new), figure_distance(old, new), selves, excused)

    def bakes(self) -> None:
        """Multisets of arrays; those without a twin are paired by name, shape and type."""
        for scenario in sorted(set(self.before.bakes) | set(self.after.bakes)):
            if scenario not in self.both:
                continue
            pairs = paired(self.before.bakes.get(scenario, []), self.after.bakes.get(scenario, []))
            others = [
                (one, dict(own_pairs(self.before.bakes.get(scenario, []), one.bakes[scenario])))
                for one in self.second
                if scenario in one.bakes
            ]
            for old, new in pairs:
                if old is None or new is None:
                    item = old or new
                    assert item is not None
                    cells = ("" if old is None else old[3][:10], "" if new is None else new[3][:10])
                    what = f"{scenario}: {item[0]} {item[1]} {item[2]}"
                    self.add(what, *cells, NOWHERE_NEAR, ())
                    continue
                apart = distance(self.before.arrays[old[4]], self.after.arrays[new[4]])
                selves = [
                    distance(self.before.arrays[old[4]], one.arrays[twins[old[4]]])
                    for one, twins in others
                    if old[4] in twins
                ]
                self.add(old[4], old[3][:10], new[3][:10], apart, selves)

    def failed(self) -> bool:
        """Whether anything differs that should not."""
        return any(row.verdict == "DIFFERS" for row in self.rows)

    def told(self, everything: bool) -> str:
        """The table, then what came and went, then counts."""
        rows = [row for row in self.rows if everything or row.verdict != "same"]
        lines = [
            "| what | before | after | max abs / max rel | before, again | verdict |",
            "|---|---|---|---|---|---|",
            *(str(row) for row in rows),
            "",
        ]
        if self.passes_changed:
            lines += ["Pass set changed:", "", *(f"- {one}" for one in self.passes_changed), ""]
        if self.notes:
            lines += ["Notes:", "", *(f"- {note}" for note in self.notes), ""]
        counts: dict[str, int] = defaultdict(int)
        for row in self.rows:
            counts[row.verdict] += 1
        lines.append(", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items())))
        return "\n".join(lines)


def paired(
    before: list[list[str]], after: list[list[str]]
) -> list[tuple[list[str] | None, list[str] | None]]:
    """Equal arrays with equal, the rest in order by name, shape and type, then those left over."""
    pairs: list[tuple[list[str] | None, list[str] | None]] = []
    for length in (4, 3):
        waiting: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
        for item in after:
            waiting[tuple(item[:length])].append(item)
        left = []
        for item in before:
            twins = waiting[tuple(item[:length])]
            if twins:
                pairs.append((item, twins.pop(0)))
            else:
                left.append(item)
        before, after = left, [item for items in waiting.values() for item in items]
    return [*pairs, *((item, None) for item in before), *((None, item) for item in after)]


def own_pairs(before: list[list[str]], second: list[list[str]]) -> Iterator[tuple[str, str]]:
    """Keys of paired arrays."""
    for old, new in paired(before, second):
        if old is not None and new is not None:
            yield old[4], new[4]


def short(values: Array | None) -> str:
    """The first figures of a hash."""
    return "" if values is None else digest(values)[:10]


def shown(value: float | str | None) -> str:
    """A figure for the table."""
    return f"{value:.10g}" if isinstance(value, (int, float)) else str(value or "")


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("record", help="record a checkout's fingerprints")
    one.add_argument("out", type=Path, metavar="OUT.json")
    one.add_argument("--root", type=Path, required=True, help="checkout to record")
    one.add_argument("--python", type=Path, default=Path(sys.executable), help="that runs it")
    one.add_argument("--quick", action="store_true", help="leave out what takes long")
    one.add_argument("--only", metavar="REGEX", help="only scenarios whose name matches")
    two = commands.add_parser("compare", help="compare two recordings; exits 1 on a difference")
    two.add_argument("before", type=Path, metavar="BEFORE.json")
    two.add_argument("after", type=Path, metavar="AFTER.json")
    two.add_argument(
        "--self",
        type=Path,
        action="extend",
        nargs="+",
        default=[],
        dest="second",
        metavar="SECOND_BEFORE.json",
        help="more recordings of 'before', whole or in part",
    )
    two.add_argument("--slack", type=float, default=2.0, help="times its own difference (2)")
    two.add_argument("--all", action="store_true", help="list what is the same, too")
    given = parser.parse_args()
    if given.command == "record":
        # Not resolved: a virtual environment's Python is a link, and knows itself by its place.
        python = given.python.absolute()
        return record(given.root.resolve(), python, given.out, given.quick, given.only)
    recordings = [Recording.load(path) for path in (given.before, given.after, *given.second)]
    comparison = Comparison(recordings[0], recordings[1], recordings[2:], given.slack)
    comparison.everything()
    print(comparison.told(given.all))
    return 1 if comparison.failed() else 0


if __name__ == "__main__":
    sys.exit(main())
