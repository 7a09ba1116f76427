"""From what a reader found to a Scene."""

from __future__ import annotations

from dataclasses import replace

from gibench.errors import printable
from gibench.progress import progress
from gibench.scene.model import Scene
from gibench.scene.readers.backs import apart, with_backs
from gibench.scene.readers.clean import clean
from gibench.scene.readers.content import Content
from gibench.scene.readers.defaults import scene_of
from gibench.scene.readers.realise import realised
from gibench.scene.readers.recentre import recentred


def assembled(name: str, content: Content, where: object) -> Scene:
    """The scene of ``content``, with defaults for what it lacks.

    Args:
        name: of the scene.
        content: what was read.
        where: the file, for messages.

    Raises:
        BadInput: no usable triangle is left.
    """
    with progress(f"Preparing {name}", 5) as advance:
        content, origin = recentred(realised(content))
        content = _printable(content)
        advance(1)
        fronts = clean(content, where)
        advance(1)
        mesh = with_backs(fronts, content.materials, content.lights, content.cameras)
        advance(1)
        mesh = apart(mesh, backs=len(mesh.triangles) - len(fronts.triangles))
        advance(1)
        scene = scene_of(name, mesh, content)
        advance(1)
    return replace(scene, origin=origin) if any(origin) else scene


def _printable(content: Content) -> Content:
    """The content with names and warnings that can be written to any file."""
    return replace(
        content,
        materials=tuple(replace(m, name=printable(m.name)) for m in content.materials),
        cameras=tuple(replace(c, name=printable(c.name)) for c in content.cameras),
        object_names=tuple(printable(name) for name in content.object_names),
        warnings=tuple(printable(line) for line in content.warnings),
    )
