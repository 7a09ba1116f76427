"""Constants that host and kernels share: each has its home here, and kernels get it as a macro."""

from __future__ import annotations

from gibench.device.build import Define
from gibench.rays.bvh import BVH_MACROS
from gibench.techniques.parts.material_table import material_macros

TILE_SIDE = 8
"""Pixels are visited in squares of this side (kernels_cl/common/pixels.cl)."""

SHOW_DIRECT = 1
"""Of what a camera image shows: direct light, emission and environment."""

SHOW_INDIRECT = 2
"""Of what a camera image shows: indirect light. Images are asked for by a sum of these."""

LIGHT_FLOATS = 12
"""Numbers of a light (kernels_cl/common/lights.cl)."""

LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT = range(3)
"""Kinds of lights."""

SHADOW_RAY_SHARE = 0.9999
"""Share of the way to a light that a shadow ray goes, so that it never meets geometry that touches
the light.
"""

GBUFFER_NONE = 0
"""What the camera pass keeps of a pixel (kernels_cl/parts/gbuffer.cl): nothing."""

GBUFFER_HIT = 1
"""What the camera pass keeps of a pixel: where a surface is hit, and its albedo."""

GBUFFER_SURFACE = 2
"""What the camera pass keeps of a pixel: the surface there."""

GBUFFER_FLOATS = 6
"""Numbers of a hit that is kept: triangle, barycentrics, albedo."""

SCENE_MACROS: dict[str, Define] = {
    **BVH_MACROS,
    **material_macros(),
    "GBUFFER_FLOATS": GBUFFER_FLOATS,
    "GBUFFER_HIT": GBUFFER_HIT,
    "GBUFFER_NONE": GBUFFER_NONE,
    "GBUFFER_SURFACE": GBUFFER_SURFACE,
    "LIGHT_DIRECTIONAL": LIGHT_DIRECTIONAL,
    "LIGHT_FLOATS": LIGHT_FLOATS,
    "LIGHT_POINT": LIGHT_POINT,
    "LIGHT_SPOT": LIGHT_SPOT,
    "RAY_SCALE": 1.0,
    "SHADOW_RAY_SHARE": SHADOW_RAY_SHARE,
    "SHOW_DIRECT": SHOW_DIRECT,
    "SHOW_INDIRECT": SHOW_INDIRECT,
    "TILE_SIDE": TILE_SIDE,
}
"""Of every program that traces rays, reads materials or lights or draws an image. RAY_SCALE is of
scenes of metres (gibench/rays/offset.py).
"""


def tiled_pixels(width: int, height: int) -> int:
    """Work-items that visit all pixels of an image in tiled order."""
    return -(-width // TILE_SIDE) * -(-height // TILE_SIDE) * TILE_SIDE**2
