"""All passes of a frame, those of the scene and those of the technique."""

from __future__ import annotations

from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.technique import Pass, Technique


def frame_passes(technique: Technique) -> list[Pass]:
    """All passes of a frame in order: first those that move the scene's objects, which every
    technique with a :class:`FrameScene` called ``scene`` gets from it, then the technique's own.
    """
    scene = getattr(technique, "scene", None)
    moved = scene.passes() if isinstance(scene, FrameScene) else []
    return [*moved, *technique.passes()]
