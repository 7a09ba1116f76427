"""Loading a scene: a built-in one by name, a mesh file, or a scene TOML."""

from __future__ import annotations

import logging
from pathlib import Path

from gibench.errors import BadInput, printable
from gibench.scene import builtin
from gibench.scene.model import Scene
from gibench.scene.readers.assemble import assembled
from gibench.scene.readers.mesh import read_mesh
from gibench.scene.readers.scene_file import load_scene_file

_LOG = logging.getLogger(__name__)


def load_scene(name_or_path: str) -> Scene:
    """Load a built-in scene by name, or a ``.gltf``, ``.glb``, ``.obj`` or scene ``.toml`` by path.

    What a file holds that is not used, or not as it stands, is in ``Scene.warnings``, and each is
    logged as a warning of ``gibench.scene.load``.

    Raises:
        BadInput: there is no such scene, or the file is broken.
    """
    if not is_file(name_or_path):
        return builtin.build(name_or_path)
    scene = _from_file(name_or_path)
    for warning in scene.warnings:
        _LOG.warning("%s: %s", scene.name, warning)
    return scene


def is_file(name_or_path: str) -> bool:
    """Whether :func:`load_scene` takes it for a file's path."""
    return name_or_path not in builtin.names()


def _from_file(name_or_path: str) -> Scene:
    path = Path(name_or_path)
    if not _exists(path):
        raise BadInput(
            f"no scene called '{name_or_path}'",
            mend=f"use one of {', '.join(builtin.names())}, or the path of a .gltf, .glb, .obj or "
            "scene .toml file",
        )
    if path.suffix.lower() == ".toml":
        return load_scene_file(path)
    content = read_mesh(path)
    return assembled(printable(path.stem), content, path)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name too long, a NUL
        return False
