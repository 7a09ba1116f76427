"""Triangles with an image of something: one layout, and one hash, for cut-outs, glow, gloss and
normal maps.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints

Image = TypeVar("Image", bound=npt.NDArray[Any])
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


@dataclass(frozen=True)
class ImagedTriangles(Generic[Image]):
    """The triangles of a scene that have an image of something.

    Attributes:
        images: (height, width) or (height, width, channels) each; row 0 is v = 1.
        triangle: (k,) int32 scene triangles, ascending.
        image: (k,) int32 of each, index into ``images``.
        uvs: (k, 3, 2) float32 coordinates of their corners in the image, v upwards.
    """

    row_words: ClassVar[int] = ROW_WORDS

    images: tuple[Image, ...] = field(repr=False)
    triangle: Ints = field(repr=False)
    image: Ints = field(repr=False)
    uvs: Floats = field(repr=False)

    def rows(self, triangles: int) -> Ints:
        """Where each of a scene's ``triangles`` stands here, (t,) int32; -1 for one without."""
        rows = np.full(triangles, -1, np.int32)
        rows[self.triangle] = np.arange(len(self.triangle), dtype=np.int32)
        return rows

    def arrays(self) -> Iterator[npt.NDArray[Any]]:
        """All that it consists of, for hashes."""
        yield from (self.triangle, self.image, self.uvs)
        yield from self.images

    def content_hash(self) -> str:
        """SHA-256 of all of it."""
        return arrays_hash(self.arrays())

    def packed_words(self, triangles: int) -> int:
        """Words that a scene of so many ``triangles`` takes on a device, a word a texel."""
        texels = sum(pixels.shape[0] * pixels.shape[1] for pixels in self.images)
        return int(triangles + self.row_words * len(self.triangle) + texels)

    def packed_rows(
        self, triangles: int, coded: Sequence[Words], more: Words | None = None
    ) -> Words:
        """Words: for each of ``triangles`` where its row begins, 0 for one without; rows; images.

        Args:
            triangles: of the scene.
            coded: the words of each image.
            more: (k, m) further words of each row.
        """
        count = len(self.triangle)
        more = np.empty((count, 0), np.uint32) if more is None else more
        width = ROW_WORDS + more.shape[1]
        first = triangles + width * count
        starts = first + np.concatenate(([0], np.cumsum([len(words) for words in coded])))[:-1]
        table = np.zeros(triangles, np.uint32)
        table[self.triangle] = triangles + width * np.arange(count)
        sizes = np.array([pixels.shape[:2] for pixels in self.images], np.uint32).reshape(-1, 2)
        rows = np.empty((count, width), np.uint32)
        rows[:, :6] = np.ascontiguousarray(self.uvs, np.float32).reshape(-1, 6).view(np.uint32)
        rows[:, 6] = starts[self.image]
        rows[:, 7:9] = sizes[self.image][:, ::-1]
        rows[:, 9:] = more
        return np.concatenate([table, rows.reshape(-1), *coded]).astype(np.uint32)
