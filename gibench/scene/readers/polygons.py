"""Triangles of polygons: fans of most, ear clipping for those with a dent."""

from __future__ import annotations

import mapbox_earcut
import numpy as np

from gibench.arrays import Array

# Areas that differ by less are the same, up to the rounding of coordinates with six digits.
AREA_TOLERANCE = 1e-5


def fan(corners: int) -> Array:
    """(n - 2, 3) numbers of the corners of the fan about the first of n corners."""
    seconds = np.arange(1, corners - 1)
    return np.column_stack((np.zeros_like(seconds), seconds, seconds + 1))


def fans_hold(points: Array) -> Array:
    """Whether fans about the first corner cover what (m, n, 3) polygons of n corners do, (m,).

    They do where no piece of the fan faces away from the polygon's normal: everywhere for convex
    ones, and for dented ones whose first corner sees all of them.
    """
    p = np.asarray(points, np.float64) - points[:, :1]
    pieces = np.cross(p[:, 1:-1], p[:, 2:])
    normal = pieces.sum(axis=1)
    square = np.einsum("mx,mx->m", normal, normal)
    facing = np.einsum("mix,mx->mi", pieces, normal)
    # NaN and what has no area is left to the cleaning of triangles.
    return np.asarray(~(facing < -AREA_TOLERANCE * square[:, None]).any(axis=1))


def cut(points: Array) -> tuple[Array, bool]:
    """Triangles (k, 3) of one polygon (n, 3) by ear clipping, wound as it is.

    It is cut in the plane of its mean normal (Newell's; Sutherland, Sproull and Schumacker 1974,
    "A characterization of ten hidden-surface algorithms", section on area vectors).

    Returns:
        The numbers of their corners, and whether the polygon is simple; the fan if it is not.
    """
    p = np.asarray(points, np.float64) - points[0]
    normal = np.cross(p[1:-1], p[2:]).sum(axis=0)
    area = float(np.linalg.norm(normal))
    if not (np.isfinite(area) and area > 0):
        return fan(len(points)), False
    normal /= area
    along = np.eye(3)[int(np.argmin(np.abs(normal)))]
    u = np.cross(along, normal)
    u /= np.linalg.norm(u)
    flat = np.ascontiguousarray(np.column_stack((p @ u, p @ np.cross(normal, u))))
    ring = np.array([len(points)], np.uint32)
    found = np.asarray(mapbox_earcut.triangulate_float64(flat, ring), np.int64).reshape(-1, 3)
    a, b, c = (p[found[:, i]] for i in range(3))
    areas = np.cross(b - a, c - a) @ normal
    found[areas < 0] = found[areas < 0, ::-1]
    if not abs(np.abs(areas).sum() - area) <= AREA_TOLERANCE * area:
        return fan(len(points)), False
    return found, True
