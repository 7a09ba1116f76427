"""The example's kernel against float64 NumPy, for ``gibench conform``."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from gibench.techniques.example import SPEC
from gibench.techniques.example.stages import volume_of

from gibench.techniques.parts.conformance.case import Bench, Case, created, off
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene


def _openness(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Light at receivers, trilinear between random probes."""
    scene = random_scene(rng, 60)
    lightmap = random_lightmap(rng, scene, 50, 10, 10)
    settings = SPEC.settings({"counts": "3x2x4", "ambient": 0.2})
    openness = rng.uniform(0, 1, 24).astype(np.float32)
    technique = created(SPEC, bench.open(), scene, lightmap, settings, openness, "tuned", size)
    table = volume_of(scene, settings).table().astype(np.float64)
    shape = np.array(settings.grid)
    place = (lightmap.receivers.position - table[:3]) / table[3:6]
    place = np.clip(place, 0, shape - 1)
    base = np.floor(place).astype(int)
    share = place - base
    light = np.zeros(len(place))
    for step in product((0, 1), repeat=3):
        weight = np.where(step, share, 1 - share).prod(axis=1)
        x, y, z = np.minimum(base + step, shape - 1).T
        light += weight * openness[(z * shape[1] + y) * shape[0] + x]
    expected = np.repeat(np.pi * 0.2 * light[:, None], 3, axis=1)
    # The place in the grid is off by a few roundings of coordinates and origin over the spacing.
    yield off(technique.indirect_irradiance(), expected, absolute=2e-4)


CASES = [
    Case("The example's openness", ("example/application.cl:receiver_openness",), _openness),
]
