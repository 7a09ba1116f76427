"""The lightmap: an atlas of texels; its valid texels are the receivers.

A texel is valid when any triangle covers any part of it (conservative coverage). Its receiver sits
at the centroid of the covered surface, so that it always lies on a surface, and its area is the
covered surface area, so that the receivers' areas add up to the scene's.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints


@dataclass(frozen=True)
class Receivers:
    """The n receivers, in row-major order of their texels.

    Attributes:
        texel: (n,) int32 flat texel index, y * width + x, ascending.
        position: (n, 3) float32 centroid of the covered surface, m.
        normal: (n, 3) float32 unit, area-averaged.
        albedo: (n, 3) float32 area-averaged diffuse albedo.
        emission: (n, 3) float32 area-averaged emitted radiance, W/m2/sr.
        area: (n,) float32 covered surface area, m2.
    """

    texel: Ints = field(repr=False)
    position: Floats = field(repr=False)
    normal: Floats = field(repr=False)
    albedo: Floats = field(repr=False)
    emission: Floats = field(repr=False)
    area: Floats = field(repr=False)

    def __len__(self) -> int:
        return len(self.texel)

    @property
    def effective(self) -> float:
        """How many receivers of one area a mean by area would be as sure of (Kish 1965, *Survey
        Sampling*): where charts outnumber the receivers asked for, a few stand for whole walls.
        """
        area = self.area.astype(np.float64)
        return float(area.sum() ** 2 / (area**2).sum())


@dataclass(frozen=True)
class Fragments:
    """The covered surface of every receiver, cut into small triangles (CSR over receivers).

    Attributes:
        start: (n + 1,) int64: receiver i owns fragments start[i] to start[i + 1].
        corners: (m, 3, 3) float32 positions, m.
        triangle: (m,) int32 scene triangle each lies on.
        area: (m,) float32, m2.
    """

    start: np.ndarray[tuple[int], np.dtype[np.int64]] = field(repr=False)
    corners: Floats = field(repr=False)
    triangle: Ints = field(repr=False)
    area: Floats = field(repr=False)


@dataclass(frozen=True)
class Lightmap:
    """The atlas of a scene.

    Attributes:
        width: texels.
        height: texels.
        triangle_uvs: (t, 3, 2) float32 corner coordinates in texels: (0.5, 0.5) is the centre of
            texel 0; NaN for a triangle that has no place in the atlas.
        receivers: the valid texels.
        fragments: their covered surface.
        requested: number of receivers that was aimed for.
    """

    width: int
    height: int
    triangle_uvs: Floats = field(repr=False)
    receivers: Receivers
    fragments: Fragments = field(repr=False)
    requested: int = 0

    @property
    def receiver_of_texel(self) -> Ints:
        """(height * width,) int32: the receiver of each texel, or -1."""
        table = np.full(self.width * self.height, -1, np.int32)
        table[self.receivers.texel] = np.arange(len(self.receivers), dtype=np.int32)
        return table

    def content_hash(self) -> str:
        """SHA-256 of everything a bake can depend on."""
        digest = hashlib.sha256(f"{self.width}x{self.height}".encode())
        r = self.receivers
        for array in (self.triangle_uvs, r.texel, r.position, r.normal, self.fragments.corners):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def some_receivers(lightmap: Lightmap, chosen: npt.NDArray[np.intp]) -> Lightmap:
    """``lightmap`` with the receivers ``chosen`` (ascending indices) alone."""
    receivers, fragments = lightmap.receivers, lightmap.fragments
    counts = np.diff(fragments.start)[chosen]
    start = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    first = np.repeat(fragments.start[chosen] - start[:-1], counts)
    kept = np.arange(start[-1]) + first
    return replace(
        lightmap,
        receivers=Receivers(
            texel=receivers.texel[chosen],
            position=receivers.position[chosen],
            normal=receivers.normal[chosen],
            albedo=receivers.albedo[chosen],
            emission=receivers.emission[chosen],
            area=receivers.area[chosen],
        ),
        fragments=Fragments(
            start=start,
            corners=fragments.corners[kept],
            triangle=fragments.triangle[kept],
            area=fragments.area[kept],
        ),
    )
