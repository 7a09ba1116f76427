"""SRP's kernels against float64 NumPy, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from gibench.device import SIMT, WIDE, Layout
from gibench.techniques.parts.conformance.case import Bench, Case, created, off, run_pass
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene
from gibench.techniques.srp import SPEC, conform_bake, conform_movers
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


SHAPES = ("published", WIDE, SIMT)
"""The published variant, and the tuned one in both layouts."""


def local_memory(shape: str, size: int) -> int:
    """Bytes that leave a part of a probe's samples, or of a block's rows, for another turn."""
    return {WIDE: 1200, SIMT: 12 * size + 480}.get(shape, 16384)


def _made(
    bench: Bench, rng: np.random.Generator, size: int, shape: str, storage: str = "fp16"
) -> tuple[Any, SrpBake]:
    scene = random_scene(rng, 12)
    lightmap = random_lightmap(rng, scene, RECEIVERS, WIDTH, HEIGHT)
    bake = random_bake(rng, lightmap, order=ORDERS[size], samples=100 + 157 * (size == 64))
    settings = SPEC.settings({"sh_order": bake.sh_order, "storage": storage})
    layout: Layout | None = None if shape == "published" else SIMT if shape == SIMT else WIDE
    device = bench.open(local_memory(shape, size), layout)
    variant = "tuned" if layout else "published"
    return created(SPEC, device, scene, lightmap, settings, bake, variant, size), bake


def _probes(bench: Bench, rng: np.random.Generator, size: int, shape: str) -> Iterator[float]:
    """What probes see of a lit map, in spherical harmonics."""
    technique, bake = _made(bench, rng, size, shape)
    radiance = rng.uniform(0, 3, (WIDTH * HEIGHT, 3)).astype(np.float32)
    values = technique.device.read(technique.variant.radiance)
    values[: len(radiance), :3] = radiance
    technique.device.write(technique.variant.radiance, values)
    run_pass(technique, "probe_update", size)
    scene = technique.scene.scene
    expected = expected_probe_radiance(scene, bake, radiance.astype(np.float64))
    found = technique.variant.probe_radiance()
    yield off(found, expected, absolute=3e-6 * float(np.abs(expected).max()))


def _transport(bench: Bench, rng: np.random.Generator, size: int, shape: str) -> Iterator[float]:
    """Projection onto the clusters' vectors, and irradiance from those."""
    storage = STORAGES[size]
    technique, bake = _made(bench, rng, size, shape, storage)
    radiance = rng.normal(size=(11, bake.coefficients, 3)).astype(np.float32)
    write_lambda(technique, radiance)
    run_pass(technique, "cluster_projection", size)
    run_pass(technique, "irradiance_transport", size)
    expected = expected_irradiance(bake, radiance.astype(np.float64), RECEIVERS, storage)
    found = technique.indirect_irradiance()
    yield off(found, expected, absolute=3e-6 * float(np.abs(expected).max()))


def _cases(shape: str) -> list[Case]:
    files = f"srp/{'tuned' if shape == WIDE else shape}"
    projection = f"{files}_{'transport' if shape == 'published' else 'projection'}.cl"
    return [
        Case(
            f"SRP's probe update ({shape})",
            (
                f"{files}_probes.cl:probe_update",
                *([f"{files}_probes.cl:add_parts"] if shape == SIMT else []),
            ),
            partial(_probes, shape=shape),
        ),
        Case(
            f"SRP's projection and transport ({shape})",
            (
                f"{projection}:cluster_projection",
                *([f"{projection}:add_pieces"] if shape == SIMT else []),
                f"{files}_transport.cl:irradiance_transport",
            ),
            partial(_transport, shape=shape),
        ),
    ]


CASES = [
    *(case for shape in SHAPES for case in _cases(shape)),
    *conform_bake.CASES,
    *conform_movers.CASES,
]
