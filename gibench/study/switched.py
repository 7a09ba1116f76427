"""A scene whose standing lights all change at once in one frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gibench.errors import BadInput
from gibench.scene.model import Scene
from gibench.study.frozen import FrozenShared


@dataclass(frozen=True)
class LightSwitch:
    """When lights change, and from what to what; a scene's dimmer.

    Attributes:
        frame: the first frame with the new light.
        before: share of the lights' strength until then.
        after: share from then on.
    """

    frame: int
    before: float
    after: float

    def share(self, frame: int) -> float:
        """Share of the lights' strength in ``frame``."""
        return self.before if frame < self.frame else self.after


STANDING = LightSwitch(0, 1.0, 1.0)


def switched(scene: Scene, switch: LightSwitch) -> Scene:
    """``scene`` with lights that change.

    Raises:
        BadInput: it has no light but what glows.
    """
    if not scene.lights:
        raise BadInput(
            f"the scene '{scene.name}' has no light that could be switched, only what glows",
            mend="give one with a point, spot or directional light by --scene",
        )
    return replace(scene, dimmer=switch)


@dataclass
class SwitchedShared(FrozenShared):
    """Shared scenes whose lights stand still but for one switch; what is baked depends on neither.

    Attributes:
        switch: when, and by how much.
    """

    switch: LightSwitch = STANDING
    _switched: dict[str, Scene] = field(default_factory=dict, repr=False)

    def scene(self, name_or_path: str) -> Scene:
        """The scene with its switch (see :meth:`Shared.scene`).

        Raises:
            BadInput: it has no light that could be switched.
        """
        with self._lock:
            if name_or_path not in self._switched:
                self._switched[name_or_path] = switched(super().scene(name_or_path), self.switch)
            return self._switched[name_or_path]
