"""Emission that varies over triangles, as an image of the emitted radiance says.

A point emits what the image has there, bilinear and repeating, as an albedo's image is looked up:
``kernels_cl/common/glow.cl`` for the techniques, ``kernels_cl/reference/glow.cl`` for the truth.
``Material.emission`` of such a triangle is the mean over it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gibench.arrays import Doubles, Floats
from gibench.scene.image_rows import ROW_WORDS, ImagedTriangles, Words

# EXT_texture_shared_exponent (Khronos): 9 bits a channel, 5 of exponent, which is off by 15.
_MANTISSA_BITS = 9
_BIAS = 15
_LARGEST_EXPONENT = 31


@dataclass(frozen=True)
class Glow(ImagedTriangles[Floats]):
    """The triangles of a scene that glow by an image.

    Attributes:
        images: (height, width, 3) float32 emitted radiance each, W/m2/sr; row 0 is v = 1.
        triangle, image, uvs: as of all :class:`ImagedTriangles`.
    """

    row_words: ClassVar[int] = ROW_WORDS + 1

    def packed(self, triangles: int) -> Words:
        """What kernels_cl/common/glow.cl reads, uint32: for each of ``triangles`` where its row
        begins, 0 for one without; the rows, whose last word is the image's scale; the images,
        a word a texel.
        """
        coded = [shared_exponents(pixels) for pixels in self.images]
        scales = np.array([scale for _, scale in coded], np.float32).view(np.uint32)
        return self.packed_rows(triangles, [words for words, _ in coded], scales[self.image, None])


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
