"""Triangles with an image of something: one layout, and one hash, for gloss and for normal maps."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints

Words = npt.NDArray[np.uint32]

ROW_WORDS = 9
"""Of a row: six coordinates; first word, width and height of its image."""


def arrays_hash(arrays: Iterable[npt.NDArray[Any]]) -> str:
    """SHA-256 of arrays with their shapes and types."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(str((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def packed_rows(
    triangles: int,
    triangle: Ints,
    image: Ints,
    uvs: Floats,
    shapes: Sequence[tuple[int, ...]],
    coded: Sequence[Words],
    more: Words | None = None,
) -> Words:
    """Words: for each of ``triangles`` where its row begins, 0 for one without; rows; images.

    Args:
        triangles: of the scene.
        triangle: (k,) those with an image.
        image: (k,) of each.
        uvs: (k, 3, 2) coordinates of their corners.
        shapes: height and width of each image.
        coded: the words of each image, one a texel.
        more: (k, m) further words of each row.
    """
    more = np.empty((len(triangle), 0), np.uint32) if more is None else more
    count, width = len(triangle), ROW_WORDS + more.shape[1]
    first = triangles + width * count
    starts = first + np.concatenate(([0], np.cumsum([len(words) for words in coded])))[:-1]
    table = np.zeros(triangles, np.uint32)
    table[triangle] = triangles + width * np.arange(count)
    sizes = np.array([shape[:2] for shape in shapes], np.uint32).reshape(-1, 2)
    rows = np.empty((count, width), np.uint32)
    rows[:, :6] = np.ascontiguousarray(uvs, np.float32).reshape(-1, 6).view(np.uint32)
    rows[:, 6] = starts[image]
    rows[:, 7:9] = sizes[image][:, ::-1]
    rows[:, 9:] = more
    return np.concatenate([table, rows.reshape(-1), *coded]).astype(np.uint32)
