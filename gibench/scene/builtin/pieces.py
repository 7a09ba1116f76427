"""The generators' primitives: small meshes, front faces outwards (or where a docstring says).

Nothing a primitive makes is hidden inside another surface: boxes and columns have no bottoms, and
what they stand on gets holes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mapbox_earcut import triangulate_float64

from gibench.arrays import Doubles

Point = Sequence[float] | Doubles


@dataclass(frozen=True)
class Piece:
    """A mesh of one material and one object.

    Attributes:
        name: of the object; parts that share it are one object.
        material: name of the material.
        positions: (v, 3) m.
        normals: (v, 3) unit.
        uvs: (v, 2).
        triangles: (t, 3).
    """

    name: str
    material: str
    positions: Doubles = field(repr=False)
    normals: Doubles = field(repr=False)
    uvs: Doubles = field(repr=False)
    triangles: npt.NDArray[np.int64] = field(repr=False)

    def moved(self, offset: Point, turn_degrees: float = 0.0) -> Piece:
        """Turned about +Y through the origin, then moved."""
        c, s = np.cos(np.radians(turn_degrees)), np.sin(np.radians(turn_degrees))
        # A turn from +X towards -Z, as seen from above counter-clockwise.
        matrix = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        return replace(
            self,
            positions=self.positions @ matrix.T + np.asarray(offset, np.float64),
            normals=self.normals @ matrix.T,
        )

    def named(self, name: str) -> Piece:
        """The same mesh as part of another object."""
        return replace(self, name=name)


def grid_triangles(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Triangles (2 (rows-1) (columns-1), 3) of a grid of vertices, row by row."""
    i = np.arange((rows - 1) * columns).reshape(rows - 1, columns)[:, :-1].ravel()
    a, b, c, d = i, i + 1, i + columns + 1, i + columns
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def patch(
    name: str, material: str, points: Doubles, normals: Doubles | None = None, uvs: Any = None
) -> Piece:
    """A grid of ``points`` (rows, columns, 3).

    Its front is columns x rows, or the side of the normals (rows, columns, 3) where they are given;
    otherwise they are taken from differences between neighbours. Quads without area (a pole) lose
    the empty triangle.
    """
    rows, columns = points.shape[:2]
    if normals is None:
        along = np.gradient(points, axis=1)
        across = np.gradient(points, axis=0)
        normals = np.cross(along, across)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = normals / np.maximum(length, 1e-12)
    if uvs is None:
        u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
        uvs = np.stack([u, v], axis=2)
    triangles = grid_triangles(rows, columns)
    flat = points.reshape(-1, 3)
    corners = flat[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if (cross * normals.reshape(-1, 3)[triangles[:, 0]]).sum() < 0:
        triangles = triangles[:, ::-1]
    full = np.linalg.norm(cross, axis=1) > 1e-10
    return Piece(
        name, material, flat, normals.reshape(-1, 3), np.reshape(uvs, (-1, 2)), triangles[full]
    )


def panel(
    name: str,
    material: str,
    origin: Point,
    u: Point,
    v: Point,
    grid: tuple[int, int] = (1, 1),
    metres_per_uv: float | None = None,
) -> Piece:
    """A rectangle from ``origin`` along ``u`` and ``v``, its front towards u x v.

    Made of a grid of quads. Texture coordinates run from 0 to 1, or by ``metres_per_uv``.
    """
    o, du, dv = (np.asarray(p, np.float64) for p in (origin, u, v))
    s, t = np.meshgrid(np.linspace(0, 1, grid[0] + 1), np.linspace(0, 1, grid[1] + 1))
    points = o + s[..., None] * du + t[..., None] * dv
    scale = [1.0, 1.0]
    if metres_per_uv:
        scale = [float(np.linalg.norm(d)) / metres_per_uv for d in (du, dv)]
    normal = np.broadcast_to(np.cross(du, dv), points.shape)
    return patch(name, material, points, normal, np.stack([s * scale[0], t * scale[1]], axis=2))


def flat(
    name: str,
    material: str,
    outline: npt.ArrayLike,
    holes: Sequence[npt.ArrayLike] = (),
    *,
    origin: Point = (0.0, 0.0, 0.0),
    u: Point = (1.0, 0.0, 0.0),
    v: Point = (0.0, 0.0, -1.0),
    metres_per_uv: float = 1.0,
) -> Piece:
    """A plane polygon (n, 2) with holes, at origin + x u + y v, its front towards u x v.

    ``u`` and ``v`` are unit vectors; unless given, the polygon lies in (x, -z) and faces up.
    """
    rings = [np.asarray(outline, np.float64), *(np.asarray(h, np.float64) for h in holes)]
    points = np.concatenate(rings)
    ends = np.cumsum([len(r) for r in rings]).astype(np.uint32)
    triangles = triangulate_float64(points, ends).reshape(-1, 3).astype(np.int64)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[twice < 0] = triangles[twice < 0][:, ::-1]
    triangles = triangles[np.abs(twice) > 1e-10]
    du, dv = np.asarray(u, np.float64), np.asarray(v, np.float64)
    positions = np.asarray(origin, np.float64) + points[:, :1] * du + points[:, 1:] * dv
    normals = np.broadcast_to(np.cross(du, dv), positions.shape)
    return Piece(name, material, positions, normals, points / metres_per_uv, triangles)


def box(name: str, material: str, size: Point) -> list[Piece]:
    """A box without bottom, standing on the origin's plane, centred on it."""
    x, height, z = size[0] / 2, size[1], size[2] / 2
    corners = [(-x, z), (x, z), (x, -z), (-x, -z)]
    sides = []
    for i in range(4):
        (x0, z0), (x1, z1) = corners[i], corners[(i + 1) % 4]
        sides.append(
            panel(name, material, (x0, 0.0, z0), (x1 - x0, 0.0, z1 - z0), (0.0, height, 0.0))
        )
    top = panel(name, material, (-x, height, z), (2 * x, 0.0, 0.0), (0.0, 0.0, -2 * z))
    return [*sides, top]


def footprint(size: Point, center: Point, turn_degrees: float = 0.0) -> Doubles:
    """The outline (4, 2) in (x, -z) of a box of ``size`` that stands at ``center`` (x, z)."""
    x, z = size[0] / 2, size[2] / 2
    c, s = np.cos(np.radians(turn_degrees)), np.sin(np.radians(turn_degrees))
    p = np.array([(-x, z), (x, z), (x, -z), (-x, -z)])
    turned = np.stack([c * p[:, 0] + s * p[:, 1], -s * p[:, 0] + c * p[:, 1]], axis=1)
    return np.asarray((turned + np.asarray(center, np.float64)) * [1.0, -1.0])


def shifted(ring: npt.ArrayLike, x: float, y: float) -> Doubles:
    """``ring`` (n, 2) moved by (x, y)."""
    return np.asarray(np.asarray(ring, np.float64) + np.array([x, y]))


def circle(radius: float, center: Point = (0.0, 0.0), segments: int = 32) -> Doubles:
    """A regular polygon (segments, 2) about ``center``; starts on +x, counter-clockwise."""
    angle = np.arange(segments) / segments * 2 * np.pi
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
    return np.asarray(ring + np.asarray(center, np.float64))
