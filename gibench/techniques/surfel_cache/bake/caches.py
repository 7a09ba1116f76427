"""Caches: on a light map of their own and in a grid (Jendersie et al. 2016, section 4.4)."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Doubles, Floats
from gibench.rays.tracer import NO_HIT, RayTracer
from gibench.scene.model import Scene
from gibench.techniques.parts.directions import spherical_fibonacci
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.surfel_cache.bake.data import Atlas, Caches
from gibench.techniques.surfel_cache.sh import COEFFICIENTS, basis

# Rays of a cache that tell whether it lies inside geometry, and those that see the environment.
_INSIDE_RAYS = 128
_ENVIRONMENT_RAYS = 1024
# Share of rays that meet a surface's back from which on a cache lies inside: in the grid that of
# RTXGI-DDGI 1.3.7 for probes, on a surface half of those on its side.
_BACKS_IN_GRID, _BACKS_ON_MAP = 0.25, 0.5
_BATCH = 2048


def place_caches(
    scene: Scene,
    atlas: Atlas,
    volume: Volume,
    tracer: RayTracer,
    offset: float,
    leave_out: bool = True,
) -> Caches:
    """The caches that do not lie inside geometry, and what they see of the environment.

    Args:
        scene: the scene.
        atlas: the map.
        volume: the grid.
        tracer: of the scene.
        offset: that rays start off surfaces by, m.
        leave_out: caches inside geometry; else all are kept.
    """
    dark = not np.asarray(scene.environment.pixels).any()
    rays = spherical_fibonacci(_INSIDE_RAYS if dark else _ENVIRONMENT_RAYS)
    grid = volume.positions
    kept, seen = [], []
    for position, normal, most in (
        (atlas.position + offset * atlas.normal, atlas.normal, _BACKS_ON_MAP),
        (grid.astype(np.float32), None, _BACKS_IN_GRID),
    ):
        found = [
            _seen(scene, part, None if normal is None else normal[own], tracer, rays, dark)
            for own in _batches(len(position))
            for part in [position[own]]
        ]
        kept.append(np.concatenate([(backs < most) | (not leave_out) for backs, _ in found]))
        if not dark:
            seen.append(np.concatenate([light for _, light in found])[kept[-1]])
    environment = None if dark else np.concatenate(seen).astype(np.float16)
    return Caches(atlas, volume, kept[0], kept[1], environment)


def _batches(count: int) -> list[slice]:
    return [slice(i, i + _BATCH) for i in range(0, count, _BATCH)]


def _seen(
    scene: Scene,
    position: Floats,
    normal: Floats | None,
    tracer: RayTracer,
    rays: Doubles,
    dark: bool,
) -> tuple[Doubles, Doubles]:
    """Share of rays that meet backs, (n,), and the environment's projection, (n, 16, 3).

    With a normal only the rays of its side count.
    """
    own, ray = np.divmod(np.arange(len(position) * len(rays)), len(rays))
    if normal is not None:
        above = np.einsum("ij,ij->i", rays[ray], normal[own].astype(np.float64)) > 0
        own, ray = own[above], ray[above]
    direction = rays[ray].astype(np.float32)
    hits = tracer.closest(position[own], direction)
    hit = hits.triangle != NO_HIT
    corners = scene.corners[hits.triangle[hit]].astype(np.float64)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    back = np.einsum("ij,ij->i", facing, direction[hit].astype(np.float64)) > 0
    count = np.maximum(np.bincount(own, minlength=len(position)), 1)
    backs = np.bincount(own[hit][back], minlength=len(position)) / count
    light = np.zeros((len(position), COEFFICIENTS, 3))
    if not dark:
        free = np.flatnonzero(~hit)
        radiance = scene.environment.radiance(rays[ray[free]])
        terms = basis(rays[ray[free]])[:, :, None] * radiance[:, None, :] * (4 * np.pi / len(rays))
        if len(free):
            first = np.flatnonzero(np.diff(own[free], prepend=-1))
            light[own[free][first]] = np.add.reduceat(terms, first, axis=0)
    return np.asarray(backs), light
