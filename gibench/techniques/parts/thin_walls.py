"""Walls so thin that light which is stored in few places comes through them: measured by rays
through the scene's surfaces from behind, in shares of nothing but the scene.
"""

from __future__ import annotations

import weakref
from typing import Final

import numpy as np

from gibench.arrays import Doubles
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.model import Scene
from gibench.techniques.parts.free_space import points_on_surfaces

_POINTS: Final = 4096
MATTERS: Final = 0.05
"""Share of the surface that must be of such walls: a tile and a leaf are thin, too."""

_MEASURED: dict[tuple[int, ...], Doubles] = {}


def wall_thickness(scene: Scene) -> Doubles:
    """How thick what lies behind each of some thousand points of all fronts is, spread by area:
    straight on to the next front that looks the other way, m, ascending; infinite where there is
    none. Once for all scenes of the same triangles.
    """
    held = (scene.positions, scene.triangles)
    key = tuple(map(id, held))
    if key not in _MEASURED:
        _MEASURED[key] = _measure(scene)
        for part in held:
            weakref.finalize(part, _MEASURED.pop, key, None)
    return _MEASURED[key]


def _measure(scene: Scene) -> Doubles:
    points, normals = points_on_surfaces(scene, np.random.default_rng(13), _POINTS)
    return np.sort(thickness_behind(scene, points, normals))


def thickness_behind(scene: Scene, points: Doubles, normals: Doubles) -> Doubles:
    """As :func:`wall_thickness`, behind points (n, 3) of fronts with ``normals``; (n,), m."""
    lift = surface_offset(scene)
    # From a little in front: the back of a two-sided sheet may lie right behind, its own front not
    # be met a second time.
    origins = (points + lift * normals).astype(np.float32)
    hits = scene_tracer(scene).closest(origins, (-normals).astype(np.float32))
    thickness = np.full(len(points), np.inf)
    start, left = origins, np.arange(len(points))
    corners = scene.corners.astype(np.float64)
    for _ in range(8):  # faces that look this way are passed, the own one first
        met = hits.triangle >= 0
        start, left, hit = start[met], left[met], hits.triangle[met]
        far = hits.distance[met].astype(np.float64)
        c = corners[hit]
        facing = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
        leaves = (facing * normals[left]).sum(axis=1) < 0
        place = start.astype(np.float64) - far[:, None] * normals[left]
        out = left[leaves]
        thickness[out] = ((points[out] - place[leaves]) * normals[out]).sum(axis=1)
        left = left[~leaves]
        if not len(left):
            break
        start = (place[~leaves] - lift * normals[left]).astype(np.float32)
        hits = scene_tracer(scene).closest(start, (-normals[left]).astype(np.float32))
    return np.asarray(np.maximum(thickness, 0.0))


def leaking_walls(scene: Scene, reach: float, why: str, mend: str) -> list[str]:
    """What of a scene's walls is thinner than light that is looked up reaches.

    Args:
        scene: the scene.
        reach: m.
        why: what reaches so far, in words.
        mend: what would be better and what it costs, in words.
    """
    share = float((wall_thickness(scene) < reach).mean())
    if share <= MATTERS:
        return []
    return [
        f"{share:.0%} of the surface is of walls thinner than {reach:.2g} m, {why}: light and "
        f"darkness come through them; {mend}"
    ]
