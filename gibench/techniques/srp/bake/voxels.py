"""Voxels for probe placement: which are empty, which of the empty ones are inside."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, label

from gibench.arrays import Bools, Floats
from gibench.rays.tracer import RayTracer
from gibench.scene.model import Scene
from gibench.techniques.parts.octahedral_maps import octahedral_decode
from gibench.techniques.srp.bake.sampling import triangle_planes

# Surface samples per voxel edge: dense enough that no face-connected path crosses a surface.
_SAMPLES_PER_EDGE = 3.0
_BATCH = 1 << 20
# Rays that tell inside from outside, 8 x 8 octahedral cells.
_LOOK_AROUND = 8


@dataclass(frozen=True)
class Voxels:
    """A grid over the scene's bounds with one layer of voxels around them.

    Attributes:
        origin: (3,) corner of voxel (0, 0, 0), m.
        edge: of a voxel, m.
        full: (nx, ny, nz) touched by a surface.
    """

    origin: npt.NDArray[np.float64]
    edge: float
    full: Bools = field(repr=False)

    def centres(self, index: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Centres (n, 3) of voxels (n, 3), m."""
        return np.asarray(self.origin + (index + 0.5) * self.edge)


def voxelise(scene: Scene, longest: int) -> Voxels:
    """Voxelise the triangles with ``longest`` voxels along the longest side of the bounds.

    Triangles are sampled three times as densely as the voxels, so that a face-connected path
    of empty voxels never crosses one.
    """
    low, high = scene.bounds
    edge = float((high - low).max()) / longest
    inner = np.maximum(1, np.ceil((high - low) / edge - 1e-9)).astype(np.int64)
    origin = 0.5 * (low + high) - 0.5 * inner * edge - edge
    full = np.zeros(tuple(inner + 2), np.bool_)
    corners = scene.corners.astype(np.float64)
    sides = np.stack([corners[:, (i + 1) % 3] - corners[:, i] for i in range(3)], axis=1)
    steps = np.ceil(np.linalg.norm(sides, axis=2).max(axis=1) / edge * _SAMPLES_PER_EDGE)
    steps = np.maximum(steps, 1).astype(np.int64)
    for count in np.unique(steps):
        members = np.flatnonzero(steps == count)
        weights = _lattice(int(count))
        for batch in np.array_split(members, -(-len(members) * len(weights) // _BATCH)):
            points = np.einsum("sc,tcx->tsx", weights, corners[batch]).reshape(-1, 3)
            index = np.clip(
                ((points - origin) / edge).astype(np.int64), 0, np.array(full.shape) - 1
            )
            full[tuple(index.T)] = True
    return Voxels(origin, edge, full)


def _lattice(steps: int) -> npt.NDArray[np.float64]:
    """Barycentric weights of a triangular lattice with ``steps`` steps along each edge."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1), indexing="ij")
    keep = i + j <= steps
    u, v = i[keep] / steps, j[keep] / steps
    return np.stack([1.0 - u - v, u, v], axis=1)


def beside_surfaces(voxels: Voxels) -> npt.NDArray[np.int64]:
    """(n, 3) empty voxels within the bounds with a full one among their 26 neighbours."""
    beside = binary_dilation(voxels.full, np.ones((3, 3, 3), np.bool_)) & ~voxels.full
    beside[[0, -1]] = beside[:, [0, -1]] = beside[:, :, [0, -1]] = False
    return np.argwhere(beside)


def regions(voxels: Voxels) -> npt.NDArray[np.int32]:
    """Flood fill of (x, y, z) voxels: the number of the face-connected empty region of each voxel,
    0 where full.
    """
    return np.asarray(label(~voxels.full)[0], np.int32)


def view_shares(
    points: Floats, scene: Scene, tracer: RayTracer
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Shares (n,) of the sphere around ``points`` that show front faces and back faces."""
    cells = (np.arange(_LOOK_AROUND) + 0.5) / _LOOK_AROUND * 2.0 - 1.0
    u, v = np.meshgrid(cells, cells)
    # A fixed small turn keeps the rays off the scene's own axes.
    square = np.clip(np.stack([u.ravel(), v.ravel()], axis=1) + 0.013, -0.999, 0.999)
    directions = octahedral_decode(square).astype(np.float32)
    normals = triangle_planes(scene.corners)[:, :3]
    front = np.zeros(len(points))
    back = np.zeros(len(points))
    for begin in range(0, len(points), _BATCH // len(directions)):
        part = slice(begin, begin + _BATCH // len(directions))
        origins = np.repeat(points[part], len(directions), axis=0)
        toward = np.tile(directions, (len(points[part]), 1))
        triangle = tracer.closest(origins, toward).triangle
        facing = np.einsum("nx,nx->n", normals[triangle], toward) < 0
        hit = triangle >= 0
        shape = (-1, len(directions))
        front[part] = (hit & facing).reshape(shape).mean(axis=1)
        back[part] = (hit & ~facing).reshape(shape).mean(axis=1)
    return front, back
