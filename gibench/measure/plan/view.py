"""Which camera a run looks through."""

from __future__ import annotations

from gibench.errors import BadInput
from gibench.scene.model import Camera, Scene
from gibench.scene.readers.viewpoint import suggested_camera


def choose_camera(scene: Scene, which: str | None) -> Camera:
    """The camera of ``scene`` with the number or name ``which``; its first when None.

    A scene without cameras is seen as one whose file has none (``suggested_camera``).

    Raises:
        BadInput: it has no such camera.
    """
    cameras = scene.cameras or (suggested_camera(scene),)
    if which is None:
        return cameras[0]
    for number, camera in enumerate(cameras):
        if which in (str(number), camera.name):
            return camera
    names = ", ".join(f"{number} ({camera.name})" for number, camera in enumerate(cameras))
    raise BadInput(f"scene {scene.name} has no camera '{which}'", mend=f"it has {names}")
