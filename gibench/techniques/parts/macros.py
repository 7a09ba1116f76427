"""Constants that host and kernels share: each has its home here, and kernels get it as a macro."""

from __future__ import annotations

from gibench.techniques.parts.material_table import material_macros

TILE_SIDE = 8
"""Pixels are visited in squares of this side (kernels_cl/common/pixels.cl)."""

SHOW_DIRECT = 1
"""Of what a camera image shows: direct light, emission and environment."""

SHOW_INDIRECT = 2
"""Of what a camera image shows: indirect light. Images are asked for by a sum of these."""

LIGHT_FLOATS = 12
"""Numbers of a light (kernels_cl/common/lights.cl)."""

GBUFFER_NONE = 0
"""What the camera pass keeps of a pixel (kernels_cl/parts/gbuffer.cl): nothing."""

GBUFFER_HIT = 1
"""What the camera pass keeps of a pixel: where a surface is hit, and its albedo."""

GBUFFER_SURFACE = 2
"""What the camera pass keeps of a pixel: the surface there."""

GBUFFER_FLOATS = 6
"""Numbers of a hit that is kept: triangle, barycentrics, albedo."""

SCENE_MACROS: dict[str, int] = {
    **material_macros(),
    "GBUFFER_FLOATS": GBUFFER_FLOATS,
    "GBUFFER_HIT": GBUFFER_HIT,
    "GBUFFER_NONE": GBUFFER_NONE,
    "GBUFFER_SURFACE": GBUFFER_SURFACE,
    "LIGHT_FLOATS": LIGHT_FLOATS,
    "SHOW_DIRECT": SHOW_DIRECT,
    "SHOW_INDIRECT": SHOW_INDIRECT,
    "TILE_SIDE": TILE_SIDE,
}
"""Of every program that reads materials or lights or draws an image."""


def tiled_pixels(width: int, height: int) -> int:
    """Work-items that visit all pixels of an image in tiled order."""
    return -(-width // TILE_SIDE) * -(-height // TILE_SIDE) * TILE_SIDE**2
