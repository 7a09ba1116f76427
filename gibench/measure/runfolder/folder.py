"""The folder a run leaves: samples as they come, everything else whole or not at all."""

from __future__ import annotations

import csv
import json
import os
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gibench.errors import BadInput, GibenchError
from gibench.files import write_whole
from gibench.measure.runfolder.axes import KEYS

SCHEMA_VERSION, OLDEST_SCHEMA = 1, 1
SAMPLES, RECORD = "samples.csv", "run.json"
SAMPLE = ("pass", "frame", "time_ms")
"""Columns of a sample after its keys and axes."""
SAMPLE_TAIL = ("receivers", "frame_wall_ms", "configuration")
"""Its last columns, after the technique's counts."""


@dataclass(frozen=True)
class RunFolder:
    """A run's folder, made and found writable.

    Attributes:
        path: the folder.
    """

    path: Path

    @staticmethod
    def create(path: Path, arguments: Mapping[str, Any]) -> RunFolder:
        """Make the folder ``path``, or take over an earlier run of the same arguments.

        Raises:
            BadInput: it cannot be written, or holds something else.
        """
        mend = "give another folder with --out"
        try:
            path.mkdir(parents=True, exist_ok=True)
            present = [entry.name for entry in path.iterdir()]
            with tempfile.NamedTemporaryFile(dir=path):
                pass
        except OSError as error:
            reason = error.strerror or str(error)
            raise BadInput(
                f"the output folder cannot be written ({reason})", where=path, mend=mend
            ) from error
        folder = RunFolder(path)
        if present and folder._arguments() != json.loads(json.dumps(arguments)):
            what = "another run" if RECORD in present else "files that are not a run of gibench"
            raise BadInput(f"the output folder already holds {what}", where=path, mend=mend)
        return folder

    def start_samples(self, axes: Sequence[str], counts: Sequence[str]) -> None:
        """Begin ``samples.csv`` anew with its header."""
        self.write_text(SAMPLES, ",".join(sample_columns(axes, counts)) + "\n")

    def append_samples(self, rows: Iterable[Sequence[Any]]) -> None:
        """Append rows of :func:`sample_columns` and see them on the disk.

        Raises:
            GibenchError: the disk refuses; what was there before stays.
        """
        try:
            with (self.path / SAMPLES).open("a", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerows(rows)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise _cannot_write(self.path / SAMPLES, error) from error

    def write_text(self, name: str, text: str) -> None:
        """Write ``name`` whole or not at all.

        Raises:
            GibenchError: the disk refuses.
        """
        write_atomically(self.path / name, text.encode())

    def write_record(self, record: Mapping[str, Any]) -> None:
        """Write ``run.json``."""
        text = json.dumps(_plain(record), indent=2, ensure_ascii=False, allow_nan=False)
        self.write_text(RECORD, text + "\n")

    def record(self) -> dict[str, Any] | None:
        """The content of ``run.json``; None where there is none that can be read."""
        try:
            found = json.loads((self.path / RECORD).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return found if isinstance(found, dict) else None

    def _arguments(self) -> Any:
        return (self.record() or {}).get("arguments")


def sample_columns(axes: Sequence[str], counts: Sequence[str]) -> tuple[str, ...]:
    """The columns of ``samples.csv``; ``axes`` and ``counts`` as the run has them."""
    return (*KEYS, *axes, *SAMPLE, *counts, *SAMPLE_TAIL)


def default_folder(profiles: Sequence[str], kind: str = "runs") -> Path:
    """``results/<kind>/<UTC time>-<profile>`` beneath the working folder; never one that exists."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    named = re.sub(r"[^\w.+-]+", "_", "+".join(profiles))  # a user's profile has any name
    base = Path("results") / kind / f"{stamp}-{named}"
    path, turn = base, 2
    while path.exists():
        path, turn = base.with_name(f"{base.name}-{turn}"), turn + 1
    return path


def write_atomically(path: Path, content: bytes) -> None:
    """Write ``path`` through a temporary file beside it, so that readers see all or nothing.

    Raises:
        GibenchError: the disk refuses.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    except OSError as error:
        raise _cannot_write(path, error) from error


def _cannot_write(path: Path, error: OSError) -> GibenchError:
    return GibenchError(
        f"cannot be written ({error.strerror or error})",
        where=path,
        mend="what was written before is kept",
    )


def _plain(value: Any) -> Any:
    """``value`` as JSON has it: nan and infinity become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not -float("inf") < value < float("inf"):
        return None
    return value
