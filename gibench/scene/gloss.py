"""Images of roughness and metalness.

A texel holds both as numbers from 0 to 1, which the material's own are multiplied with. What
becomes of them is in ``kernels_cl/common/gloss.cl``. No technique's light depends on them unless it
reads them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints
from gibench.scene.image_rows import ImagedTriangles, Words

DIELECTRIC_F0 = 0.04
"""What no metal reflects of light that falls on it straight (glTF 2.0, appendix B)."""
LEAST_ALPHA = 1e-3
"""Roughness squared of the smoothest surface, so that its lobe has a width."""
_STEPS = 65535


@dataclass(frozen=True)
class GlossMaps(ImagedTriangles[Floats]):
    """The triangles of a scene that have an image of roughness and metalness.

    Attributes:
        images: (height, width, 2) float32 roughness and metalness each, 0 to 1; row 0 is v = 1.
        triangle, image, uvs: as of all :class:`ImagedTriangles`.
    """

    def packed(self, triangles: int) -> Words:
        """What kernels_cl/common/gloss.cl reads, uint32: for each of ``triangles`` where its row
        begins, 0 for one without; the rows of ROW_WORDS; the images, a word a texel.
        """
        return self.packed_rows(triangles, [packed_gloss(pixels) for pixels in self.images])


def packed_gloss(pixels: Floats) -> Words:
    """Roughness and metalness (h, w, 2) as words: numbers of 16 bits, roughness lowest."""
    codes = np.rint(np.clip(np.asarray(pixels, np.float64).reshape(-1, 2), 0, 1) * _STEPS)
    words = codes.astype(np.uint32)
    return np.asarray(words[:, 0] | words[:, 1] << np.uint32(16), np.uint32)


def unpacked_gloss(words: Words) -> Doubles:
    """Roughness and metalness (n, 2) of words."""
    return np.stack((words & 0xFFFF, words >> 16), axis=1).astype(np.float64) / _STEPS


def gloss_at(
    maps: GlossMaps, factors: npt.NDArray[Any], triangles: Ints, weights: npt.NDArray[Any]
) -> Doubles:
    """Roughness and metalness (n, 2) at points of ``triangles``, in float64: the rule of
    kernels_cl/common/gloss.cl.

    Args:
        maps: of the scene.
        factors: (n, 2) roughness and metalness of the points' materials.
        triangles: (n,) scene triangles.
        weights: (n, 3) of their corners.
    """
    result = np.array(factors, np.float64)
    place = np.searchsorted(maps.triangle, triangles).clip(max=len(maps.triangle) - 1)
    for n in np.flatnonzero(maps.triangle[place] == triangles):
        row = place[n]
        pixels = maps.images[maps.image[row]].astype(np.float64)
        height, width = pixels.shape[:2]
        s, t = weights[n].astype(np.float64) @ maps.uvs[row].astype(np.float64)
        x, y = (s - np.floor(s)) * width - 0.5, (1 - (t - np.floor(t))) * height - 0.5
        left, top = int(np.floor(x)), int(np.floor(y))
        across, down = x - left, y - top
        rows, columns = (top % height, (top + 1) % height), (left % width, (left + 1) % width)
        upper, lower = ((1 - across) * pixels[r, columns[0]] + across * pixels[r, columns[1]]
                        for r in rows)  # fmt: skip
        result[n] *= (1 - down) * upper + down * lower
    return result
