"""SRP where something moves, against float64 NumPy and Embree: the probes' light anywhere, and what
blocked relight rays see. For `gibench conform`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gibench.device import SIMT, WIDE, Layout
from gibench.rays.embree import EmbreeTracer
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.parts.conformance.case import (
    Bench,
    Case,
    Tolerance,
    at_least,
    created,
    off,
    run,
)
from gibench.techniques.parts.conformance.hits import met, sent_back
from gibench.techniques.parts.conformance.shading import PlaneHits
from gibench.techniques.parts.conformance.synthetic import (
    random_lightmap,
    random_motion,
    random_scene,
)
from gibench.techniques.parts.frame_passes import frame_passes
from gibench.techniques.srp import SPEC
from gibench.techniques.srp.bake.data import ProbeSet, SrpBake
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.weights import spatial_weight
from gibench.techniques.srp.conform_oracle import Array, random_bake, write_lambda
from gibench.techniques.srp.probe_light import DEPTH_BIAS, DEPTH_SIDE, LEAST_SEEN, with_borders

PROBES, RADIUS = 11, 1.3
LEAST_WEIGHT = 1e-3
"""All probes in reach together under this: single precision knows no three digits of it."""
PROBES_LIGHT = 2e-4
"""Of the brightest point: a mean over probes by weights that begin at 0, which is how well these
are known where their sum is at least ``LEAST_WEIGHT``."""
BLOCKED = Tolerance(1e-3)
MOVED = ("move_vertices", "refit_leaves", "refit_nodes", "refit_movers", "blocked_rays")
"""Passes before the probes' update."""


def looked_up(maps: Array, probe: int, direction: Array) -> Array:
    """A bordered octahedral map at unit directions (n, 3), bilinear, in float64."""
    d = direction / np.abs(direction).sum(axis=1, keepdims=True)
    sign = np.where(d[:, :2] >= 0, 1.0, -1.0)
    square = np.where(d[:, 2:] >= 0, d[:, :2], (1 - np.abs(d[:, 1::-1])) * sign)
    at = (square * 0.5 + 0.5) * DEPTH_SIDE + 0.5
    corner = np.clip(np.floor(at), 0, DEPTH_SIDE).astype(int)
    x, y = (at - corner).T[:, :, None]
    c, r = corner.T
    m = maps[probe]
    top = m[r, c] * (1 - x) + m[r, c + 1] * x
    return np.asarray(top * (1 - y) + (m[r + 1, c] * (1 - x) + m[r + 1, c + 1] * x) * y)


def probe_light(
    bake: SrpBake, maps: Array, radiance: Array, position: Array, normal: Array
) -> tuple[Array, Array]:
    """Irradiance (n, 3) at points, and the weight (n,) of the probes in reach.

    Args:
        bake: whose probes they are.
        maps: (p, s + 2, s + 2, 2) mean distance and mean squared distance.
        radiance: (p, c, 3) of the probes.
        position: (n, 3), m.
        normal: (n, 3).
    """
    c = min(9, bake.coefficients)
    factor = np.array([np.pi, *[2 * np.pi / 3] * 3, *[np.pi / 4] * 5])[:c]
    basis = sh_basis(bake.sh_order, normal)[:, :c] * factor
    total, weights = np.zeros((len(position), 3)), np.zeros(len(position))
    apart = position[:, None] - bake.probes.positions.astype(np.float64)
    distance = np.linalg.norm(apart, axis=2)
    each = np.einsum("nc,pck->pnk", basis, radiance[:, :c].astype(np.float64)).clip(0)
    for probe in range(len(bake.probes)):
        d = distance[:, probe]
        moments = looked_up(maps, probe, apart[:, probe] / d[:, None])
        behind = d - DEPTH_BIAS * bake.probes.radius - moments[:, 0]
        variance = np.abs(moments[:, 1] - moments[:, 0] ** 2)
        bound = np.maximum((variance / (variance + behind**2)) ** 3, LEAST_SEEN)
        weight = spatial_weight(d / bake.probes.radius) * np.where(behind > 0, bound, 1.0)
        total += weight[:, None] * each[probe]
        weights += weight
    nearest = distance.argmin(axis=1)
    alone = each[nearest, np.arange(len(position))]
    inside = weights > 0
    return np.where(inside[:, None], total / np.maximum(weights, 1e-30)[:, None], alone), weights


def probes_told(bake: SrpBake, position: Array, weights: Array) -> Array:
    """Points (n,) whose light single precision knows: enough probes in reach, or surely none, and
    one of them surely the nearest.
    """
    distance = np.linalg.norm(position[:, None] - bake.probes.positions, axis=2)
    ordered = np.sort(distance, axis=1)
    alone = (ordered[:, 0] > 1.001 * bake.probes.radius) & (np.diff(ordered[:, :2])[:, 0] > 1e-4)
    return np.asarray((weights > LEAST_WEIGHT) | alone)


def random_depths(rng: np.random.Generator, probes: int) -> Array:
    """Maps of distances with true borders."""
    mean = rng.uniform(0.3, 2.0, (probes, DEPTH_SIDE, DEPTH_SIDE))
    square = mean**2 + rng.uniform(0.02, 0.2, mean.shape)
    return with_borders(np.stack([mean, square], axis=-1).astype(np.float32))


def randomise(technique: Any, bake: SrpBake, rng: np.random.Generator) -> tuple[Array, Array]:
    """Random light and depths; both as they lie on the device."""
    radiance = rng.normal(size=(PROBES, bake.coefficients, 3)).astype(np.float32)
    radiance[:, 0] += 2.0
    write_lambda(technique, radiance)
    maps = random_depths(rng, PROBES)
    technique.device.write(technique.movers.light.depth, maps)
    return radiance, maps.astype(np.float64)


def _made(
    bench: Bench, rng: np.random.Generator, size: int, shape: str, order: int, samples: int
) -> tuple[Any, SrpBake, MovingObjects]:
    """A soup of which two thirds move, and random probes."""
    objects = rng.permutation(np.arange(60) % 3).astype(np.int32)
    names = ("still", "one", "other")
    scene = replace(random_scene(rng, 60), object_ids=objects, object_names=names)
    low, high = (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)
    motion = MovingObjects.of(scene, [random_motion(n, rng, low=low, high=high) for n in names[1:]])
    lightmap = random_lightmap(rng, scene, 40, 20, 10)
    bake = random_bake(rng, lightmap, order=order, samples=samples)
    positions = rng.uniform(-1.5, 1.5, (PROBES, 3)).astype(np.float32)
    bake = replace(bake, probes=ProbeSet(positions, RADIUS))
    layout: Layout | None = None if shape == "published" else SIMT if shape == SIMT else WIDE
    variant = "tuned" if layout else "published"
    settings = SPEC.settings({"sh_order": order, "bounces": bool(rng.integers(0, 2))})
    device = bench.open(layout=layout)
    technique = created(SPEC, device, scene, lightmap, settings, bake, variant, size, motion=motion)
    return technique, bake, motion


def _anywhere(bench: Bench, rng: np.random.Generator, size: int, shape: str) -> Iterator[float]:
    """The probes' light at points in and out of their reach."""
    technique, bake, _ = _made(bench, rng, size, shape, int(rng.integers(0, 8)), 40)
    radiance, maps = randomise(technique, bake, rng)
    count = 500
    position = rng.uniform((-2, -2, -1.5), (4, 2, 1.5), (count, 3)).astype(np.float32)
    normal = rng.normal(size=(count, 3))
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    device = technique.device
    held = [
        device.upload("point_positions", position),
        device.upload("point_normals", normal),
        device.empty("point_light", (count, 3), np.float32),
    ]
    launch = technique.movers.light.receivers(
        technique._application, technique.variant.coefficients, *held
    )
    run(device, [launch], size)
    at, n = position.astype(np.float64), normal.astype(np.float64)
    expected, weights = probe_light(bake, maps, radiance, at, n)
    told = probes_told(bake, at, weights)
    yield at_least(float(told.mean()), 0.8)
    yield at_least(float((weights[told] == 0).sum()), 1)
    most = PROBES_LIGHT * float(expected.max())
    yield off(device.read(held[2])[told], expected[told], absolute=most)


def _blocked(bench: Bench, rng: np.random.Generator, size: int, shape: str) -> Iterator[float]:
    """Which relight rays something blocks, and what they see of it."""
    technique, bake, motion = _made(bench, rng, size, shape, 3, 90)
    scene, device = technique.scene.scene, technique.device
    reach = rng.uniform(0.3, 3.0, (PROBES, 90)).astype(np.float32)
    reach[rng.random(reach.shape) < 0.3] = np.inf
    device.write(technique.movers.reach, reach)
    radiance, maps = randomise(technique, bake, rng)
    moving = np.flatnonzero(motion.triangles)
    origin = np.repeat(bake.probes.positions, 90, axis=0).astype(np.float64)
    direction = np.tile(bake.relight.directions, (PROBES, 1)).astype(np.float64)
    bounces = bool(technique._settings.bounces)
    for frame in (1, 3):
        technique.begin_frame(frame)
        for item in frame_passes(technique):
            if item.name in MOVED:
                run(device, item.launches(), size)
        found = device.read(technique.movers.blocked).reshape(-1, 4)
        there = motion.scene_in(scene, frame)
        tracer = EmbreeTracer(there.corners[moving])
        hits = met(tracer, rng, origin, direction, reach.ravel())
        blocked = hits.triangle >= 0
        yield at_least(float(hits.certain.mean()), 0.8)
        yield at_least(float(blocked.mean()), 0.02)
        yield off(found[hits.certain, 3], blocked[hits.certain])
        free = found[hits.certain & ~blocked, :3]
        yield off(free, np.zeros_like(free))
        mine = np.flatnonzero(blocked & hits.certain)
        triangle = moving[hits.triangle[mine]]
        plane = PlaneHits.of(there.corners[triangle], origin[mine], direction[mine])

        def light(position: Array, normal: Array) -> tuple[Array, Array]:
            if not bounces:
                return np.zeros(position.shape), np.ones(len(position), bool)
            looked, weights = probe_light(bake, maps, radiance, position, normal)
            return looked, probes_told(bake, position, weights)

        expected, told = sent_back(there, frame, triangle, plane, direction[mine], light)
        yield at_least(float((told & (expected > 0).any(axis=1)).sum()), 5)
        most = 2e-3 * float(expected[told].max())
        yield off(found[mine[told], :3], expected[told], BLOCKED.relative, most)


CASES = [
    case
    for shape in ("published", WIDE, SIMT)
    for case in (
        Case(
            f"SRP's probes' light anywhere ({shape})",
            ("srp/moving_application.cl:receiver_irradiance",),
            partial(_anywhere, shape=shape),
            (7, 64),
        ),
        Case(
            f"SRP's blocked relight rays ({shape})",
            ("srp/blocked_rays.cl:blocked_rays",),
            partial(_blocked, shape=shape),
            (7, 64),
        ),
    )
]
