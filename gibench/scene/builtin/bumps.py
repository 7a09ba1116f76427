"""Normal maps made from formulas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Floats
from gibench.scene.model import Scene
from gibench.scene.normal_maps import NormalMaps, normals_of_heights
from gibench.scene.readers.tangents import tangents


@dataclass(frozen=True)
class Bumps:
    """Round bumps in rows, each beside two of the next row.

    Attributes:
        size: pixels of the image's side.
        rows: of bumps in the image.
        repeat: of the image, for each unit of texture coordinates.
        strength: of the heights, see :func:`gibench.scene.normal_maps.normals_of_heights`.
    """

    size: int
    rows: int
    repeat: float
    strength: float

    def image(self) -> Floats:
        """The normals (size, size, 3); they repeat without a seam."""
        y, x = (np.mgrid[0 : self.size, 0 : self.size] + 0.5) / self.size * (2 * np.pi * self.rows)
        heights = np.maximum(np.cos(x) * np.cos(y), 0) ** 2
        return normals_of_heights(heights.astype(np.float32), self.strength)


def bumpy_surfaces(scene: Scene, bumps: Mapping[int, Bumps]) -> NormalMaps:
    """The normal maps of ``scene``'s triangles of some materials, by the number of these."""
    chosen = sorted(bumps)
    triangle = np.flatnonzero(np.isin(scene.material_ids, chosen))
    image = np.searchsorted(chosen, scene.material_ids[triangle])
    repeat = np.array([bumps[number].repeat for number in chosen])
    corners = scene.triangles[triangle]
    uvs = scene.uvs[corners] * repeat[image][:, None, None]
    return NormalMaps(
        images=tuple(bumps[number].image() for number in chosen),
        triangle=triangle.astype(np.int32),
        image=image.astype(np.int32),
        scale=np.ones(len(triangle), np.float32),
        uvs=uvs.astype(np.float32),
        tangents=tangents(scene.positions[corners], scene.normals[corners], uvs).astype(np.float32),
    )
