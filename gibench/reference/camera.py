"""The pinhole camera's image plane."""

from __future__ import annotations

import math

import numpy as np

from gibench.arrays import Doubles
from gibench.errors import BadInput
from gibench.scene.model import Camera


def image_plane(camera: Camera, width: int, height: int) -> Doubles:
    """Position, forward, and the vectors from the image's centre to its right and upper edge.

    A pixel (x, y), row 0 at the top, is seen along
    ``forward + (2 (x + 0.5) / width - 1) right + (1 - 2 (y + 0.5) / height) up``.

    Returns:
        (4, 3) float64; forward is a unit vector, the image plane lies at distance 1.

    Raises:
        BadInput: no image, no view direction, an up vector along it, or a field of view out of
            (0, 180) degrees.
    """
    if width < 1 or height < 1:
        raise BadInput(f"an image of {width} x {height} pixels", where=camera.name)
    if not 0 < camera.fov_degrees < 180:
        raise BadInput(
            f"a field of view of {camera.fov_degrees} degrees",
            where=camera.name,
            mend="give one between 0 and 180",
        )
    position = np.asarray(camera.position, np.float64)
    forward = np.asarray(camera.target, np.float64) - position
    right = np.cross(forward, np.asarray(camera.up, np.float64))
    if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(forward):
        raise BadInput(
            "the camera's target and up vector give no image plane",
            where=camera.name,
            mend="move the target off the camera and the up vector off the view direction",
        )
    forward /= np.linalg.norm(forward)
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    tangent = math.tan(math.radians(camera.fov_degrees) / 2)
    return np.array((position, forward, right * (tangent * width / height), up * tangent))
