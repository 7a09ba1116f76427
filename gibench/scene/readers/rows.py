"""A table that grows by rows and by whole arrays, as numbers of a file are read."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Array


class Rows:
    """Rows of numbers, one by one and by whole arrays."""

    def __init__(self, width: int) -> None:
        self._whole: list[Array] = []
        self._single: list[tuple[float, ...]] = []
        self._width, self._count = width, 0

    def __len__(self) -> int:
        return self._count

    def append(self, row: tuple[float, ...]) -> None:
        """Add a row."""
        self._single.append(row)
        self._count += 1

    def extend(self, rows: Array) -> None:
        """Add rows (n, width)."""
        self._gather()
        self._whole.append(rows)
        self._count += len(rows)

    def array(self) -> Array:
        """All rows, (n, width) float64."""
        self._gather()
        return np.concatenate([np.empty((0, self._width)), *self._whole])

    def _gather(self) -> None:
        if self._single:
            self._whole.append(np.array(self._single, np.float64))
            self._single = []
