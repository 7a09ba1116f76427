"""SRP's kernels against float64 NumPy, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from gibench.techniques.parts.conformance.case import Bench, Case, created, off, run_pass
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene
from gibench.techniques.srp import SPEC
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.conform_oracle import (
    expected_irradiance,
    expected_probe_radiance,
    random_bake,
    write_lambda,
)

RECEIVERS, WIDTH, HEIGHT = 613, 41, 33
ORDERS = {1: 0, 7: 7, 64: 7, 100: 2}  # by work-group size
STORAGES = {1: "fp32", 7: "fp16", 64: "snorm16", 100: "fp16"}


def _made(
    bench: Bench, rng: np.random.Generator, size: int, variant: str, storage: str = "fp16"
) -> tuple[Any, SrpBake]:
    scene = random_scene(rng, 12)
    lightmap = random_lightmap(rng, scene, RECEIVERS, WIDTH, HEIGHT)
    bake = random_bake(rng, lightmap, order=ORDERS[size], samples=100 + 157 * (size == 64))
    settings = SPEC.settings({"sh_order": bake.sh_order, "storage": storage})
    device = bench.open(1200 if variant == "tuned" else 16384)
    return created(SPEC, device, scene, lightmap, settings, bake, variant, size), bake


def _probes(bench: Bench, rng: np.random.Generator, size: int, variant: str) -> Iterator[float]:
    """What probes see of a lit map, in spherical harmonics."""
    technique, bake = _made(bench, rng, size, variant)
    radiance = rng.uniform(0, 3, (WIDTH * HEIGHT, 3)).astype(np.float32)
    values = technique.device.read(technique.variant.radiance)
    values[: len(radiance), :3] = radiance
    technique.device.write(technique.variant.radiance, values)
    run_pass(technique, "probe_update", size)
    scene = technique.scene.scene
    expected = expected_probe_radiance(scene, bake, radiance.astype(np.float64))
    found = technique.variant.probe_radiance()
    yield off(found, expected, absolute=3e-6 * float(np.abs(expected).max()))


def _transport(bench: Bench, rng: np.random.Generator, size: int, variant: str) -> Iterator[float]:
    """Projection onto the clusters' vectors, and irradiance from those."""
    storage = STORAGES[size]
    technique, bake = _made(bench, rng, size, variant, storage)
    radiance = rng.normal(size=(11, bake.coefficients, 3)).astype(np.float32)
    write_lambda(technique, radiance)
    run_pass(technique, "cluster_projection", size)
    run_pass(technique, "irradiance_transport", size)
    expected = expected_irradiance(bake, radiance.astype(np.float64), RECEIVERS, storage)
    found = technique.indirect_irradiance()
    yield off(found, expected, absolute=3e-6 * float(np.abs(expected).max()))


def _cases(variant: str, projection: str) -> list[Case]:
    folder = f"srp/{variant}"
    return [
        Case(
            f"SRP's probe update ({variant})",
            (f"{folder}_probes.cl:probe_update",),
            partial(_probes, variant=variant),
        ),
        Case(
            f"SRP's projection and transport ({variant})",
            (f"{projection}:cluster_projection", f"{folder}_transport.cl:irradiance_transport"),
            partial(_transport, variant=variant),
        ),
    ]


CASES = [
    *_cases("published", "srp/published_transport.cl"),
    *_cases("tuned", "srp/tuned_projection.cl"),
]
