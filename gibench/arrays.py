"""Names for the arrays that cross module borders, and what NumPy lacks for large ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
"""Of numbers of any type."""
Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]
Longs = npt.NDArray[np.int64]
Vec3 = tuple[float, float, float]


def least_of_corners(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """``values.min(axis=1)`` of (n, 3, ...), which NumPy is slow at."""
    return np.asarray(np.minimum(np.minimum(values[:, 0], values[:, 1]), values[:, 2]))


def most_of_corners(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """``values.max(axis=1)`` of (n, 3, ...), which NumPy is slow at."""
    return np.asarray(np.maximum(np.maximum(values[:, 0], values[:, 1]), values[:, 2]))


def unique_rows(rows: npt.NDArray[Any]) -> tuple[Longs, Longs]:
    """The different rows of ``rows`` (n, k), in the order that ``np.lexsort(rows.T)`` gives them.

    Much faster than ``np.unique(rows, axis=0)``: columns are folded into ranks one by one, each by
    a sort of plain 64-bit numbers.

    Args:
        rows: numbers that fit 32 bits, n below 2^31.

    Returns:
        The first place of each different row, and for every row the number of its like, (n,).
    """
    count = len(rows)
    if not count:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    rank = np.zeros(count, np.int64)
    order = np.zeros(count, np.int64)
    for column in range(rows.shape[1] - 1, -1, -1):
        key = (rank << 32) + (rows[:, column].astype(np.int64) + (1 << 31))
        order = np.argsort(key)
        ordered = key[order]
        new = np.ones(count, np.bool_)
        new[1:] = ordered[1:] != ordered[:-1]
        rank[order] = np.cumsum(new) - 1
    return np.minimum.reduceat(order, np.flatnonzero(new)), rank
