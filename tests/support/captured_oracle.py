"""The float64 oracle of captured probes, which travels with the package; how tests set them up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gibench.techniques.light_field_probes.conform_oracle import (
    SMALL,
    USABLE,
    chebyshev,
    expected_image,
    filtered_irradiance,
    filtered_moments,
    gather,
    inner,
    lobes_of,
    prefiltered,
    randomise,
    received,
    relit,
    seen,
    table,
    weights,
    within_reach,
)
from gibench.techniques.registry import BakeContext, find_technique
from support.made import made
from support.shading_oracle import open_device
from support.synthetic_bake import random_lightmap

__all__ = [
    "NAMES",
    "SMALL",
    "USABLE",
    "VARIANTS",
    "chebyshev",
    "create",
    "expected_image",
    "filtered_irradiance",
    "filtered_moments",
    "gather",
    "inner",
    "lobes_of",
    "prefiltered",
    "randomise",
    "received",
    "relit",
    "seen",
    "table",
    "weights",
    "within_reach",
]

NAMES = ("irradiance-probes", "light-field-probes")
VARIANTS = ("published", "tuned")


def create(name, scene, settings, cache, variant="tuned", size=64, lightmap=None, image=(24, 16)):
    """The technique on a fresh device."""
    spec = find_technique(name)
    chosen = spec.settings(settings)
    if lightmap is None:
        lightmap = random_lightmap(np.random.default_rng(1), scene, 50, 10, 10)
    baked = spec.bake(BakeContext(scene, lightmap, chosen, Path(cache)))
    return made(
        *(spec, open_device(), scene, lightmap, chosen, baked, variant, size, *image),
        scene.cameras[0],
    )
