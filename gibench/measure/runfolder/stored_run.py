"""Reading a run's folder back: its record and its samples."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gibench.errors import BadInput
from gibench.measure.runfolder.axes import KEYS, LATER_KEYS
from gibench.measure.runfolder.folder import (
    OLDEST_SCHEMA,
    RECORD,
    SAMPLE,
    SAMPLE_TAIL,
    SAMPLES,
    SCHEMA_VERSION,
)

if TYPE_CHECKING:
    import pandas as pd

_NEEDED = ("arguments", "seed", "environment", "device", "profiles", "roofs", "configurations")


@dataclass(frozen=True)
class StoredRun:
    """A run as its folder has it.

    Attributes:
        path: the folder.
        record: the content of ``run.json``.
        samples: the content of ``samples.csv``.
    """

    path: Path
    record: dict[str, Any]
    samples: pd.DataFrame


def read_run(path: Path) -> StoredRun:
    """The run in the folder ``path``.

    A last line of samples that was cut short is left out.

    Raises:
        BadInput: it is no run of gibench, is damaged, was not finished, or is of another gibench.
    """
    import pandas as pd

    record = read_record(path)
    if not record.get("finished"):
        raise BadInput(
            "this run was never finished", where=path, mend="run it again into another folder"
        )
    if not (path / SAMPLES).exists():
        raise BadInput(
            f"it has no {SAMPLES}: only the tables made from them are left",
            where=path,
            mend="take a run whose samples were kept",
        )
    try:
        text = (path / SAMPLES).read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        samples = pd.read_csv(io.StringIO(whole))
    except (OSError, ValueError) as error:
        raise _damaged(path / SAMPLES, error) from error
    needed = (*(key for key in KEYS if key not in LATER_KEYS), *SAMPLE, *SAMPLE_TAIL)
    if missing := [name for name in needed if name not in samples.columns]:
        raise BadInput(f"it has no column '{missing[0]}'", where=path / SAMPLES)
    return StoredRun(path, record, samples)


def read_record(path: Path) -> dict[str, Any]:
    """The content of ``run.json`` of the run in the folder ``path``.

    Raises:
        BadInput: there is none, it is damaged, or is of another gibench.
    """
    record = read_any_record(path)
    if missing := [name for name in _NEEDED if name not in record]:
        raise BadInput(f"it is damaged: '{missing[0]}' is missing", where=path / RECORD)
    return record


def read_any_record(path: Path) -> dict[str, Any]:
    """The content of ``run.json`` in the folder ``path``, of a run or a study.

    Raises:
        BadInput: there is none, it is damaged, or is of another gibench.
    """
    file = path / RECORD
    if not path.is_dir():
        raise BadInput("there is no such run folder", where=path)
    if not file.exists():
        raise BadInput(f"not a run of gibench: it has no {RECORD}", where=path)
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise _damaged(file, error) from error
    version = record.get("schema_version") if isinstance(record, dict) else None
    if not isinstance(version, int):
        raise BadInput("it has no schema_version: not a record of gibench", where=file)
    if version > SCHEMA_VERSION:
        raise BadInput(
            f"it is of schema {version}; this gibench reads up to {SCHEMA_VERSION}",
            where=file,
            mend="upgrade gibench",
        )
    if version < OLDEST_SCHEMA:
        raise BadInput(
            f"it is of schema {version}; this gibench reads {OLDEST_SCHEMA} to {SCHEMA_VERSION}",
            where=file,
            mend="measure it again, or read it with the gibench that made it",
        )
    found: dict[str, Any] = record
    return found


def _damaged(file: Path, error: Exception) -> BadInput:
    reason = error.strerror if isinstance(error, OSError) else " ".join(str(error).split())
    return BadInput(f"it cannot be read ({reason})", where=file, mend="it is damaged or cut short")
