"""Cut-outs: parts of triangles that are not there, where an alpha mask says so.

One rule everywhere, on the host and in kernels_cl/common/cutout.cl, in float32: the texel that
holds the point, images repeating, v upwards; its column is floor(frac(u) width), its row from the
top floor((1 - frac(v)) height), each at most the last one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Bools, Floats, Ints
from gibench.scene.image_rows import ImagedTriangles, Words

# How far a looked up texel may be off by rounding: of a texel, and of a coordinate.
_TEXEL_SLACK = 1e-3
_UV_SLACK = 2.0**-22
_LARGEST_UV = 2.0**24


@dataclass(frozen=True)
class Cutouts(ImagedTriangles[Bools]):
    """The triangles of a scene with something cut away.

    Attributes:
        images: (height, width) bool each, True where there is surface; row 0 is v = 1.
        triangle, image, uvs: as of all :class:`ImagedTriangles`.
    """

    def there(self, rows: npt.NDArray[Any], u: Floats, v: Floats) -> Bools:
        """Whether there is surface at barycentric weights ``u`` and ``v`` of corners 1 and 2.

        Args:
            rows: (n,) rows of this table.
            u: (n,) float32.
            v: (n,) float32.
        """
        first, width, height, texels = self._texels
        image = self.image[rows]
        w = np.float32(1) - u - v
        corners = self.uvs[rows]
        x, y = (w * corners[:, 0, k] + u * corners[:, 1, k] + v * corners[:, 2, k] for k in (0, 1))
        size = width[image], height[image]
        column = ((x - np.floor(x)) * size[0].astype(np.float32)).astype(np.int64)
        row = ((np.float32(1) - (y - np.floor(y))) * size[1].astype(np.float32)).astype(np.int64)
        column, row = np.minimum(column, size[0] - 1), np.minimum(row, size[1] - 1)
        return np.asarray(texels[first[image] + row * size[0] + column])

    @cached_property
    def _texels(self) -> tuple[Ints, Ints, Ints, Bools]:
        """First texel, width and height of every image; all texels, one image after the other."""
        heights, widths = np.array([image.shape for image in self.images], np.int64).T
        first = np.concatenate(([0], np.cumsum(heights * widths)))[:-1]
        return first, widths, heights, np.concatenate([image.reshape(-1) for image in self.images])

    def packed(self, triangles: int) -> Words:
        """What ``cut_away`` of kernels_cl/common/cutout.cl reads, uint32: for each of ``triangles``
        where its row begins, 0 for a whole one; the rows of ROW_WORDS; the images, a bit a texel.
        """
        bits = [np.packbits(image.reshape(-1), bitorder="little") for image in self.images]
        words = [np.pad(one, (0, -len(one) % 4)).view("<u4") for one in bits]
        return self.packed_rows(triangles, words)

    def packed_words(self, triangles: int) -> int:
        """Words of :meth:`packed`."""
        images = sum(-(-image.size // 32) for image in self.images)
        return triangles + self.row_words * len(self.triangle) + images


def surface_texels(image: Bools, uvs: npt.NDArray[Any]) -> tuple[Ints, Ints]:
    """How many texels of ``image`` in the bounds of triangles ``uvs`` (t, 3, 2) are surface, and
    how many there are, (t,) each; bounds that are as large as the image count as all of it.
    """
    height, width = image.shape
    sums = np.zeros((2 * height + 1, 2 * width + 1), np.int64)
    sums[1:, 1:] = np.tile(image, (2, 2)).cumsum(axis=0).cumsum(axis=1)
    at = np.clip(np.asarray(uvs, np.float64), -_LARGEST_UV, _LARGEST_UV)
    slack = _TEXEL_SLACK + _UV_SLACK * np.abs(at).max(axis=(1, 2)) * max(height, width)
    bounds = []
    for along, size in ((at[:, :, 0] * width, width), ((1 - at[:, :, 1]) * height, height)):
        low = np.floor(along.min(axis=1) - slack).astype(np.int64)
        high = np.floor(along.max(axis=1) + slack).astype(np.int64)
        count = np.minimum(high - low + 1, size)
        bounds.append((low % size, low % size + count))
    (left, right), (top, bottom) = bounds
    found = sums[bottom, right] - sums[bottom, left] - sums[top, right] + sums[top, left]
    return np.asarray(found), np.asarray((right - left) * (bottom - top))
