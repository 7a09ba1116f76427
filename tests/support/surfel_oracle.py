"""Surfel caches in float64 NumPy: what the frame's kernels are held against."""

from __future__ import annotations

from pathlib import Path

from gibench.techniques.registry import BakeContext
from gibench.techniques.surfel_cache import SPEC, SurfelCache
from gibench.techniques.surfel_cache.conform_oracle import (
    dilated,
    gathered,
    halves,
    link_terms,
    lit_caches,
    lobe,
    random_caches,
    random_flux,
    read,
    spread,
    write,
)
from gibench.work import Serial
from support.made import made
from support.shading_oracle import open_device

__all__ = ["SHAPES", "SMALL", "VARIANTS", "baked", "create", "dilated", "gathered", "halves",
           "link_terms", "lit_caches", "lobe", "random_caches", "random_flux", "read",
           "spread", "write"]  # fmt: skip

VARIANTS = ("published", "tuned")
SHAPES = ("published", "wide", "simt")
"""The published variant, and the tuned one in both layouts."""
SMALL = {"surfels": 300, "links": 20, "caches": 120, "grid": "3x4x2", "relaxation": 2}


def baked(scene, lightmap, settings, cache: Path):
    """The bake of ``scene`` with ``settings`` by name."""
    return SPEC.bake(BakeContext(scene, lightmap, SPEC.settings(settings), cache), Serial())


def create(scene, lightmap, settings, bake, variant="tuned", size=64, image=(24, 16), motion=None):
    """The technique on a fresh device; ``variant`` may be of ``SHAPES``."""
    layout = variant if variant in ("wide", "simt") else None
    variant = "tuned" if layout else variant
    technique: SurfelCache = made(
        *(SPEC, open_device(layout=layout), scene, lightmap, SPEC.settings(settings), bake),
        variant, size,
        *image, scene.cameras[0], motion=motion,
    )  # fmt: skip
    return technique
