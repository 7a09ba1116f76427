"""A mesh file of any kind that is known, by its suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gibench.errors import BadInput
from gibench.scene.readers.content import Content
from gibench.scene.readers.gltf import load_gltf
from gibench.scene.readers.obj import load_obj

_READERS: dict[str, Callable[[Path], Content]] = {
    ".gltf": load_gltf,
    ".glb": load_gltf,
    ".obj": load_obj,
}


def read_mesh(path: Path) -> Content:
    """Read a mesh file of any kind that is known.

    Raises:
        BadInput: an unknown kind of file, or a broken one.
    """
    reader = _READERS.get(path.suffix.lower())
    if path.is_dir():
        raise BadInput("is a folder, not a scene file", where=path)
    if reader is None:
        raise BadInput(
            f"'{path.suffix}' is not a kind of scene file that is read",
            where=path,
            mend=f"use one of {', '.join(_READERS)}, .toml",
        )
    return reader(path)
