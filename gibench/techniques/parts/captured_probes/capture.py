"""What a probe sees, captured as the faces of a cube by Embree."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints
from gibench.rays.tracer import RayTracer
from gibench.scene.lightmap.albedo import mean_albedo, mean_emission
from gibench.scene.model import Scene


def cube_directions(side: int) -> Doubles:
    """Unit directions (6 side^2, 3) through the texels of a cube's faces: +x, -x, +y, -y, +z, -z,
    each row by row.
    """
    at = (np.arange(side) + 0.5) / side * 2 - 1
    a, b = (g.ravel() for g in np.meshgrid(at, at))
    faces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            d = np.empty((side**2, 3))
            d[:, axis], d[:, (axis + 1) % 3], d[:, (axis + 2) % 3] = sign, a, b
            faces.append(d)
    d = np.concatenate(faces)
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


@dataclass(frozen=True)
class Captured:
    """The G-buffer of a probe: its cube's texels.

    Attributes:
        triangle: (n,) int32 that is seen, -1 where nothing is.
        barycentric: (n, 2) float32 weights of corners 1 and 2.
        distance: (n,) float32, m; infinite where nothing is seen.
        front: (n,) whether a surface's front is seen.
        albedo: (n, 3) float32 of fronts; 0 elsewhere.
        emission: (n, 3) float32 of fronts, the environment's radiance where nothing is seen; 0 of
            backs; W/m2/sr.
    """

    triangle: Ints = field(repr=False)
    barycentric: Floats = field(repr=False)
    distance: Floats = field(repr=False)
    front: npt.NDArray[np.bool_] = field(repr=False)
    albedo: Floats = field(repr=False)
    emission: Floats = field(repr=False)

    @property
    def back_share(self) -> float:
        """Share of its texels that show surfaces' backs."""
        return float(((self.triangle >= 0) & ~self.front).mean())

    @property
    def nbytes(self) -> int:
        """Bytes of all its texels."""
        arrays = (self.triangle, self.barycentric, self.distance, self.front, self.albedo)
        return sum(a.nbytes for a in (*arrays, self.emission))


def capture(scene: Scene, tracer: RayTracer, position: Doubles, directions: Doubles) -> Captured:
    """What is seen from ``position`` (3,), m, along ``directions`` (n, 3), unit."""
    rays = directions.astype(np.float32)
    hits = tracer.closest(np.tile(position.astype(np.float32), (len(rays), 1)), rays)
    seen = hits.triangle >= 0
    front = np.zeros(len(rays), np.bool_)
    corners = scene.corners[hits.triangle[seen]].astype(np.float64)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    front[seen] = np.einsum("nx,nx->n", facing, directions[seen]) < 0
    albedo = np.zeros((len(rays), 3), np.float32)
    emission = np.zeros((len(rays), 3), np.float32)
    barycentric = np.stack([hits.u, hits.v], axis=1)
    barycentric[~seen] = 0.0
    triangle = hits.triangle[front].astype(np.int64)
    u, v = barycentric[front].astype(np.float64).T
    point = np.stack([1 - u - v, u, v], axis=1)
    pieces = np.repeat(point[:, None], 3, axis=1)  # without extent: points
    albedo[front] = mean_albedo(scene, triangle, pieces)
    emission[front] = mean_emission(scene, triangle, pieces)
    emission[~seen] = scene.environment.radiance(directions[~seen])
    return Captured(hits.triangle, barycentric, hits.distance, front, albedo, emission)
