"""An experiment's folder: all that is measured is written here, and read again."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.errors import CannotRun, GibenchError
from gibench.measure.machine.environment import without_paths
from gibench.measure.runfolder.folder import write_atomically
from gibench.measure.runfolder.results import FAILED, OK, SKIPPED
from gibench.report.images import ImageWriter, file_name
from gibench.study.rows import Rows

STATUS = ("status", "reason")
Summarize = Callable[[pd.DataFrame, Mapping[str, Any]], Sequence[Mapping[str, Any]]]


@dataclass(frozen=True)
class Images:
    """Images to keep.

    Attributes:
        scene: those of one scene have one exposure.
        label: of the folder they go to.
        by_title: linear radiance (h, w, 3).
    """

    scene: str
    label: str
    by_title: Mapping[str, Any] = field(repr=False)


@dataclass(frozen=True)
class Found:
    """What measuring a point gave, without its key.

    Attributes:
        rows: of the experiment's table.
        samples: what rows are made of, where the experiment has samples.
        arrays: to keep, by label: (n, 3) irradiance or a map, W/m2.
        images: to keep.
        error: why there is nothing.
    """

    rows: Sequence[Mapping[str, Any]] = ()
    samples: Sequence[Mapping[str, Any]] = ()
    arrays: Mapping[str, Doubles] = field(default_factory=dict)
    images: Sequence[Images] = ()
    error: GibenchError | None = None


def of_key(samples: pd.DataFrame, key: Mapping[str, Any]) -> pd.DataFrame:
    """The samples of a point."""
    return samples[(samples[list(key)] == pd.Series(dict(key))).all(axis=1)]


def as_kept(values: Doubles) -> Doubles:
    """``values``, of any shape, in the precision of the file they are kept in."""
    return values.astype(np.float32).astype(np.float64)


@dataclass(frozen=True)
class Kept:
    """What is in the folder.

    Attributes:
        path: the folder.
        rows: the experiment's table.
        samples: of which rows are made; None where it has none.
        summarize: makes them.
    """

    path: Path
    rows: Rows
    samples: Rows | None
    summarize: Summarize | None
    _images: ImageWriter

    @staticmethod
    def at(
        path: Path,
        name: str,
        keys: Sequence[str],
        columns: Sequence[str],
        samples: Sequence[str] = (),
        summarize: Summarize | None = None,
    ) -> Kept:
        """The folder ``path`` of experiment ``name``; samples whose rows are missing get them.

        Raises:
            BadInput: it holds files of other columns.
            GibenchError: the disk refuses.
        """
        rows = Rows.at(path / f"{name}.csv", keys, columns)
        held = Rows.at(path / f"{name}-samples.csv", keys, samples) if samples else None
        return Kept(path, rows, held, summarize, ImageWriter(path / "images"))

    def done(self, key: Mapping[str, Any]) -> bool:
        """Whether the point is measured; from stored samples alone its rows are made here."""
        if not self.rows.done(key) and self.samples is not None and self.samples.done(key):
            self._add_rows(key, Found())
        return self.rows.done(key)

    def add(self, key: Mapping[str, Any], found: Found) -> None:
        """Write what was measured, the rows last: where these are, all of it is.

        Raises:
            GibenchError: the disk refuses.
        """
        for images in found.images:
            self._images.write(images.scene, images.label, dict(images.by_title))
        for label, values in found.arrays.items():
            content = io.BytesIO()
            np.save(content, values.astype(np.float32))
            write_atomically(self._file(label), content.getvalue())
        if self.samples is not None and found.error is None:
            self.samples.add([{**key, **row} for row in found.samples])
        self._add_rows(key, found)

    def _add_rows(self, key: Mapping[str, Any], found: Found) -> None:
        rows: Sequence[Mapping[str, Any]] = found.rows
        if found.error is not None:
            status = SKIPPED if isinstance(found.error, CannotRun) else FAILED
            rows = [{"status": status, "reason": without_paths(str(found.error))}]
        elif self.samples is not None and self.summarize is not None:
            rows = self.summarize(self.samples.table(), key)
        self.rows.add([{"status": OK, "reason": "", **key, **row} for row in rows])

    def table(self) -> pd.DataFrame:
        """All rows."""
        return self.rows.table()

    def arrays(self, labels: Sequence[str]) -> dict[str, Doubles]:
        """Those of ``labels`` that are kept."""
        found = {label: self.array(label) for label in labels}
        return {label: values for label, values in found.items() if values is not None}

    def array(self, label: str) -> Doubles | None:
        """What was kept under ``label``, or None."""
        try:
            return np.asarray(np.load(self._file(label), allow_pickle=False), np.float64)
        except (OSError, ValueError):
            return None

    def _file(self, label: str) -> Path:
        return self.path / "irradiance" / f"{file_name(label)}.npy"
