"""SRP where something moves, against float64 NumPy and Embree: the probes' light anywhere, and what
blocked relight rays see. For `gibench conform`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gibench.arrays import Array
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
from gibench.techniques.srp.conform_oracle import (
    LitPoints,
    probe_light,
    probes_told,
    random_bake,
    randomise,
)

PROBES, RADIUS = 11, 1.3
PROBES_LIGHT = 2e-4
"""Of the brightest point: a mean over probes by weights that begin at 0, which is how well these
are known where their sum is at least ``LEAST_WEIGHT``."""
BLOCKED = Tolerance(1e-3)
MOVED = ("move_vertices", "refit_leaves", "refit_nodes", "refit_movers", "blocked_rays")
"""Passes before the probes' update."""


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
    points = LitPoints.at_random(technique, rng, (-2, -2, -1.5), (4, 2, 1.5))
    run(technique.device, [points.launch], size)
    expected, weights, told = points.expected(bake, maps, radiance)
    yield at_least(float(told.mean()), 0.8)
    yield at_least(float((weights[told] == 0).sum()), 1)
    most = PROBES_LIGHT * float(expected.max())
    yield off(technique.device.read(points.light)[told], expected[told], absolute=most)


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
