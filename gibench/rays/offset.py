"""How far rays start off surfaces and end short of them, so that none meets its own surface."""

from __future__ import annotations

import numpy as np

from gibench.scene.model import Scene

# Rays start off the surface they leave by this share of the scene's extent: some 30 times the
# rounding of a float32 coordinate of that size.
SURFACE_OFFSET = 4e-6
# Visibility rays end short of their target by this share of their length, for the same reason.
SHORT_OF_TARGET = 1e-5
# Below this largest coordinate a scene is tiny, m.
_SMALL = 0.125


def surface_offset(scene: Scene) -> float:
    """How far rays start off a surface of ``scene``, m."""
    low, high = scene.bounds
    return float(SURFACE_OFFSET * max(np.abs(low).max(), np.abs(high).max(), np.ptp([low, high])))


def ray_scale(scene: Scene) -> float:
    """What the distance is multiplied with by which rays leave surfaces near the origin.

    It is a 65,536th of a metre, as rounding is there for coordinates of a metre. Where the largest
    coordinate is below ``_SMALL``, that would be a part of the scene itself (a 130th of a room of
    2 mm, whose light it makes 2.5 % brighter); it is made smaller by a power of two.
    """
    largest = float(np.abs(scene.corners).max())
    if largest >= _SMALL:
        return 1.0
    return float(2.0 ** np.floor(np.log2(max(largest, float(np.finfo(np.float32).tiny)))))
