"""Light that SRP's placed probes do not see arrive, as on a model's outside: a ray whose end no
probe around its receiver sees is left out of the transport (Bennett 2019, eq. 4.6).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import SHORT_OF_TARGET, surface_offset
from gibench.rays.tracer import Hits
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.parts.free_space import cosine_directions, lamps_at, points_on_surfaces
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.relight import texels_of_hits

_POINTS: Final = 2048
_LOOKS: Final = 8  # cosine-distributed rays from each


def unseen_light(scene: Scene, lightmap: Lightmap, probes: ProbeSet) -> float:
    """Share of the light of the sky, and of the lamps' reflected once, that falls on surfaces which
    stay black, as of no ray from there the end is seen by a probe in reach; 0 to 1.

    Args:
        scene: the scene.
        lightmap: its receivers, whose albedo reflects.
        probes: as they are placed.
    """
    rng = np.random.default_rng(23)
    tracer, lift = scene_tracer(scene), surface_offset(scene)
    points, normals = points_on_surfaces(scene, rng, _POINTS)
    origins = np.repeat(points + lift * normals, _LOOKS, axis=0)
    directions = cosine_directions(np.repeat(normals, _LOOKS, axis=0), rng).astype(np.float32)
    hits = tracer.closest(origins.astype(np.float32), directions)
    ends, facing = _ends(scene, hits, lift)
    light = _light(scene, lightmap, hits, directions, ends, facing)
    seen = _seen(scene, probes, origins, directions, hits.triangle < 0, ends, facing)
    black = ~seen.reshape(-1, _LOOKS).any(axis=1)
    total = float(light.sum())
    return float(light.reshape(-1, _LOOKS)[black].sum()) / total if total > 0 else 0.0


def _ends(scene: Scene, hits: Hits, lift: float) -> tuple[Doubles, Doubles]:
    """What rays hit, lifted off it, and its unit normals, (n, 3) each; of no meaning where nothing
    is hit.
    """
    c = scene.corners[np.maximum(hits.triangle, 0)].astype(np.float64)
    u, v = (of.astype(np.float64)[:, None] for of in (hits.u, hits.v))
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    return c[:, 0] * (1 - u - v) + c[:, 1] * u + c[:, 2] * v + lift * normal, normal


def _light(
    scene: Scene, lightmap: Lightmap, hits: Hits, directions: npt.NDArray[np.float32],
    ends: Doubles, facing: Doubles,
) -> Doubles:  # fmt: skip
    """What each ray (n,) brings, W/m2: the sky's, or what a front reflects of the lamps'."""
    away = hits.triangle < 0
    found = np.zeros(len(away))
    if away.any():
        radiance = scene.environment.radiance(directions[away]).mean(axis=1)
        found[away] = np.pi * radiance.astype(np.float64)
    texel = texels_of_hits(lightmap, hits)
    front = np.flatnonzero((texel >= 0) & ((facing * directions).sum(axis=1) < 0))
    lamps = lamps_at(scene, ends[front], facing[front], ends[front].astype(np.float32))
    albedo = lightmap.receivers.albedo[lightmap.receiver_of_texel[texel[front]]].mean(axis=1)
    found[front] = lamps * albedo
    return found


def _seen(
    scene: Scene, probes: ProbeSet, origins: Doubles, directions: npt.NDArray[np.float32],
    away: npt.NDArray[np.bool_], ends: Doubles, facing: Doubles,
) -> npt.NDArray[np.bool_]:  # fmt: skip
    """Of which rays (n,) a probe in reach of where they begin sees the end; of a ray that leaves
    the scene, whether it sees the sky that way.
    """
    tracer = scene_tracer(scene)
    seen = np.zeros(len(away), np.bool_)
    for probe in probes.placed.positions.astype(np.float64):
        open_ = ~seen & (((origins - probe) ** 2).sum(axis=1) < probes.radius**2)
        for which, limit in ((open_ & away, np.inf), (open_ & ~away, 1 - SHORT_OF_TARGET)):
            rays = np.flatnonzero(which)
            way = directions[rays].astype(np.float64) if limit == np.inf else ends[rays] - probe
            if limit != np.inf:
                before = (way * facing[rays]).sum(axis=1) < 0
                rays, way = rays[before], way[before]
            if len(rays):
                start = np.broadcast_to(probe.astype(np.float32), way.shape)
                seen[rays] = ~tracer.occluded(start, way.astype(np.float32), limit)
    return seen
