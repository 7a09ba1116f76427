"""A CSV that grows row by row, so that an interrupted experiment goes on where it stopped."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.errors import BadInput, GibenchError
from gibench.measure.runfolder.folder import write_atomically


@dataclass
class Rows:
    """The file and which keys it already holds.

    Attributes:
        path: of the CSV.
        keys: columns that name what was measured; several rows may share them.
        columns: all columns, the keys first.
    """

    path: Path
    keys: tuple[str, ...]
    columns: tuple[str, ...]
    _done: set[tuple[str, ...]] = field(default_factory=set, repr=False)

    @staticmethod
    def at(path: Path, keys: Sequence[str], columns: Sequence[str]) -> Rows:
        """The rows of ``path``, which is begun where there is none. A file from before some columns
        were there gets them, blank.

        Raises:
            BadInput: there is a file with other columns.
            GibenchError: the disk refuses.
        """
        rows = Rows(path, tuple(keys), (*keys, *columns))
        if not path.exists():
            write_atomically(path, (",".join(rows.columns) + "\n").encode())
            return rows
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            found, held = tuple(reader.fieldnames or ()), list(reader)
        if found != rows.columns:
            if found != tuple(name for name in rows.columns if name in found) or not found:
                raise BadInput(
                    "the file has other columns than this experiment writes",
                    where=path,
                    mend="give another folder with --out",
                )
            lines = [rows.columns, *([row.get(name, "") for name in rows.columns] for row in held)]
            text = io.StringIO()
            csv.writer(text, lineterminator="\n").writerows(lines)
            write_atomically(path, text.getvalue().encode())
        rows._done = {tuple(row.get(name, "") for name in rows.keys) for row in held}
        return rows

    def done(self, key: Mapping[str, Any]) -> bool:
        """Whether rows of this key are there."""
        return self._key(key) in self._done

    def add(self, found: Sequence[Mapping[str, Any]]) -> None:
        """Append rows of one key and see them on the disk, all of them or none.

        Raises:
            GibenchError: the disk refuses.
        """
        try:
            held = self.path.read_bytes()
            with self.path.open("a", newline="", encoding="utf-8") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerows([[_text(row.get(n)) for n in self.columns] for row in found])
                file.flush()
                os.fsync(file.fileno())
        except KeyboardInterrupt:
            write_atomically(self.path, held)
            raise
        except OSError as error:
            raise GibenchError(f"cannot be written ({error.strerror})", where=self.path) from error
        self._done |= {self._key(row) for row in found}

    def table(self) -> pd.DataFrame:
        """All rows."""
        return pd.read_csv(self.path, dtype={"reason": str}, keep_default_na=True)

    def _key(self, row: Mapping[str, Any]) -> tuple[str, ...]:
        return row_key(row, self.keys)


def row_key(row: Mapping[str, Any], keys: Sequence[str]) -> tuple[str, ...]:
    """What names a row, as the file has it."""
    return tuple(_text(row.get(name)) for name in keys)


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and value != value):
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
