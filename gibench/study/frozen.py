"""A scene whose lights stand still, so that a technique can settle on one light."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gibench.measure.session.shared import Shared
from gibench.scene.model import DirectionalLight, Light, PointLight, Scene


def frozen(scene: Scene, frame: int) -> Scene:
    """``scene`` with its lights for ever where they are in ``frame``."""
    return replace(scene, lights=tuple(_still(light.at(frame)) for light in scene.lights))


def _still(light: Light) -> Light:
    match light:
        case DirectionalLight():
            return replace(light, swing_degrees=0.0)
        case PointLight():
            return replace(light, orbit_radius=0.0)
        case _:
            return light


@dataclass
class FrozenShared(Shared):
    """Shared scenes whose lights stand still; what is baked does not depend on lights.

    Attributes:
        light_frame: where the lights are.
    """

    light_frame: int = 0
    _frozen: dict[str, Scene] = field(default_factory=dict, repr=False)

    def scene(self, name_or_path: str) -> Scene:
        """The scene with its lights standing still (see :meth:`Shared.scene`)."""
        with self._lock:
            if name_or_path not in self._frozen:
                self._frozen[name_or_path] = frozen(super().scene(name_or_path), self.light_frame)
            return self._frozen[name_or_path]
