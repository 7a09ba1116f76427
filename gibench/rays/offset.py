"""How far rays start off surfaces and end short of them, so that none meets its own surface."""

from __future__ import annotations

import numpy as np

from gibench.scene.model import Scene

# Rays start off the surface they leave by this share of the scene's extent: some 30 times the
# rounding of a float32 coordinate of that size.
SURFACE_OFFSET = 4e-6
# Visibility rays end short of their target by this share of their length, for the same reason.
SHORT_OF_TARGET = 1e-5


def surface_offset(scene: Scene) -> float:
    """How far rays start off a surface of ``scene``, m."""
    low, high = scene.bounds
    return float(SURFACE_OFFSET * max(np.abs(low).max(), np.abs(high).max(), np.ptp([low, high])))
