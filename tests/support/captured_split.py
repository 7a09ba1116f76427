"""glossy-box: what of the error of gloss is the split sum's, no probe involved.

Usage: PYTHONPATH=.:tests python tests/support/captured_split.py [PIXELS [DIRECTIONS]] prints the
last column of the table of gloss in docs/light-field-probes.md: the radiance that arrives at a
pixel's own point, path-traced, weighed as a prefiltered map weighs it and taken times the split
sum's table, against the whole integral over the same directions.
"""

from __future__ import annotations

import sys

import numpy as np
from techniques.parts.test_parts_split_sum import reflectance

from gibench.scene.lightmap.albedo import mean_albedo
from gibench.scene.load import load_scene
from gibench.techniques.parts.captured_probes.lighting import direct_irradiance
from gibench.techniques.parts.conformance.shading import pixel_directions
from gibench.techniques.parts.split_sum import split_sum
from support.captured_court import Court

ROUGHNESS = (0.25, 0.5, 0.75, 1.0)
METAL = 0.8  # the strips' reflectance along the normal
WIDTH, HEIGHT = 40, 22


def arriving(court: Court, at, directions) -> np.ndarray:
    """Radiance (n, 3) at points along directions (n, 3), by many bounces; nothing of the sky."""
    start = (at.position + court.step * at.geometric).astype(np.float32)
    hits = court.tracer.closest(start, directions.astype(np.float32))
    hit = hits.triangle >= 0
    triangle = hits.triangle[hit].astype(np.int64)
    front = np.einsum("nx,nx->n", court.face[triangle], directions[hit]) < 0
    u, v = hits.u[hit].astype(float), hits.v[hit].astype(float)
    there = court.points(triangle, u, v)
    pieces = np.repeat(np.stack([1 - u - v, u, v], axis=1)[:, None], 3, axis=1)
    albedo = mean_albedo(court.scene, triangle, pieces)
    lit = direct_irradiance(court.scene, court.lights, court.tracer, there)
    lit = lit + court.traced(there, 2)[0]
    found = np.zeros((len(directions), 3))
    found[hit] = np.where(front[:, None], albedo / np.pi * lit, 0.0)
    return found


def main(pixels: int = 40, count: int = 512) -> None:
    """Print a row a roughness."""
    scene = load_scene("glossy-box")
    court = Court(scene, np.random.default_rng(1))
    camera, names = scene.cameras[0], [material.name for material in scene.materials]
    ways = pixel_directions(camera, WIDTH, HEIGHT)
    eye = np.broadcast_to(np.array(camera.position), ways.shape)
    hits = court.tracer.closest(eye.astype(np.float32), ways.astype(np.float32))
    material = np.where(hits.triangle >= 0, scene.material_ids[hits.triangle], -1)
    for roughness in ROUGHNESS:
        own = np.flatnonzero(material == names.index(f"roughness {roughness:g}"))
        own = court.rng.permutation(own)[:pixels]
        u, v = hits.u[own].astype(float), hits.v[own].astype(float)
        at, view = court.points(hits.triangle[own], u, v), -ways[own]
        normal = at.normal
        mirrored = 2 * np.einsum("nx,nx->n", normal, view)[:, None] * normal - view
        light = court.rng.normal(size=(len(own), count, 3))
        light /= np.linalg.norm(light, axis=2, keepdims=True)
        up = np.einsum("nkx,nx->nk", light, normal)
        light = np.where(up[..., None] < 0, light - 2 * up[..., None] * normal[:, None], light)
        every = type(at)(*(np.repeat(a, count, axis=0) for a in vars(at).values()))
        radiance = arriving(court, every, light.reshape(-1, 3)).reshape(light.shape)
        rough = np.full((len(own), count), roughness)
        f = reflectance(normal[:, None], view[:, None], light, rough, np.full(light.shape, METAL))
        true = 2 * np.pi * (f * radiance * np.abs(up)[..., None]).mean(axis=1)
        alpha, cosine = roughness**2, np.einsum("nkx,nx->nk", light, mirrored)
        off = 0.5 - 0.5 * cosine
        weight = np.maximum(cosine, 0) / (off + alpha**2 * (1 - off)) ** 2
        mean = (weight[..., None] * radiance).sum(axis=1) / weight.sum(axis=1)[:, None]
        table = split_sum(np.abs(np.einsum("nx,nx->n", normal, view)), np.full(len(own), roughness))
        found = (METAL * table[:, :1] + table[:, 1:]) * mean
        bias = found.sum() / true.sum() - 1
        l2 = np.sqrt(((found - true) ** 2).sum() / (true**2).sum())
        print(f"| {roughness:g} | {bias:+.0%}, {l2:.0%} |", flush=True)


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
