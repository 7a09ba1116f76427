"""Normal maps: images that bend the shading normal of triangles.

A texel is a unit vector in the triangle's tangent space: x along the tangent, y along the
bitangent (the tangent's sign times normal x tangent, which is where v grows), z along the shading
normal. What becomes of it is in ``kernels_cl/common/normal_map.cl``. No technique's light depends
on them unless it reads them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats
from gibench.scene.image_rows import ROW_WORDS, ImagedTriangles, Words

_STEPS = 32767


@dataclass(frozen=True)
class NormalMaps(ImagedTriangles[Floats]):
    """The triangles of a scene that have a normal map.

    Attributes:
        images: (height, width, 3) float32 unit vectors each, z not below 0; row 0 is v = 1.
        triangle, image, uvs: as of all :class:`ImagedTriangles`.
        scale: (k,) float32 that x and y are multiplied with.
        tangents: (k, 3, 4) float32 unit tangents of their corners, and the bitangent's sign.
    """

    row_words: ClassVar[int] = ROW_WORDS + 13

    scale: Floats = field(repr=False)
    tangents: Floats = field(repr=False)

    def arrays(self) -> Iterator[npt.NDArray[Any]]:
        """All that it consists of, for hashes."""
        yield from (self.triangle, self.image, self.scale, self.uvs, self.tangents, *self.images)

    def packed(self, triangles: int) -> Words:
        """What kernels_cl/common/normal_map.cl reads, uint32: for each of ``triangles`` where its
        row begins, 0 for one without; the rows, which end with the map's scale and the tangents of
        the corners with their signs; the images, a word a texel.
        """
        coded = [packed_normals(pixels) for pixels in self.images]
        scale = np.ascontiguousarray(self.scale, np.float32).reshape(-1, 1)
        tangents = np.ascontiguousarray(self.tangents, np.float32).reshape(-1, 12)
        more = np.concatenate([scale, tangents], axis=1).view(np.uint32)
        return self.packed_rows(triangles, coded, more)


def packed_normals(pixels: Floats) -> Words:
    """Unit vectors (h, w, 3) as words: x and y as signed numbers of 16 bits, lowest first."""
    codes = np.rint(np.asarray(pixels, np.float64).reshape(-1, 3)[:, :2] * _STEPS)
    words = codes.astype(np.int64) & 0xFFFF
    return (words[:, 0] | words[:, 1] << 16).astype(np.uint32)


def unpacked_normals(words: Words) -> Doubles:
    """The unit vectors (n, 3) of words."""
    x, y = ((words >> shift).astype(np.uint16).view(np.int16) / _STEPS for shift in (0, 16))
    return np.stack((x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))), axis=1)


def normals_of_heights(heights: Floats, strength: float) -> Floats:
    """The unit normals (h, w, 3) of a repeating image of heights (h, w), by central differences.

    A height of 1 is a hundredth of the image's longer side, times ``strength``: MTL names no unit.
    """
    slope = strength * max(heights.shape) / 100 / 2
    along = (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) * slope
    up = (np.roll(heights, 1, 0) - np.roll(heights, -1, 0)) * slope
    return unit_normals(np.stack((-along, -up, np.ones_like(heights)), axis=2))


def unit_normals(vectors: npt.NDArray[Any]) -> Floats:
    """The vectors (h, w, 3) at length 1, those below the surface brought into it; (0, 0, 1) where
    nothing is left.
    """
    found = np.asarray(vectors, np.float64).copy()
    found[..., 2] = np.maximum(found[..., 2], 0)
    length = np.linalg.norm(found, axis=2, keepdims=True)
    found = np.where(length > 1e-6, found / np.maximum(length, 1e-6), (0.0, 0.0, 1.0))
    return found.astype(np.float32)
