"""DDGI's kernels against float64 NumPy and Embree, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.device import SIMT, WIDE, Layout
from gibench.rays.embree import EmbreeTracer
from gibench.techniques.ddgi import conform_view
from gibench.techniques.ddgi.conform_made import made
from gibench.techniques.ddgi.conform_oracle import (
    DISTANCE,
    FAR,
    IRRADIANCE,
    OFFSET,
    VARIABILITY,
    VARIATION,
    State,
    bias_of,
    blended_distance,
    blended_irradiance,
    classified,
    gather,
    randomise,
    relocated,
    shade,
    state_of,
)
from gibench.techniques.parts.conformance.case import (
    Bench,
    Case,
    at_least,
    off,
    run_pass,
)
from gibench.techniques.parts.conformance.octahedral import bordered
from gibench.techniques.parts.conformance.shading import PlaneHits


def _inner(maps: Array) -> Array:
    """Maps without their borders, texels in a row, float64."""
    return maps[:, 1:-1, 1:-1].reshape(len(maps), -1, maps.shape[-1]).astype(np.float64)


def _trace(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """What probes' rays hit."""
    technique = made(bench, rng, size)
    randomise(technique, rng)
    technique.begin_frame(size)
    run_pass(technique, "probe_trace", size)
    s = state_of(technique)
    scene = technique.scene.scene
    origin = np.repeat(s.position, s.settings.rays, axis=0).astype(np.float32)
    direction = np.tile(s.directions, (len(s.state), 1))
    tracer = EmbreeTracer(scene.corners)
    hits = tracer.closest(origin, direction.astype(np.float32))
    certain = np.ones(len(origin), np.bool_)
    for _ in range(4):
        near = direction + rng.uniform(-1, 1, direction.shape) * 2e-4
        certain &= tracer.closest(origin, near.astype(np.float32)).triangle == hits.triangle
    shape, fixed = (len(s.state), s.settings.rays), s.settings.fixed
    # Embree's distance is single precision; the plane's own is not.
    met = np.flatnonzero(hits.triangle >= 0)
    plane = PlaneHits.of(scene.corners[hits.triangle[met]], origin[met], direction[met])
    certain[met] &= plane.slack_t < 1e-4 * plane.t
    exact, back = hits.distance.astype(np.float64), np.zeros(len(origin), np.bool_)
    exact[met] = plane.t
    back[met] = np.einsum("rc,rc->r", plane.geometric, direction[met]) > 0
    triangle, distance = hits.triangle.reshape(shape), exact.reshape(shape)
    certain, back = certain.reshape(shape), back.reshape(shape)
    yield at_least(float(certain.mean()), 0.9)
    signed = np.where(triangle < 0, FAR, np.where(back, -distance, distance))
    which = certain[:, :fixed]
    found = technique.device.read(technique.probes.fixed_distance)
    yield off(found[which], signed[:, :fixed][which], relative=3e-4)
    hit = technique.device.read(technique.probes.hits)
    which = certain[:, fixed:] & (s.state & 1).astype(bool)[:, None]
    ids = np.ascontiguousarray(hit[..., 3]).view(np.int32)
    yield off(ids[which], triangle[:, fixed:][which])
    struck = which & (triangle[:, fixed:] >= 0)
    yield off(hit[..., 0][struck], distance[:, fixed:][struck], relative=3e-4)


def _shade(bench: Bench, rng: np.random.Generator, size: int, variant: str) -> Iterator[float]:
    """The light at what probes' rays hit."""
    technique = made(bench, rng, size, variant)
    randomise(technique, rng, states=(0, 1, 3, 3))
    technique.begin_frame(17 + size)
    run_pass(technique, "probe_trace", 64)
    run_pass(technique, "probe_shade", size)
    s = state_of(technique)
    active = (s.state & 1).astype(bool)
    hit = technique.device.read(technique.probes.hits)[active].reshape(-1, 4)
    triangle = np.ascontiguousarray(hit[:, 3]).view(np.int32)
    direction = np.tile(s.directions[s.settings.fixed :], (int(active.sum()), 1))
    chosen = rng.choice(len(hit), 200, replace=False)
    t, u, v = hit[chosen, :3].astype(np.float64).T
    radiance, distance, certain = shade(
        technique.scene.scene, 17 + size, s, direction[chosen], (t, u, v, triangle[chosen])
    )
    yield at_least(float(certain.mean()), 0.8)
    found, kept = rays_of(technique)
    found = found[active].reshape(-1, 3)[chosen]
    yield off(found[certain], radiance[certain], 5e-4, 1e-5)
    kept = kept[active].reshape(len(hit), -1)[chosen]
    if variant == "published":
        yield off(kept[certain, 0], distance[certain], 1e-6)
        return
    d = np.minimum(np.where(distance < 0, -0.2 * distance, distance), s.longest) / s.longest
    yield off(kept[certain], np.stack([distance >= 0, d, d**2], axis=1)[certain], 1e-5)


def rays_of(technique: Any) -> tuple[Array, Array]:
    """What probe_shade stored: radiance (p, b, 3) and signed distance or what is blended of it."""
    stored = technique.device.read(technique.blending.rays).astype(np.float64)
    count = technique.probes.volume.probes
    if technique.blending.lanes == 1:
        return stored[..., :3], stored[..., 3]
    lanes = np.moveaxis(stored, 3, 1).reshape(-1, *stored.shape[1:3])[:count]
    return lanes[..., :3], lanes[..., 3:]


def store_rays(technique: Any, s: State, radiance: Array, distance: Array) -> None:
    """Write rays in the variant's layout (kernels_cl/ddgi/rays.cl)."""
    if technique.blending.lanes == 1:
        packed = np.concatenate([radiance, distance[..., None]], axis=2)
    else:
        lanes, count = technique.blending.lanes, len(radiance)
        d = np.minimum(np.where(distance < 0, -0.2 * distance, distance), s.longest) / s.longest
        front = distance >= 0
        planes = [radiance * front[..., None], front[..., None], d[..., None], d[..., None] ** 2]
        full = np.zeros((-(-count // lanes) * lanes, radiance.shape[1], 6))
        full[:count] = np.concatenate(planes, axis=2)
        packed = np.moveaxis(full.reshape(-1, lanes, *full.shape[1:]), 1, 3)
    technique.device.write(technique.blending.rays, packed)


def _blend(
    bench: Bench,
    rng: np.random.Generator,
    size: int,
    variant: str,
    layout: Layout | None = None,
) -> Iterator[float]:
    """Moving averages of irradiance and of distance."""
    # 700 bytes of local memory hold 25 of 41 rays for irradiance, 43 for distance.
    local_memory = 16384 if layout == SIMT else 700
    technique = made(bench, rng, size, variant, local_memory, layout, storage="fp32")
    randomise(technique, rng, states=(0, 1, 3, 3))
    technique.begin_frame(3)
    s, device, probes = state_of(technique), technique.device, technique.probes
    shape = (len(s.state), s.settings.blended)
    radiance = (10.0 ** rng.uniform(-1, 1, (*shape, 3))).astype(np.float32).astype(np.float64)
    distance = rng.uniform(0.01, 1.3, shape) * s.longest
    distance[rng.random(shape) < 0.1] = FAR
    distance *= np.where(rng.random(shape) < rng.uniform(0, 0.4, (shape[0], 1)), -1, 1)
    distance = distance.astype(np.float32).astype(np.float64)
    store_rays(technique, s, radiance, distance)
    device.write(probes.accepted, np.full(len(s.state), -1))
    run_pass(technique, "blend_irradiance", size)
    run_pass(technique, "blend_distance", size)
    maps, variation, accepted, certain = blended_irradiance(s, radiance, distance)
    active = (s.state & 1).astype(bool)
    yield off(device.read(probes.accepted), np.where(active, accepted, -1))
    taken = active & accepted
    before = _inner(s.irradiance)[..., :3]
    found = _inner(device.read(probes.irradiance))[..., :3]
    yield off(found[~taken], before[~taken])
    which = taken[:, None] & certain
    yield off(found[which], maps[which], IRRADIANCE.relative)
    found = device.read(probes.variability)
    yield off(found[which], variation[which], VARIATION.relative, VARIATION.absolute)
    expected = np.where(active[:, None, None], blended_distance(s, distance), _inner(s.distance))
    found = _inner(device.read(probes.distance))
    yield off(found, expected, DISTANCE.relative, DISTANCE.absolute)


def _borders(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Borders of octahedral maps repeat the texel across the fold."""
    technique = made(bench, rng, size, irradiance_texels=4 + size % 5, distance_texels=7)
    expected = []
    for maps in (technique.probes.irradiance, technique.probes.distance):
        values = rng.uniform(0, 2, maps.shape).astype(maps.dtype)
        technique.device.write(maps, values)
        expected.append(bordered(values))
    run_pass(technique, "border_copy", size)
    yield off(technique.device.read(technique.probes.irradiance), expected[0])
    yield off(technique.device.read(technique.probes.distance), expected[1])


def _moving(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Relocation and classification of probes."""
    technique = made(bench, rng, size, counts="9x7x6", min_frontface_distance=0.4)
    randomise(technique, rng)
    s, device, probes = state_of(technique), technique.device, technique.probes
    shape = (len(s.state), s.settings.fixed)
    reach = rng.uniform(0.05, 3.0, (shape[0], 1)) * s.longest
    distance = rng.uniform(0.02, 1, shape) * reach
    distance[rng.random(shape) < 0.1] = FAR
    distance *= np.where(rng.random(shape) < rng.uniform(0, 0.5, (shape[0], 1)), -1, 1)
    distance = distance.astype(np.float32).astype(np.float64)
    device.write(probes.fixed_distance, distance)
    accepted = rng.integers(0, 2, shape[0])
    device.write(probes.accepted, accepted)
    run_pass(technique, "relocation", size)
    found = state_of(technique)
    yield off(found.state, s.state)
    yield off(found.offset, relocated(s, distance), OFFSET.relative, OFFSET.absolute)
    run_pass(technique, "classification", size)
    after = state_of(technique)
    yield off(after.state, classified(s, distance, accepted))
    yield off(after.offset, found.offset)


def _variability(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """The mean over all texels of probes in use."""
    settings: Mapping[str, Any] = {"counts": "20x10x10", "rays": 14, "irradiance_texels": 6}
    technique = made(bench, rng, size, **settings)
    randomise(technique, rng, states=(0, 1, 2, 3, 3))
    values = rng.lognormal(0, 2, technique.probes.variability.shape).astype(np.float32)
    technique.device.write(technique.probes.variability, values)
    run_pass(technique, "variability", size)
    exact = values[state_of(technique).state == 3].astype(np.float64).mean()
    yield off(np.array(technique.average_variability()), exact, VARIABILITY.relative)


def _gather(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Irradiance from eight probes at receivers, in and outside of the volume."""
    place: Mapping[str, Any] = {"origin": "-0.6,-0.5,-0.4", "spacing": "0.3,0.4,0.5"}
    technique = made(bench, rng, size, **place)
    randomise(technique, rng, states=(0, 2, 3, 3, 3))
    s = state_of(technique)
    receivers = technique._world.lightmap.receivers
    normal, position = (a.astype(np.float64) for a in (receivers.normal, receivers.position))
    expected, certain = gather(s, position, bias_of(s, normal, normal), normal)
    yield at_least(float(certain.mean()), 0.9)
    found = technique.indirect_irradiance()
    yield off(found[certain], expected[certain], 1e-3, 1e-5)


_BLENDS: dict[Layout, str] = {WIDE: "tuned_blend", SIMT: "simt_blend"}
CASES = [
    Case("DDGI's probe rays", ("ddgi/trace.cl:probe_trace",), _trace),
    *(
        Case(
            f"DDGI's light at hits ({variant})",
            ("ddgi/trace.cl:probe_shade",),
            partial(_shade, variant=variant),
            (7, 64),
        )
        for variant in ("published", "tuned")
    ),
    Case(
        "DDGI's blending (published)",
        ("ddgi/published_blend.cl:blend_irradiance", "ddgi/published_blend.cl:blend_distance"),
        partial(_blend, variant="published"),
    ),
    *(
        Case(
            f"DDGI's blending ({layout})",
            (
                "ddgi/tuned_blend.cl:backface_counts",
                *(
                    f"ddgi/{file}.cl:{name}"
                    for name in ("blend_weights", "blend_irradiance", "blend_distance")
                ),
            ),
            partial(_blend, variant="tuned", layout=layout),
        )
        for layout, file in _BLENDS.items()
    ),
    Case("Borders of octahedral maps", ("parts/border_copy.cl:border_copy",), _borders),
    Case(
        "DDGI's relocation and classification",
        ("ddgi/probes.cl:relocation", "ddgi/probes.cl:classification"),
        _moving,
    ),
    Case(
        "DDGI's variability",
        ("ddgi/probes.cl:variability_sums", "ddgi/probes.cl:variability_mean"),
        _variability,
    ),
    Case("DDGI's gather", ("ddgi/application.cl:receiver_irradiance",), _gather, (7, 64)),
    *conform_view.CASES,
]
