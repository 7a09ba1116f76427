"""Random scenes and baked data, which travel with the package (``gibench conform``)."""

from __future__ import annotations

from gibench.techniques.parts.conformance.synthetic import (
    random_lightmap,
    random_scene,
    random_unit,
)
from gibench.techniques.srp.conform_oracle import random_bake

__all__ = ["random_bake", "random_lightmap", "random_scene", "random_unit"]
