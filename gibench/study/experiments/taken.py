"""Errors of an earlier run of the same experiment, so that a quiet machine is kept for times."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.errors import BadInput
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.runfolder.results import OK
from gibench.study.rows import row_key

_OF_TIMES = ("frames", "warmup_frames", "warmup_seconds", "shard", "errors_from")
"""Arguments on which no error depends."""


@dataclass(frozen=True)
class Taken:
    """Errors that were measured before: plain data.

    Attributes:
        keys: columns that name a point.
        rows: errors by point, as text names it.
    """

    keys: tuple[str, ...]
    rows: Mapping[tuple[str, ...], Mapping[str, Any]] = field(repr=False)

    def of(self, key: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """The errors of a point; None where it was not measured."""
        return self.rows.get(row_key(key, self.keys))


def read_errors(
    path: Path,
    name: str,
    keys: Iterable[str],
    columns: Iterable[str],
    arguments: Mapping[str, Any],
) -> Taken:
    """The errors in the folder ``path`` of an earlier run.

    Args:
        path: the folder.
        name: of the experiment.
        keys: columns that name a point.
        columns: of errors; none where the experiment has none that can be taken.
        arguments: of this run.

    Raises:
        BadInput: it holds something else, or what errors of other arguments are of.
    """
    keys, columns = tuple(keys), tuple(columns)
    where = f"--errors-from {path}"
    if not columns:
        raise BadInput(
            f"the experiment '{name}' has no errors apart from what it measures",
            where=where,
            mend="leave it out",
        )
    file, record = path / f"{name}.csv", RunFolder(path).record()
    if record is None or not file.is_file():
        raise BadInput(f"there is no run of '{name}'", where=where, mend="give its folder")
    before, now = (_of_errors(each) for each in (record.get("arguments", {}), arguments))
    apart = sorted(k for k in before.keys() | now.keys() if before.get(k) != now.get(k))
    if apart:
        raise BadInput(
            f"it was run with another {', '.join(apart)}", where=where, mend="give the same"
        )
    table = pd.read_csv(file, dtype=dict.fromkeys(keys, str), keep_default_na=True)
    rows = {
        tuple(str(row[key]) for key in keys): {column: row[column] for column in columns}
        for row in table[table["status"] == OK].to_dict("records")
    }
    return Taken(keys, rows)


def _of_errors(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """What errors depend on, as JSON has it."""
    found: dict[str, Any] = json.loads(json.dumps(dict(arguments)))
    return {key: value for key, value in found.items() if key not in _OF_TIMES}
