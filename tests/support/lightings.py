"""Random lightings, and what probes see of their direct light."""

from __future__ import annotations

import numpy as np

from gibench.rays.tracer import RayTracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import RelightSamples
from gibench.techniques.srp.bake.sampling import sphere_directions, triangle_planes

# Lights that reach less of the receivers than this are drawn again.
LEAST_LIT = 0.01


def in_solid(scene: Scene, tracer: RayTracer, point: np.ndarray) -> bool:
    """Whether most of what ``point`` (3,) float32 sees are backs of surfaces.

    A light in there shines on slivers where solids meet, such as a floor beneath a block: nothing
    that anyone sees, or that a probe was placed for.
    """
    directions = sphere_directions(256, np.random.default_rng(0)).astype(np.float32)
    start = np.ascontiguousarray(np.broadcast_to(point, directions.shape))
    triangle = tracer.closest(start, directions).triangle
    normals = triangle_planes(scene.corners)[:, :3]
    back = (triangle >= 0) & (np.einsum("nx,nx->n", normals[triangle], directions) > 0)
    return bool(back.mean() > 0.5)


def point_light(
    scene: Scene, lightmap: Lightmap, tracer: RayTracer, rng: np.random.Generator, lift: float
) -> np.ndarray:
    """(n,) irradiance by a random point light with shadows."""
    r = lightmap.receivers
    low, high = scene.bounds
    for _ in range(100):
        light = (low + (high - low) * rng.uniform(0.1, 0.9, 3)).astype(np.float32)
        if in_solid(scene, tracer, light):
            continue
        toward = (r.position + lift * r.normal - light).astype(np.float32)
        distance = np.linalg.norm(toward, axis=1)
        cosine = np.maximum(0, -(toward * r.normal).sum(axis=1) / distance)
        from_light = np.ascontiguousarray(np.broadcast_to(light, toward.shape))
        cosine[tracer.occluded(from_light, toward, 1 - 1e-4)] = 0
        if (cosine > 0).mean() >= LEAST_LIT:
            nearest = 0.01 * float((high - low).max())
            return cosine / np.maximum(distance, nearest) ** 2
    raise ValueError("no point of the scene's box lights it")


def sun(lightmap: Lightmap, tracer: RayTracer, rng: np.random.Generator, lift: float) -> np.ndarray:
    """(n,) irradiance by a sun at least 17 degrees above the horizon, with shadows."""
    r = lightmap.receivers
    for _ in range(100):
        toward = rng.standard_normal(3)
        toward = (toward / np.linalg.norm(toward)).astype(np.float32)
        if toward[1] < 0.3:
            continue
        cosine = np.maximum(0, r.normal @ toward)
        start = (r.position + lift * r.normal).astype(np.float32)
        directions = np.ascontiguousarray(np.broadcast_to(toward, start.shape))
        cosine[tracer.occluded(start, directions, 1e6)] = 0
        if (cosine > 0).mean() >= LEAST_LIT:
            return cosine
    raise ValueError("no sun reaches the scene")


def probe_radiance(
    lightmap: Lightmap, relight: RelightSamples, irradiance: np.ndarray
) -> np.ndarray:
    """(p, c, i) radiance of the probes under the receivers' ``irradiance`` (n, i), once bounced."""
    r = lightmap.receivers
    black = lightmap.width * lightmap.height
    radiance = np.zeros((black + 1, irradiance.shape[1]))
    radiance[r.texel] = irradiance * r.albedo.mean(axis=1)[:, None] / np.pi
    seen = np.where(relight.texel >= 0, relight.texel, black)
    basis = relight.basis.astype(np.float64).T
    return np.stack([basis @ radiance[of_probe] for of_probe in seen])
