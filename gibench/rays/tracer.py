"""The interface of every ray tracer here: Embree on the host, the BVH kernel on the device."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints

NO_HIT = -1


class Hits(NamedTuple):
    """Closest hits of n rays.

    Attributes:
        triangle: (n,) int32 scene triangle, or -1 (NO_HIT).
        distance: (n,) float32 along the ray in units of its direction's length; inf on a miss.
        u: (n,) float32 barycentric weight of corner 1.
        v: (n,) float32 barycentric weight of corner 2.
    """

    triangle: Ints
    distance: Floats
    u: Floats
    v: Floats


class RayTracer(Protocol):
    """Traces rays against one scene."""

    def closest(
        self, origins: Floats, directions: Floats, max_distance: Floats | float = np.inf
    ) -> Hits:
        """Closest hits of rays (n, 3) at distances in (0, max_distance)."""
        ...

    def occluded(
        self, origins: Floats, directions: Floats, max_distance: Floats | float = np.inf
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether anything is hit at a distance in (0, max_distance)."""
        ...
