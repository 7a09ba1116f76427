"""Progressive results on disk: content-addressed, resumable, written atomically."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gibench.arrays import Doubles
from gibench.files import write_whole
from gibench.reference.wavefront import Work

Key = Mapping[str, str | int | None]


@dataclass
class Rounds:
    """Mean and spread over independent rounds (Welford 1962).

    Attributes:
        count: rounds so far.
        mean: (n, 3) float64.
        squares: (n, 3) float64 sum of squared deviations from the mean.
        work: what they cost.
    """

    count: int
    mean: Doubles = field(repr=False)
    squares: Doubles = field(repr=False)
    work: Work

    @staticmethod
    def none(owners: int) -> Rounds:
        """No round yet."""
        return Rounds(0, np.zeros((owners, 3)), np.zeros((owners, 3)), Work())

    def add(self, values: Doubles) -> None:
        """One more round."""
        self.count += 1
        off = values - self.mean
        self.mean += off / self.count
        self.squares += off * (values - self.mean)

    def standard_error(self) -> Doubles:
        """Standard error of the mean (n, 3); infinite below two rounds."""
        if self.count < 2:
            return np.full_like(self.mean, np.inf)
        return np.asarray(np.sqrt(self.squares / ((self.count - 1) * self.count)))

    def relative_error(self) -> float:
        """Mean standard error over mean value; 0 where everything is dark."""
        error, value = float(self.standard_error().mean()), float(self.mean.mean())
        return error / value if value > 0 else (0.0 if error == 0 else np.inf)


def key_digest(key: Key) -> str:
    """SHA-256 of a key."""
    return hashlib.sha256(_text(key).encode()).hexdigest()


def load(folder: Path, key: Key, owners: int) -> Rounds | None:
    """The rounds kept under ``key``, or None when there are none or the file is damaged."""
    file = _file(folder, key)
    try:
        with np.load(file, allow_pickle=False) as held:
            if str(held["key"]) != _text(key) or held["mean"].shape != (owners, 3):
                return None
            work = Work(int(held["rays"]), float(held["ray_seconds"]), float(held["seconds"]))
            return Rounds(int(held["count"]), held["mean"], held["squares"], work)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def save(folder: Path, key: Key, rounds: Rounds) -> None:
    """Keep the rounds; readers see the old file or the new one, never half of one."""
    body = io.BytesIO()
    np.savez(
        body,
        key=_text(key),
        count=rounds.count,
        mean=rounds.mean,
        squares=rounds.squares,
        rays=rounds.work.rays,
        ray_seconds=rounds.work.ray_seconds,
        seconds=rounds.work.seconds,
    )
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(_file(folder, key), body.getvalue())


def _text(key: Key) -> str:
    return json.dumps(dict(key), sort_keys=True)


def stored_file(folder: Path, digest: str) -> Path:
    """The file of the rounds whose key has this digest."""
    return folder / f"reference-{digest[:32]}.npz"


def _file(folder: Path, key: Key) -> Path:
    return stored_file(folder, key_digest(key))
