"""From what a reader found to a Scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.arrays import Floats
from gibench.errors import BadInput, printable
from gibench.progress import progress
from gibench.scene.model import Scene
from gibench.scene.readers.backs import apart, with_backs
from gibench.scene.readers.clean import clean
from gibench.scene.readers.content import Content
from gibench.scene.readers.defaults import scene_of
from gibench.scene.readers.realise import realised
from gibench.scene.readers.recentre import recentred

# Diagonals between which light is right, m. A cube room of 1e-8 to 1e9 m a side has the same light
# within its noise; at 1e-9 squares of areas leave float32, at 1e10 unwrapping dies.
_SMALLEST, _LARGEST = 1e-7, 1e9


def assembled(name: str, content: Content, where: object) -> Scene:
    """The scene of ``content``, with defaults for what it lacks.

    Args:
        name: of the scene.
        content: what was read.
        where: the file, for messages.

    Raises:
        BadInput: no usable triangle is left, or the scene is too small or large for float32.
    """
    with progress(f"Preparing {name}", 5) as advance:
        content, origin = recentred(realised(content))
        content = _printable(content)
        advance(1)
        fronts = clean(content, where)
        _check_size(fronts.positions, where)
        advance(1)
        mesh = with_backs(fronts, content.materials, content.lights, content.cameras)
        advance(1)
        mesh = apart(mesh, backs=len(mesh.triangles) - len(fronts.triangles))
        advance(1)
        scene = scene_of(name, mesh, content)
        advance(1)
    return replace(scene, origin=origin) if any(origin) else scene


def _check_size(positions: Floats, where: object) -> None:
    across = float(np.linalg.norm(np.ptp(positions.astype(np.float64), axis=0)))
    if not _SMALLEST <= across <= _LARGEST:
        raise BadInput(
            f"the scene is {across:.3g} m across",
            where=where,
            mend=f"scale it to between {_SMALLEST:g} and {_LARGEST:g} m",
        )


def _printable(content: Content) -> Content:
    """The content with names and warnings that can be written to any file."""
    return replace(
        content,
        materials=tuple(replace(m, name=printable(m.name)) for m in content.materials),
        cameras=tuple(replace(c, name=printable(c.name)) for c in content.cameras),
        object_names=tuple(printable(name) for name in content.object_names),
        warnings=tuple(printable(line) for line in content.warnings),
    )
