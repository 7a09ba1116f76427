"""Directions to cast rays along."""

from __future__ import annotations

import math

import numpy as np

from gibench.arrays import Doubles


def spherical_fibonacci(count: int) -> Doubles:
    """``count`` directions (count, 3) spread evenly over the sphere.

    Keinert et al. 2015, "Spherical Fibonacci Mapping", equation 2.
    """
    i = np.arange(count)
    azimuth = 2 * np.pi * np.mod(i * ((math.sqrt(5) - 1) / 2), 1)
    z = 1 - (2 * i + 1) / count
    r = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1)


def random_rotation(rng: np.random.Generator) -> Doubles:
    """A rotation matrix (3, 3), uniform over all (Shoemake 1992: a uniform unit quaternion)."""
    quaternion = rng.normal(size=4)
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
