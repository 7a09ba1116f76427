"""A scene whose standing lights all change at once in one frame."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

from gibench.errors import BadInput
from gibench.scene.model import DirectionalLight, Light, Scene, Vec3
from gibench.study.frozen import FrozenShared


@dataclass(frozen=True)
class SwitchedScene(Scene):
    """A scene with its lights at a share of their strength before a frame and at another from then.

    What glows and the environment stay as they are.

    Attributes:
        switch_frame: the first frame with the new light.
        before: share of the lights' strength until then.
        after: share from then on.
    """

    switch_frame: int = 0
    before: float = 0.0
    after: float = 1.0

    def lights_at(self, frame: int) -> tuple[Light, ...]:
        """The lights in ``frame``."""
        share = self.before if frame < self.switch_frame else self.after
        return tuple(_scaled(light, share) for light in super().lights_at(frame))


def switched(scene: Scene, frame: int, before: float, after: float) -> SwitchedScene:
    """``scene`` with lights that change in ``frame``.

    Raises:
        BadInput: it has no light but what glows.
    """
    if not scene.lights:
        raise BadInput(
            f"the scene '{scene.name}' has no light that could be switched, only what glows",
            mend="give one with a point, spot or directional light by --scene",
        )
    parts = {item.name: getattr(scene, item.name) for item in fields(Scene)}
    return SwitchedScene(**parts, switch_frame=frame, before=before, after=after)


def _scaled(light: Light, share: float) -> Light:
    if isinstance(light, DirectionalLight):
        return replace(light, irradiance=_times(light.irradiance, share))
    return replace(light, intensity=_times(light.intensity, share))


def _times(color: Vec3, share: float) -> Vec3:
    r, g, b = color
    return share * r, share * g, share * b


@dataclass
class SwitchedShared(FrozenShared):
    """Shared scenes whose lights stand still but for one switch; what is baked depends on neither.

    Attributes:
        switch_frame: the first frame with the new light.
        before: share of the lights' strength until then.
        after: share from then on.
    """

    switch_frame: int = 0
    before: float = 0.0
    after: float = 1.0
    _switched: dict[str, Scene] = field(default_factory=dict, repr=False)

    def scene(self, name_or_path: str) -> Scene:
        """The scene with its switch (see :meth:`Shared.scene`).

        Raises:
            BadInput: it has no light that could be switched.
        """
        if name_or_path not in self._switched:
            standing = super().scene(name_or_path)
            self._switched[name_or_path] = switched(
                standing, self.switch_frame, self.before, self.after
            )
        return self._switched[name_or_path]
