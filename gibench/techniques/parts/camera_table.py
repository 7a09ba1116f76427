"""The camera as kernels read it."""

from __future__ import annotations

import math

import numpy as np

from gibench.arrays import Floats
from gibench.scene.model import Camera

CAMERA_FLOATS = 12
"""Four vectors (kernels_cl/common/camera.cl)."""


def camera_table(camera: Camera, width: int, height: int) -> Floats:
    """The camera as kernels_cl/common/camera.cl reads it, (12,) float32."""
    position = np.asarray(camera.position, np.float64)
    forward = np.asarray(camera.target, np.float64) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(camera.up, np.float64))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    half = math.tan(math.radians(camera.fov_degrees) / 2)
    parts = (position, forward, right * half * width / height, up * half)
    return np.concatenate(parts).astype(np.float32)
