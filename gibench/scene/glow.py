"""Emission that varies over triangles, as an image of the emitted radiance says.

A point emits what the image has there, bilinear and repeating, as an albedo's image is looked up:
``kernels_cl/common/glow.cl`` for the techniques, ``kernels_cl/reference/glow.cl`` for the truth.
``Material.emission`` of such a triangle is the mean over it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints

Words = npt.NDArray[np.uint32]

ROW_WORDS = 10
"""Of a packed row: six coordinates, first word, width, height and scale of its image."""

# EXT_texture_shared_exponent (Khronos): 9 bits a channel, 5 of exponent, which is off by 15.
_MANTISSA_BITS = 9
_BIAS = 15
_LARGEST_EXPONENT = 31


@dataclass(frozen=True)
class Glow:
    """The triangles of a scene that glow by an image.

    Attributes:
        images: (height, width, 3) float32 emitted radiance each, W/m2/sr; row 0 is v = 1.
        triangle: (k,) int32 scene triangles, ascending.
        image: (k,) int32 of each, index into ``images``.
        uvs: (k, 3, 2) float32 coordinates of their corners in the image, v upwards.
    """

    images: tuple[Floats, ...] = field(repr=False)
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
        yield from (self.triangle, self.image, self.uvs, *self.images)

    def packed(self, triangles: int) -> Words:
        """What kernels_cl/common/glow.cl reads, uint32: for each of ``triangles`` where its row
        begins, 0 for one without; the rows of ROW_WORDS; the images, a word a texel.
        """
        count = len(self.triangle)
        coded = [shared_exponents(pixels) for pixels in self.images]
        first = triangles + ROW_WORDS * count
        starts = first + np.concatenate(([0], np.cumsum([len(words) for words, _ in coded])))[:-1]
        shapes = np.array([pixels.shape[:2] for pixels in self.images], np.uint32).reshape(-1, 2)
        scales = np.array([scale for _, scale in coded], np.float32)
        table = np.zeros(triangles, np.uint32)
        table[self.triangle] = triangles + ROW_WORDS * np.arange(count)
        rows = np.empty((count, ROW_WORDS), np.uint32)
        rows[:, :6] = np.ascontiguousarray(self.uvs, np.float32).reshape(-1, 6).view(np.uint32)
        rows[:, 6] = starts[self.image]
        rows[:, 7:9] = shapes[self.image][:, ::-1]
        rows[:, 9] = scales.view(np.uint32)[self.image]
        parts = [table, rows.reshape(-1), *(words for words, _ in coded)]
        return np.concatenate(parts).astype(np.uint32)

    def packed_words(self, triangles: int) -> int:
        """Words of :meth:`packed`."""
        texels = sum(pixels.shape[0] * pixels.shape[1] for pixels in self.images)
        return int(triangles + ROW_WORDS * len(self.triangle) + texels)


def in_first_period(uvs: Doubles) -> Floats:
    """Coordinates (k, 3, 2) of repeating images moved by whole periods to near 0, float32."""
    return np.asarray(uvs - np.floor(uvs.min(axis=1, keepdims=True)), np.float32)


def shared_exponents(pixels: Floats) -> tuple[Words, float]:
    """The texels (h, w, 3) in words, row by row, and what decoded ones are to be multiplied with.

    A word holds red, green and blue as whole numbers of 9 bits each, lowest first, and 5 bits of
    an exponent e: their value is times 2^(e - 24). The scale is a power of two that brings the
    brightest texel within reach.
    """
    values = np.asarray(pixels, np.float64).reshape(-1, 3)
    largest = float(values.max(initial=0.0))
    top = int(np.floor(np.log2(largest))) if largest > 0 else 0
    scale = 2.0 ** (top - (_LARGEST_EXPONENT - _BIAS - 1))
    values = values / scale
    brightest = np.maximum(values.max(axis=1), 2.0 ** -(_BIAS + 1))
    exponent = np.maximum(-_BIAS - 1, np.floor(np.log2(brightest))) + 1 + _BIAS
    step = 2.0 ** (exponent - _BIAS - _MANTISSA_BITS)
    over = np.rint(brightest / step) == 1 << _MANTISSA_BITS
    exponent = np.where(over, exponent + 1, exponent)
    step = np.where(over, 2 * step, step)
    most = (1 << _MANTISSA_BITS) - 1
    codes = np.minimum(np.rint(values / step[:, None]), most).astype(np.uint32)
    exponents = np.minimum(exponent, _LARGEST_EXPONENT).astype(np.uint32)
    words = codes[:, 0] | codes[:, 1] << 9 | codes[:, 2] << 18 | exponents << 27
    return words.astype(np.uint32), scale


def decoded(words: Words, scale: float) -> Doubles:
    """The radiance (n, 3) of words of :func:`shared_exponents`."""
    codes = np.stack([words >> shift & 511 for shift in (0, 9, 18)], axis=1).astype(np.float64)
    exponents = (words >> 27).astype(np.float64)[:, None]
    return np.asarray(codes * 2.0 ** (exponents - _BIAS - _MANTISSA_BITS) * scale)
