"""What rays meet and what comes back along them: Embree finds the triangle, float64 the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Array
from gibench.rays.embree import EmbreeTracer
from gibench.scene.model import Scene
from gibench.techniques.parts.conformance.shading import (
    STEP_BACK,
    PlaneHits,
    Surface,
    direct_irradiance,
    surface,
    unshadowed,
)

Lookup = Callable[[Array, Array], tuple[Array, Array]]
"""Irradiance (n, 3) at points (n, 3) with normals (n, 3), and where (n,) it is certain."""

_NEAR = 2e-4
"""How far off a direction another must meet the same triangle: a hundred times what single
precision makes of a direction."""


@dataclass
class Met:
    """What rays meet."""

    triangle: Array  # (n,), -1 where nothing
    certain: Array  # (n,) no edge within a hair, and not about as far as the ray goes


def met(
    tracer: EmbreeTracer,
    rng: np.random.Generator,
    origin: Array,
    direction: Array,
    limit: Array | None = None,
) -> Met:
    """What rays from origins (n, 3) in directions (n, 3) meet within ``limit`` (n,), m."""
    start = np.ascontiguousarray(origin, np.float32)
    reach = np.inf if limit is None else np.ascontiguousarray(limit, np.float32)
    first = tracer.closest(start, np.ascontiguousarray(direction, np.float32), reach)
    certain = np.ones(len(start), bool)
    for _ in range(8):
        near = direction + _NEAR * rng.normal(size=direction.shape)
        certain &= tracer.closest(start, near.astype(np.float32), reach).triangle == first.triangle
    if limit is not None:
        free = tracer.closest(start, np.ascontiguousarray(direction, np.float32))
        with np.errstate(invalid="ignore"):  # inf - inf
            certain &= ~(np.abs(free.distance - reach) < 1e-3)
    return Met(first.triangle, certain)


def sent_back(
    scene: Scene, frame: int, triangle: Array, plane: PlaneHits, direction: Array, indirect: Lookup
) -> tuple[Array, Array]:
    """Radiance (n, 3) that hits send back along their rays, and where (n,) it is certain: no shadow
    ray passes an edge within a hair, and what single precision makes of the hit moves no light by
    over a thousandth.

    ``triangle`` (n,) are all hits; backs send nothing.
    """
    front = np.einsum("ij,ij->i", plane.geometric, direction) < 0

    def light(u: Array, v: Array, direct: Callable[[Surface], Array]) -> tuple[Array, Array]:
        found = surface(scene, triangle, u, v)
        looked_up, known = indirect(found.position, found.normal)
        radiance = found.emission + found.albedo / np.pi * (direct(found) + looked_up)
        return np.where(front[:, None], radiance, 0.0), known

    def unoccluded(found: Surface) -> Array:
        return unshadowed(scene.lights_at(frame), found.position, found.normal)

    here = surface(scene, triangle, plane.u, plane.v)
    lit = direct_irradiance(scene, frame, here.position, here.normal, plane.geometric, STEP_BACK)
    radiance, known = light(plane.u, plane.v, lambda _: lit.irradiance)
    open_sky, _ = light(plane.u, plane.v, unoccluded)
    certain = (lit.certain & known) | ~front
    for du, dv in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        u, v = plane.u + du * plane.slack_u, plane.v + dv * plane.slack_v
        moved, _ = light(u, v, unoccluded)
        certain &= (np.abs(moved - open_sky) <= 1e-5 + 1e-3 * np.abs(open_sky)).all(axis=1)
    return radiance, certain
