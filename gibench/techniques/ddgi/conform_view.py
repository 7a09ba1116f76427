"""DDGI's probes drawn over an image, against float64 NumPy and Embree, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from gibench.arrays import Array
from gibench.rays.embree import EmbreeTracer
from gibench.techniques.ddgi.conform_made import made
from gibench.techniques.ddgi.conform_oracle import USABLE, randomise, state_of, term
from gibench.techniques.parts.conformance.case import Bench, Case, at_least, off, run
from gibench.techniques.parts.conformance.shading import PlaneHits, pixel_directions

WIDTH, HEIGHT, RADIUS = 61, 43, 0.11
INACTIVE = (0.05, 0.0, 0.0)
_EDGE = 0.02
"""Share of a radius within which of a sphere's outline, or of where it is cut, a pixel is left out:
a normal is there the root of a difference of roundings."""


def _view(bench: Bench, rng: np.random.Generator, size: int, variant: str) -> Iterator[float]:
    """Spheres before and behind the scene's surfaces, cut where they leave their probe's cell."""
    technique = made(bench, rng, size, variant, image=(WIDTH, HEIGHT))
    device, scene = technique.device, technique.scene.scene
    randomise(technique, rng, states=(0, 2, 3, 3, 3))
    technique.begin_frame(2)
    s = state_of(technique)
    before = rng.uniform(0, 1, (HEIGHT, WIDTH, 3)).astype(np.float32)
    device.write(technique.scene.image, before)
    run(device, [technique._passes.probe_view(RADIUS)], size)
    found = device.read(technique.scene.image).reshape(-1, 3)

    d = pixel_directions(scene.cameras[0], WIDTH, HEIGHT)
    eye = np.array(scene.cameras[0].position)
    limit, certain = _limits(scene.corners, eye, d)
    nearest, owner = np.full(len(d), np.inf), np.full(len(d), -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / d
    for probe, centre in enumerate(s.position - eye):
        # Its cell: half a spacing to all sides of its place on the grid, not of the probe.
        sides = [(s.grid[probe] - eye + k * s.spacing / 2) * inverse for k in (-1, 1)]
        enter = np.maximum(np.minimum(*sides).max(axis=1), 0)
        leave = np.maximum(*sides).min(axis=1)
        middle = d @ centre
        beside = ((centre - middle[:, None] * d) ** 2).sum(axis=1)
        inside = RADIUS**2 - beside
        t = middle - np.sqrt(np.maximum(inside, 0))
        end = np.minimum(leave, limit)
        seen = (inside > 0) & (t >= enter) & (t < end)
        closer = seen & (t < nearest)
        nearest[closer], owner[closer] = t[closer], probe
        # Near any of what decides, single precision may decide otherwise.
        touched = inside > -_EDGE * RADIUS**2
        certain &= ~(touched & (inside < _EDGE * RADIUS**2))
        for bound in (enter, leave, limit):
            certain &= ~(touched & (np.abs(t - bound) < _EDGE * RADIUS))
    expected = before.reshape(-1, 3).astype(np.float64)
    for probe in range(len(s.position)):
        mine = np.flatnonzero(owner == probe)
        if s.state[probe] != USABLE:
            expected[mine] = INACTIVE
            continue
        normal = (nearest[mine, None] * d[mine] + eye - s.position[probe]) / RADIUS
        half = term(s, probe, normal)
        # A white surface's radiance: the irradiance, 2 pi times what is averaged, over pi.
        expected[mine] = 2 * (half if s.linear else half**2)
    drawn = owner >= 0
    usable = drawn & (s.state[np.maximum(owner, 0)] == USABLE)
    yield at_least(float(certain.mean()), 0.5)
    yield at_least(float(min((certain & usable).sum(), (certain & drawn & ~usable).sum())), 3)
    yield off(found[certain & ~drawn], expected[certain & ~drawn])
    inactive = certain & drawn & ~usable
    yield off(found[inactive], expected[inactive], 1e-6)
    # Bilinear in maps of values up to 1.4 that differ by as much from texel to texel, by a power:
    # what rounding, over a sphere's radius, does to its normal.
    yield off(found[certain & usable], expected[certain & usable], 1e-3, 1e-4)


def _limits(corners: Array, eye: Array, d: Array) -> tuple[Array, Array]:
    """How far pixels see (n,), m, and whether no edge is within a hair of their rays."""
    tracer = EmbreeTracer(corners)
    start = np.broadcast_to(eye, d.shape).astype(np.float32)
    hits = tracer.closest(start, d.astype(np.float32))
    certain = np.ones(len(d), bool)
    for way in (*np.eye(3), *-np.eye(3)):
        near = tracer.closest(start, (d + 2e-4 * way).astype(np.float32))
        certain &= near.triangle == hits.triangle
    met = np.flatnonzero(hits.triangle >= 0)
    plane = PlaneHits.of(corners[hits.triangle[met]], eye, d[met])
    limit = np.full(len(d), np.inf)
    limit[met] = plane.t
    certain[met] &= plane.slack_t < 1e-3 * RADIUS
    return limit, certain


CASES = [
    Case(
        f"DDGI's probes drawn ({variant})",
        ("ddgi/application.cl:probe_view",),
        partial(_view, variant=variant),
        (7, 64, 100),
    )
    for variant in ("published", "tuned")
]
