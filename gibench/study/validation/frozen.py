"""Predictions made before they are scored: made, kept, and found to be those that were kept."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.errors import BadInput, CheckFailed, GibenchError
from gibench.profiles import DeviceProfile, Machine, load_profile
from gibench.project.model import launch_times
from gibench.project.ranges import UNKNOWN, Total, range_of, together
from gibench.project.unknowns import POINTS
from gibench.report.tables import csv_text
from gibench.study.validation import convolution, opendwarfs, published
from gibench.trace.kept_streams import streams_of
from gibench.trace.streams import WaveStreams

CONVOLUTION, PUBLISHED, DWARFS = "convolution", "published", "opendwarfs"
SETS = (PUBLISHED, CONVOLUTION, DWARFS)
TABLE, TIMES, HASHES = "predictions.csv", "points.npz", "frozen.json"
_AT_ONCE = 2
_LEAST_MS = 1e-3


@dataclass(frozen=True)
class Predictions:
    """What was predicted.

    Attributes:
        table: a row each: set, name, profile, range, what bounds and drives it, verdict.
        times: of every row at every point (n, POINTS), ms; NaN where nothing could be told.
        hashes: SHA-256 of the two files, and of the profiles they were made with.
    """

    table: pd.DataFrame
    times: Doubles
    hashes: dict[str, str]


Tell = Callable[[str], None]


def predict(cache: Path, tell: Tell, sets: Sequence[str] = SETS) -> tuple[pd.DataFrame, Doubles]:
    """Predict every row of ``sets``; nothing measured is looked at.

    Args:
        cache: where traces are kept.
        tell: is told how far it is.
        sets: which of ``SETS``.
    """
    makers = {PUBLISHED: _published, CONVOLUTION: _convolution, DWARFS: _dwarfs}
    rows: list[dict[str, Any]] = []
    times: list[Doubles] = []
    for name in sets:
        for key, profile, total in makers[name](cache, tell):
            machine = _machine(profile)
            row: dict[str, Any] = {"set": name, "name": key, "profile": profile.name}
            if isinstance(total, GibenchError):
                rows.append(row | {"verdict": UNKNOWN, "reason": str(total)})
                times.append(np.full(POINTS, np.nan))
                continue
            found = range_of(total, machine)
            rows.append(
                row
                | {
                    "low_ms": found.low,
                    "nominal_ms": found.nominal,
                    "high_ms": found.high,
                    "bound_by": found.bound_by,
                    "driven_by": found.driven_by,
                    "verdict": found.verdict,
                    "reason": found.reason,
                }
            )
            times.append(total.times)
    columns = ["set", "name", "profile", "low_ms", "nominal_ms", "high_ms"]
    columns += ["bound_by", "driven_by", "verdict", "reason"]
    return pd.DataFrame(rows, columns=columns), np.array(times)


_Found = Iterator[tuple[str, DeviceProfile, Total | GibenchError]]


def _machine(profile: DeviceProfile) -> Machine:
    assert profile.machine is not None
    return profile.machine


def _convolution(cache: Path, tell: Tell) -> _Found:
    chosen = convolution.sample(convolution.measured()[list(convolution.KEYS)])
    profiles = [load_profile(name) for name in convolution.MEASURED]
    widths = sorted({profile.simd_width for profile in profiles})

    def one(number: int) -> dict[int, WaveStreams] | GibenchError:
        row = {str(name): int(value) for name, value in chosen.iloc[number].items()}
        try:
            return streams_of(convolution.request(row), widths, cache)
        except GibenchError as error:
            return error

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        for number, found in enumerate(pool.map(one, range(len(chosen)))):
            tell(f"convolution {number + 1} of {len(chosen)}")
            name = convolution_name(chosen.iloc[number])
            for profile in profiles:
                if isinstance(found, GibenchError):
                    yield name, profile, found
                    continue
                times = launch_times(found[profile.simd_width], _machine(profile))
                yield name, profile, together([times])


def convolution_name(row: pd.Series) -> str:
    """A configuration's name in the table: its numbers in the order of the columns."""
    return " ".join(str(int(row[name])) for name in convolution.KEYS)


def _published(cache: Path, tell: Tell) -> _Found:
    for row in published.rows():
        tell(f"published {row.name}")
        profile = load_profile(row.profile)
        try:
            yield row.name, profile, _growth(row, profile, cache)
        except GibenchError as error:
            yield row.name, profile, error


def _growth(row: published.Row, profile: DeviceProfile, cache: Path) -> Total:
    """Time of what is added less that of what is taken off; of several choices of sizes each point
    has one, the first point the middle one.
    """

    def total(launches: Sequence[tuple[str, published.Sizes]]) -> Total:
        found = []
        for name, sizes in launches:
            request = published.request(name, sizes, profile)
            each = streams_of(request, (profile.simd_width,), cache)
            found.append(launch_times(each[profile.simd_width], _machine(profile)))
        return together(found)

    choices = []
    for added, taken in zip(row.added, row.taken, strict=True):
        whole = total(added)
        less = total(taken).times if taken else 0.0
        choices.append(
            Total(np.maximum(whole.times - less, _LEAST_MS), whole.bound_by, whole.places)
        )
    middle = len(choices) // 2
    which = (np.arange(POINTS) + middle) % len(choices)
    table = np.stack([each.times for each in choices])
    places = dict(choices[middle].places)
    if len(choices) > 1:
        places["probes that reach a cluster"] = which / len(choices)
    return Total(table[which, np.arange(POINTS)], choices[middle].bound_by, places)


def _dwarfs(cache: Path, tell: Tell) -> _Found:
    del cache  # nothing is traced
    tell("opendwarfs")
    for _, row in opendwarfs.measured().iterrows():
        name = " ".join(str(row[key]) for key in opendwarfs.KEYS)
        for each in opendwarfs.MEASURED:
            profile = load_profile(each)
            yield name, profile, opendwarfs.bounded(row, _machine(profile))


def freeze(folder: Path, table: pd.DataFrame, times: Doubles) -> None:
    """Write predictions with their hashes.

    Raises:
        BadInput: the folder cannot be written.
    """
    stored = io.BytesIO()
    np.savez_compressed(stored, times=times.astype(np.float32))
    files = {TABLE: csv_text(table).encode(), TIMES: stored.getvalue()}
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    for name in sorted(set(table["profile"])):
        hashes[f"profile {name}"] = load_profile(name).machine_hash
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (folder / name).write_bytes(content)
        text = json.dumps(hashes, indent=1) + "\n"
        (folder / HASHES).write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", where=folder) from error


def thaw(folder: Path | Traversable) -> Predictions:
    """Predictions as they were frozen.

    Raises:
        BadInput: there are none.
        CheckFailed: a file is not the one that was frozen.
    """
    try:
        hashes = json.loads(folder.joinpath(HASHES).read_text(encoding="utf-8"))
        files = {name: folder.joinpath(name).read_bytes() for name in (TABLE, TIMES)}
    except OSError as error:
        raise BadInput(
            "holds no frozen predictions",
            where=folder,
            mend="make them: gibench validate-projection --predict DIR",
        ) from error
    for name, content in files.items():
        if hashlib.sha256(content).hexdigest() != hashes[name]:
            raise CheckFailed(f"{name} is not what was frozen", where=folder)
    with np.load(io.BytesIO(files[TIMES])) as stored:
        times = stored["times"].astype(np.float64)
    return Predictions(pd.read_csv(io.BytesIO(files[TABLE])), times, hashes)
