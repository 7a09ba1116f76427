"""The float64 oracle of DDGI's passes, which travels with the package; how tests run one pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gibench.techniques.ddgi import SPEC, Ddgi
from gibench.techniques.ddgi.conform_oracle import (
    ACTIVE,
    BLENDED,
    FAR,
    LUMINANCE,
    SIZES,
    SMALL,
    USABLE,
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
    term,
)
from gibench.techniques.parts.conformance.octahedral import (
    bordered,
    decode,
    encode,
    lookup,
    texel_directions,
)
from gibench.techniques.parts.conformance.shading import surface
from gibench.techniques.registry import BakeContext
from support.made import made
from support.shading_oracle import open_device
from support.synthetic_bake import random_lightmap

VARIANTS = ("published", "tuned")

__all__ = [
    "ACTIVE",
    "BLENDED",
    "FAR",
    "LUMINANCE",
    "SIZES",
    "SMALL",
    "USABLE",
    "VARIANTS",
    "State",
    "bias_of",
    "blended_distance",
    "blended_irradiance",
    "bordered",
    "classified",
    "create",
    "decode",
    "encode",
    "gather",
    "lookup",
    "randomise",
    "relocated",
    "shade",
    "state_of",
    "surface",
    "term",
    "texel_directions",
]


def create(
    scene,
    settings,
    variant="tuned",
    size=64,
    lightmap=None,
    image=(24, 16),
    flight=None,
    motion=None,
    **device,
):
    """The technique on a fresh device; ``settings`` by name."""
    chosen = SPEC.settings(settings)
    if lightmap is None:
        lightmap = random_lightmap(np.random.default_rng(1), scene, 50, 10, 10)
    volume = SPEC.bake(BakeContext(scene, lightmap, chosen, Path()))
    camera = scene.cameras[0]
    opened = open_device(**device)
    sizes = (variant, size, *image)
    technique: Ddgi = made(
        *(SPEC, opened, scene, lightmap, chosen, volume), *sizes, camera,
        flight=flight, motion=motion,
    )  # fmt: skip
    return technique
