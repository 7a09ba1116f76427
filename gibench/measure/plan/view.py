"""Which camera a run looks through."""

from __future__ import annotations

import numpy as np

from gibench.errors import BadInput
from gibench.scene.model import Camera, Scene


def choose_camera(scene: Scene, which: str | None) -> Camera:
    """The camera of ``scene`` with the number or name ``which``; its first when None.

    A scene without cameras is seen from within, along its longest horizontal axis.

    Raises:
        BadInput: it has no such camera.
    """
    cameras = scene.cameras or (interior_camera(scene),)
    if which is None:
        return cameras[0]
    for number, camera in enumerate(cameras):
        if which in (str(number), camera.name):
            return camera
    names = ", ".join(f"{number} ({camera.name})" for number, camera in enumerate(cameras))
    raise BadInput(f"scene {scene.name} has no camera '{which}'", mend=f"it has {names}")


def interior_camera(scene: Scene) -> Camera:
    """A view from near one end of the bounds towards the other, at 40 % of the height."""
    low, high = scene.bounds
    size = high - low
    along = 0 if size[0] >= size[2] else 2
    eye = low + size * np.array([0.5, 0.4, 0.5])
    target = eye.copy()
    eye[along] = low[along] + 0.1 * size[along]
    target[along] = high[along]
    return Camera(
        position=(float(eye[0]), float(eye[1]), float(eye[2])),
        target=(float(target[0]), float(target[1]), float(target[2])),
        fov_degrees=60.0,
        name="interior",
    )
