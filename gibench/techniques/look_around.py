"""Where to look from so that little of a scene stays unseen: the built-in flight's keyframes.

Chosen greedily: of many views the one that shows most of the surface that none before it shows, and
so on. A greedy cover shows at least 1 - 1/e of what the best one of as many views would (Nemhauser,
Wolsey, Fisher 1978).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from gibench.rays.embree import scene_tracer
from gibench.rays.tracer import RayTracer
from gibench.scene.model import Camera, Scene

Points = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

FLIGHT_FOV: Final = 90.0
"""Vertical field of view of the flight, degrees; inside a room a narrow one shows little. Ours."""
# Ours: larger counts change little in the built-in scenes.
_SURFACE_POINTS, _POSITIONS, _DIRECTIONS, _MOST_VIEWS = 2048, 128, 12, 24
_LEAST_GAIN = 0.002  # share of the surface; a view that adds less is left out
_LEAST_COSINE = 0.1  # a surface seen at a flatter angle covers hardly a pixel
_MARGIN = 0.03  # distance kept from the scene's bounds, as a share of its sides


def keyframes(scene: Scene, start: Camera) -> tuple[Points, Points]:
    """Views besides ``start``'s in the order of a short way from it.

    Returns:
        (k, 3) positions and (k, 3) points looked at, m; none where ``start`` sees everything.
    """
    rng = np.random.default_rng(1)
    points, normals = _surface(scene, rng)
    low, high = scene.bounds
    margin = _MARGIN * (high - low)
    positions = rng.uniform(low + margin, high - margin, (_POSITIONS, 3))
    tracer = scene_tracer(scene)
    lift = 1e-4 * float(np.linalg.norm(high - low))
    at_start = _shown(tracer, np.array([start.position]), points, normals, lift)
    at_start &= _in_view(start, np.asarray(start.target), points, start.fov_degrees)[None]
    shown = _shown(tracer, positions, points, normals, lift)
    views, targets, owner = _views(positions, points, shown, rng)
    left, chosen = ~at_start[0], list[int]()
    while len(chosen) < _MOST_VIEWS and len(views):
        gains = (views & left).sum(axis=1)
        best = int(gains.argmax())
        if gains[best] < max(_LEAST_GAIN * len(points), 1):
            break
        chosen.append(best)
        left &= ~views[best]
    order = _short_way(np.asarray(start.position), positions[owner[chosen]])
    kept = np.array(chosen, int)[order]
    return positions[owner[kept]], targets[kept]


def _surface(scene: Scene, rng: np.random.Generator) -> tuple[Points, Points]:
    """Points spread evenly over all fronts and their unit normals, (n, 3) each."""
    corners = scene.corners.astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    share = np.cumsum(twice) / twice.sum()
    at = (np.arange(_SURFACE_POINTS) + rng.random(_SURFACE_POINTS)) / _SURFACE_POINTS
    triangle = np.minimum(np.searchsorted(share, at), len(share) - 1)
    u, v = rng.random((2, _SURFACE_POINTS))
    root = np.sqrt(u)
    weights = np.stack([1 - root, root * (1 - v), root * v], axis=1)
    points = np.einsum("nc,ncx->nx", weights, corners[triangle])
    return points, normal[triangle] / twice[triangle, None]


def _shown(
    tracer: RayTracer, positions: Points, points: Points, normals: Points, lift: float
) -> Marks:
    """Which fronts are in sight of which position, (positions, points)."""
    way = positions[:, None] - points
    length = np.linalg.norm(way, axis=2)
    cosine = (way * normals).sum(axis=2) / np.maximum(length, 1e-12)
    faces: Marks = cosine > _LEAST_COSINE
    which, point = np.nonzero(faces)
    origins = (points + lift * normals)[point]
    blocked = tracer.occluded(
        origins.astype(np.float32), (positions[which] - origins).astype(np.float32), 1.0
    )
    faces[which[blocked], point[blocked]] = False
    return faces


def _in_view(camera: Camera, target: Points, points: Points, fov_degrees: float) -> Marks:
    """Which points lie in the cone that fits into a camera's square image, (points,)."""
    axis = target - np.asarray(camera.position)
    cone: Marks = _in_cone(np.asarray(camera.position), axis[None], points, fov_degrees)[0]
    return cone


def _in_cone(position: Points, axes: Points, points: Points, fov_degrees: float) -> Marks:
    way = points - position
    along = axes @ way.T
    lengths = np.linalg.norm(axes, axis=1)[:, None] * np.linalg.norm(way, axis=1)
    inside: Marks = along >= math.cos(math.radians(fov_degrees) / 2) * lengths
    return inside


def _views(
    positions: Points, points: Points, shown: Marks, rng: np.random.Generator
) -> tuple[Marks, Points, npt.NDArray[np.int64]]:
    """From every position a few looks at points in sight: what they show, at what they look, and
    from which position.
    """
    views, targets, owner = list[Marks](), list[Points](), list[int]()
    for number, in_sight in enumerate(shown):
        candidates = np.flatnonzero(in_sight)
        looked_at = rng.permutation(candidates)[:_DIRECTIONS]
        cones = _in_cone(
            positions[number], points[looked_at] - positions[number], points, FLIGHT_FOV
        )
        views.extend(cones & in_sight)
        targets.extend(points[looked_at])
        owner.extend([number] * len(looked_at))
    shape = (-1, len(points))
    return (
        np.array(views, bool).reshape(shape),
        np.array(targets).reshape(-1, 3),
        np.array(owner, np.int64),
    )


def _short_way(start: Points, stops: Points) -> list[int]:
    """The stops' order when always going to the nearest."""
    left, order, here = list(range(len(stops))), list[int](), start
    while left:
        nearest = min(left, key=lambda i: float(np.linalg.norm(stops[i] - here)))
        left.remove(nearest)
        order.append(nearest)
        here = stops[nearest]
    return order
