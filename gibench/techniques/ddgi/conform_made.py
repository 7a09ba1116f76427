"""DDGI on a random scene, for its cases of `gibench conform`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gibench.device import Layout
from gibench.techniques.ddgi import SPEC
from gibench.techniques.ddgi.conform_oracle import SMALL
from gibench.techniques.parts.conformance.case import Bench, created
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene
from gibench.techniques.registry import BakeContext


def made(
    bench: Bench,
    rng: np.random.Generator,
    size: int,
    variant: str = "tuned",
    local_memory: int = 16384,
    layout: Layout | None = None,
    image: tuple[int, int] = (24, 16),
    **settings: Any,
) -> Any:
    """The technique on a soup of triangles, ``size`` work-items per group."""
    scene = random_scene(rng, 80)
    chosen = SPEC.settings({**SMALL, **settings})
    lightmap = random_lightmap(rng, scene, 300, 20, 20)
    volume = SPEC.bake(BakeContext(scene, lightmap, chosen, Path()))
    device = bench.open(local_memory, layout)
    return created(SPEC, device, scene, lightmap, chosen, volume, variant, size, image)
