"""Loading a scene: a built-in one by name, a mesh file, or a scene TOML."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gibench.errors import BadInput
from gibench.scene.clean import clean
from gibench.scene.defaults import scene_of
from gibench.scene.gltf import load_gltf
from gibench.scene.model import Scene
from gibench.scene.obj import load_obj
from gibench.scene.parts import Content

_READERS: dict[str, Callable[[Path], Content]] = {
    ".gltf": load_gltf,
    ".glb": load_gltf,
    ".obj": load_obj,
}


def load_scene(name_or_path: str) -> Scene:
    """Load a built-in scene by name, or a ``.gltf``, ``.glb``, ``.obj`` or scene ``.toml`` by path.

    Raises:
        BadInput: there is no such scene, or the file is broken.
    """
    from gibench.scene import builtin
    from gibench.scene.scene_file import load_scene_file

    if name_or_path in builtin.names():
        return builtin.build(name_or_path)
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
    return scene_of(path.stem, clean(content, path), content)


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


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name too long, a NUL
        return False
