"""Light from infinitely far away."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Vec3


@dataclass(frozen=True)
class Environment:
    """Radiance from infinitely far away, as one equirectangular image for every kind.

    Row 0 is the zenith (+Y); column 0 starts at azimuth -pi, where
    azimuth = atan2(direction.x, -direction.z), growing with the column.

    Attributes:
        pixels: (height, width, 3) float32, W/m2/sr, sampled bilinearly at pixel centres, wrapping
            in azimuth and clamped in elevation.
    """

    pixels: Floats = field(repr=False)

    @staticmethod
    def constant(radiance: Vec3) -> Environment:
        """The same radiance from everywhere."""
        return Environment(np.asarray(radiance, np.float32).reshape(1, 1, 3))

    @staticmethod
    def gradient(zenith: Vec3, horizon: Vec3, ground: Vec3, rows: int = 64) -> Environment:
        """Zenith to horizon blended by the sine of the elevation; one colour below the horizon."""
        polar = (np.arange(rows) + 0.5) / rows * np.pi
        up = np.cos(polar)[:, None]
        top, mid, low = (np.asarray(c, np.float64) for c in (zenith, horizon, ground))
        rgb = np.where(up > 0, mid + (top - mid) * up, low)
        return Environment(rgb.astype(np.float32)[:, None, :])

    def radiance(self, directions: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Radiance (n, 3) from unit ``directions`` (n, 3), in float64."""
        height, width = self.pixels.shape[:2]
        d = np.asarray(directions, np.float64)
        azimuth = np.arctan2(d[:, 0], -d[:, 2])
        x = (azimuth / (2 * np.pi) + 0.5) * width - 0.5
        y = np.arccos(np.clip(d[:, 1], -1, 1)) / np.pi * height - 0.5
        x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        fx, fy = (x - x0)[:, None], (y - y0)[:, None]
        columns = x0 % width, (x0 + 1) % width
        rows = np.clip(y0, 0, height - 1), np.clip(y0 + 1, 0, height - 1)
        p = self.pixels.astype(np.float64)
        top = p[rows[0], columns[0]] * (1 - fx) + p[rows[0], columns[1]] * fx
        bottom = p[rows[1], columns[0]] * (1 - fx) + p[rows[1], columns[1]] * fx
        return np.asarray(top * (1 - fy) + bottom * fy)
