"""Captured probes in float64 NumPy, from the formulas of McGuire et al. 2017 and Karis 2013."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.rays.embree import EmbreeTracer
from gibench.scene.model import Material, Scene
from gibench.techniques.parts.captured_probes.lobes import lobe_sides
from gibench.techniques.parts.captured_probes.maps import texel_solid_angles
from gibench.techniques.parts.conformance.octahedral import bordered, lookup, texel_directions
from gibench.techniques.parts.conformance.shading import (
    Surface,
    direct_irradiance,
    pixel_directions,
    render,
    surface,
)
from gibench.techniques.parts.split_sum import SPLIT_SUM_SIDE, split_sum_table

SMALL = {"counts": "3x2x2", "capture_texels": 12, "map_texels": 6, "relit_share": 0.4}
USABLE = 3


def randomise(technique: Any, rng: np.random.Generator) -> None:
    """Random states and maps with true borders."""
    held, device = technique.probes, technique.device
    data = device.read(held.placed.data)
    data[:, 3] = rng.permutation(np.resize([0, 1, USABLE, USABLE], len(data)))
    device.write(held.placed.data, data)
    device.write(held.irradiance, bordered(rng.uniform(0.1, 2.0, held.irradiance.shape)))
    if held.distance is not None:
        mean = rng.uniform(0.05, 0.6, held.distance.shape[:3])
        square = mean**2 + rng.uniform(0.0, 0.02, mean.shape)
        device.write(held.distance, bordered(np.stack([mean, square], axis=-1)))


def weights(technique: Any, position: Array, geometric: Array) -> Array:
    """What each probe counts (n, p) at points, as its formula says."""
    held, read = technique.probes, technique.device.read
    settings, volume = technique._settings, held.baked.volume
    visible = held.distance is not None
    point = position + (settings.surface_bias_in(volume) if visible else 0.0) * geometric
    state = read(held.placed.data)[:, 3]
    found = np.zeros((len(point), volume.probes))
    for probe, centre in enumerate(volume.positions):
        if state[probe] != USABLE:
            continue
        share = np.maximum(0, 1 - np.abs(point - centre) / np.array(volume.spacing)).prod(axis=1)
        if visible:
            away = point - centre
            meters = np.linalg.norm(away, axis=1)
            moments = lookup(read(held.distance)[probe].astype(np.float64), away / meters[:, None])
            share = share * chebyshev(
                meters / held.baked.far,
                settings.visibility_bias_in(volume) / held.baked.far,
                *moments.T,
            )
        found[:, probe] = share
    return found


def _mean(values: Array, share: Array) -> Array:
    """Over probes: values (n, p, 3) by share (n, p); 0 where none has one."""
    total = share.sum(axis=1)
    mean = np.einsum("npc,np->nc", values, share) / np.maximum(total, 1e-300)[:, None]
    return np.where(total[:, None] > 0, mean, 0.0)


def gather(technique: Any, position: Array, geometric: Array, normal: Array) -> Array:
    """Irradiance (n, 3) at points: every probe, weighed as its formula says."""
    maps = technique.device.read(technique.probes.irradiance).astype(np.float64)
    values = np.stack([lookup(own, normal)[:, :3] for own in maps], axis=1)
    return _mean(values, weights(technique, position, geometric))


def lobes_of(technique: Any) -> list[Array]:
    """Maps (p, s + 2, s + 2, 3) of each step of roughness, float64."""
    settings, probes = technique._settings, technique.probes.baked.volume.probes
    flat = technique.device.read(technique.probes.lobes).astype(np.float64)
    found = []
    for side in lobe_sides(settings.map_texels, settings.gloss_steps):
        count = probes * (side + 2) ** 2
        found.append(flat[:count, :3].reshape(probes, side + 2, side + 2, 3))
        flat = flat[count:]
    assert not len(flat)
    return found


def received(
    technique: Any,
    scene: Scene,
    position: Array,
    geometric: Array,
    mirrored: Array,
    roughness: Array,
) -> Array:
    """Radiance (n, 3) from where points mirror, averaged over lobes: each probe looks at where the
    ray leaves the scene's box.
    """
    low, high = scene.bounds
    with np.errstate(divide="ignore"):
        way = np.where(mirrored > 0, (high - position) / mirrored, (low - position) / mirrored)
    place = position + np.maximum(way, 0).min(axis=1)[:, None] * mirrored
    lobes, steps = lobes_of(technique), technique._settings.gloss_steps
    at = roughness * (steps - 1)
    lower = np.minimum(at.astype(int), steps - 2)
    values = np.zeros((len(position), technique.probes.baked.volume.probes, 3))
    for probe, centre in enumerate(technique.probes.baked.volume.positions):
        d = place - centre
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        each = np.stack([lookup(own[probe], d) for own in lobes])
        n = np.arange(len(d))
        part = (at - lower)[:, None]
        values[:, probe] = (1 - part) * each[lower, n] + part * each[lower + 1, n]
    return _mean(values, weights(technique, position, geometric))


def prefiltered(radiance: Array, side: int, steps: int) -> list[Array]:
    """Maps (k, t, 3) of each step of radiance (k, side^2, 3): means by D(h) n . l about n."""
    source, angle = texel_directions(side), texel_solid_angles(side)
    found = [radiance]
    for step, own in list(enumerate(lobe_sides(side, steps)))[1:]:
        n, alpha = texel_directions(own), (step / (steps - 1)) ** 2
        half = n[:, None] + source
        half /= np.maximum(np.linalg.norm(half, axis=2, keepdims=True), 1e-12)
        n_h = np.einsum("tx,tjx->tj", n, half)
        facets = alpha**2 / (np.pi * (n_h**2 * (alpha**2 - 1) + 1) ** 2)
        weight = facets * np.maximum(0, n @ source.T) * angle
        mean = np.einsum("tj,kjc->ktc", weight, radiance)
        found.append(mean / weight.sum(axis=1)[None, :, None])
    return found


def within_reach(technique: Any, position: Array, geometric: Array) -> Array:
    """Points (n,) not within a thousandth of where a probe's trilinear share begins or ends, where
    single precision knows little of the share."""
    held, settings = technique.probes, technique._settings
    volume = held.baked.volume
    point = (
        position
        + (settings.surface_bias_in(volume) if held.distance is not None else 0.0) * geometric
    )
    cells = np.abs(point[:, None] - volume.positions) / np.array(volume.spacing)
    return np.asarray((np.abs(1 - cells) > 1e-3).all(axis=(1, 2)))


def chebyshev(distance: Array, bias: float, mean: Array, square: Array) -> Array:
    """The cubed bound (Donnelly and Lauritzen 2006)."""
    variance = np.abs(mean**2 - square)
    behind = distance - bias - mean
    bound = variance / np.maximum(variance + behind**2, 1e-300)
    return np.where(behind > 0, bound**3, 1.0)


def relit(technique: Any, scene: Scene, frame: int, probes: Array) -> tuple[Array, Array]:
    """Radiance (k, t, 3) of ``probes``, and which of it (k, t) no shadow ray's luck decides."""
    held, read = technique.probes, technique.device.read
    hits = read(held.capture["captured_hits"])[probes]
    albedo = read(held.capture["captured_albedo"])[probes][..., :3].astype(np.float64)
    found = read(held.capture["captured_emission"])[probes][..., :3].astype(np.float64)
    certain = np.ones(hits.shape[:2], bool)
    front = hits[..., 0] != 0xFFFFFFFF
    u, v = (hits[front][:, 1] & 0xFFFF) / 65535, (hits[front][:, 1] >> 16) / 65535
    at = surface(scene, hits[front][:, 0].astype(int), u, v)
    lit = direct_irradiance(scene, frame, at.position, at.normal, at.geometric)
    irradiance = lit.irradiance
    if technique._settings.bounce_count != 1:
        irradiance = irradiance + gather(technique, at.position, at.geometric, at.normal)
    found[front] += albedo[front] / np.pi * irradiance
    certain[front] = lit.certain
    return found, certain


def filtered_irradiance(radiance: Array, side: int) -> Array:
    """Irradiance (k, t, 3) about the texels of radiance (k, t, 3)."""
    d = texel_directions(side)
    weights = np.maximum(0, d @ d.T) * texel_solid_angles(side)
    mean = np.einsum("tj,kjc->ktc", weights, radiance)
    return np.asarray(np.pi * mean / weights.sum(axis=1)[None, :, None])


def filtered_moments(moments: Array, side: int, sharpness: float) -> Array:
    """Means (k, t, 2) of moments (k, t, 2) over a lobe of a power of the cosine."""
    d = texel_directions(side)
    weights = np.maximum(0, d @ d.T) ** sharpness
    return np.asarray(
        np.einsum("tj,kjc->ktc", weights, moments) / weights.sum(axis=1)[None, :, None]
    )


def inner(maps: Array) -> Array:
    """Maps (p, s + 2, s + 2, c) without their borders, (p, s * s, c)."""
    side = maps.shape[1] - 2
    return maps[:, 1:-1, 1:-1].reshape(len(maps), side * side, -1).astype(np.float64)


def table(n_v: Array, roughness: Array) -> Array:
    """The split sum's table, bilinear, (n, 2)."""
    at = np.clip(np.stack([n_v, roughness]) * SPLIT_SUM_SIDE - 0.5, 0, SPLIT_SUM_SIDE - 1)
    i, j = first = np.minimum(at.astype(int), SPLIT_SUM_SIDE - 2)
    a, b = (at - first)[..., None]
    t = split_sum_table().astype(np.float64)
    upper = (1 - a) * t[j, i] + a * t[j, i + 1]
    return np.asarray((1 - b) * upper + b * ((1 - a) * t[j + 1, i] + a * t[j + 1, i + 1]))


def seen(scene: Scene, image: tuple[int, int]) -> tuple[Array, Array, Surface, list[Material]]:
    """What the camera's pixels show: which (n,) surely a front, direction, surface, material."""
    camera = scene.cameras[0]
    d = pixel_directions(camera, *image)
    eye = np.broadcast_to(np.array(camera.position), d.shape).astype(np.float32)
    hits = EmbreeTracer(scene.corners).closest(eye, d.astype(np.float32))
    certain = render(scene, 0, *image).certain.ravel() & (hits.triangle >= 0)
    triangle = np.maximum(hits.triangle, 0)
    at = surface(scene, triangle, hits.u.astype(float), hits.v.astype(float))
    certain &= np.einsum("nx,nx->n", at.geometric, d) < 0
    materials = [scene.materials[i] for i in scene.material_ids[triangle]]
    return certain, d, at, materials


def expected_image(technique: Any, scene: Scene, image: tuple[int, int]) -> tuple[Array, Array]:
    """The indirect part of the image (n, 3), and where it is certain."""
    certain, d, at, materials = seen(scene, image)
    roughness = np.array([m.roughness for m in materials])
    metalness = np.array([m.metalness for m in materials])[:, None]
    facing = np.einsum("nx,nx->n", d, at.normal)
    mirrored = d - 2 * facing[:, None] * at.normal
    mirrored /= np.linalg.norm(mirrored, axis=1, keepdims=True)
    light = received(technique, scene, at.position, at.geometric, mirrored, roughness)
    both = table(np.abs(facing), roughness)
    f0 = 0.04 + metalness * (at.albedo - 0.04)
    share = f0 * both[:, :1] + both[:, 1:]
    irradiance = gather(technique, at.position, at.geometric, at.normal)
    diffuse = at.albedo / np.pi * (1 - metalness) * (1 - share) * irradiance
    certain &= within_reach(technique, at.position, at.geometric)
    return diffuse + share * light, certain
