"""A sensible camera for a scene whose file has none."""

from __future__ import annotations

import math

import numpy as np

from gibench.arrays import Array
from gibench.scene.model import Camera, Scene
from gibench.scene.readers.content import unit, vec3

_AZIMUTHS = 64
# A point counts as inside a room when so many of the horizontal directions end on a front: from the
# middle of a square room without one of its walls it is three quarters.
_ROOM_SHARE = 0.6


def suggested_camera(scene: Scene) -> Camera:
    """A view of the scene: from inside an interior, from outside everything else."""
    return _inside_view(scene) if is_interior(scene) else _outside_view(scene)


def is_interior(scene: Scene) -> bool:
    """Whether most of five points around the middle of the scene have fronts around them."""
    low, high = scene.bounds
    centre, size = (low + high) / 2, high - low
    centre[1] = low[1] + 0.35 * size[1]
    level = _Level(scene, float(centre[1]))
    angles = (np.arange(_AZIMUTHS) + 0.5) * (2 * np.pi / _AZIMUTHS)
    around = np.column_stack((np.cos(angles), np.sin(angles)))
    votes = 0
    for dx, dz in ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)):
        point = centre[[0, 2]] + 0.15 * size[[0, 2]] * [dx, dz]
        _, fronts = level.first_hits(point, around)
        votes += bool(fronts.mean() >= _ROOM_SHARE)
    return votes >= 3


def _outside_view(scene: Scene) -> Camera:
    low, high = scene.bounds
    centre, size = (low + high) / 2, high - low
    fov = 40.0
    # The bounding sphere just fits into the view.
    distance = 1.05 * float(np.linalg.norm(size)) / 2 / math.sin(math.radians(fov / 2))
    direction = np.asarray(unit(np.array([0.6, 0.45, 1.0])))
    return Camera(vec3(centre + distance * direction), vec3(centre), fov)


def _inside_view(scene: Scene) -> Camera:
    """Along the longest horizontal axis from near one end, or through a missing wall.

    Of several places near both ends the one that sees farthest along the axis is taken.
    """
    low, high = scene.bounds
    centre, size = (low + high) / 2, high - low
    fov = 60.0
    opening = _opening(scene)
    if opening is not None:
        axis, end = opening
        edge = high if end > 0 else low
        height = max(size[1], size[2 - axis])
        position, target = centre.copy(), centre.copy()
        position[axis] = edge[axis] + end * height / 2 / math.tan(math.radians(fov / 2))
        return Camera(vec3(position), vec3(target), fov)
    axis = 0 if size[0] >= size[2] else 2
    centre[1] = low[1] + 0.35 * size[1]
    level = _Level(scene, float(centre[1]))
    best, best_distance = 0.2, -1.0
    for share in (0.1, 0.15, 0.2, 0.25, 0.75, 0.8, 0.85, 0.9):
        point = centre.copy()
        point[axis] = low[axis] + share * size[axis]
        along = np.zeros((1, 3))
        along[0, axis] = 1.0 if share < 0.5 else -1.0
        distance, front = level.first_hits(point[[0, 2]], along[:, [0, 2]])
        if front[0] and distance[0] > best_distance:
            best, best_distance = share, float(distance[0])
    position, target = centre.copy(), centre.copy()
    position[axis] = low[axis] + best * size[axis]
    target[axis] = high[axis] if best < 0.5 else low[axis]
    return Camera(vec3(position), vec3(target), fov)


def _opening(scene: Scene) -> tuple[int, int] | None:
    """Axis (0 or 2) and end (-1 or 1) of the one horizontal side where the room has no wall."""
    low, high = scene.bounds
    size = high - low
    corners = scene.corners.astype(np.float64)
    centroid = corners.mean(axis=1)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    open_ends = []
    for axis in (0, 2):
        side = float(np.prod(np.delete(size, axis))) or 1.0
        for end in (-1, 1):
            edge = high[axis] if end > 0 else low[axis]
            near = np.abs(centroid[:, axis] - edge) < 0.1 * size[axis]
            facing_in = np.clip(-end * area[near, axis], 0, None).sum()
            if facing_in < 0.1 * side:
                open_ends.append((axis, end))
    return open_ends[0] if len(open_ends) == 1 else None


class _Level:
    """The scene cut at a height: rays in that plane against the segments of the cut."""

    def __init__(self, scene: Scene, height: float) -> None:
        corners = scene.corners.astype(np.float64)
        above = corners[:, :, 1] > height
        cut = above.any(axis=1) & ~above.all(axis=1)
        corners, above = corners[cut], above[cut]
        # The corner alone on its side of the plane starts both edges that cross it.
        lone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
        rows = np.arange(len(corners))
        tip = corners[rows, lone]
        ends = []
        for step in (1, 2):
            other = corners[rows, (lone + step) % 3]
            t = (height - tip[:, 1]) / (other[:, 1] - tip[:, 1])
            ends.append((tip + t[:, None] * (other - tip))[:, [0, 2]])
        self.start, self.end = ends
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normal = normal[:, [0, 2]]

    def first_hits(self, point: Array, directions: Array) -> tuple[Array, Array]:
        """Distances (n,), infinite for none, from ``point`` (2,) along ``directions`` (n, 2).

        Also (n,) whether the first thing hit is a front.
        """
        edge, to_start = self.end - self.start, self.start - point
        distances, fronts = np.full(len(directions), np.inf), np.zeros(len(directions), bool)
        for i, (x, z) in enumerate(directions):
            with np.errstate(all="ignore"):
                determinant = edge[:, 0] * z - edge[:, 1] * x
                t = (edge[:, 0] * to_start[:, 1] - edge[:, 1] * to_start[:, 0]) / determinant
                s = (x * to_start[:, 1] - z * to_start[:, 0]) / determinant
                t = np.where((s >= 0) & (s <= 1) & (t > 0), t, np.inf)
            if len(t) and np.isfinite(t.min()):
                hit = int(t.argmin())
                distances[i] = t[hit]
                fronts[i] = self.normal[hit] @ (x, z) < 0
        return distances, fronts
