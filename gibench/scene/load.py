"""Loading a scene: a built-in one by name, a mesh file, or a scene TOML."""

from __future__ import annotations

import logging
import tomllib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from gibench.errors import BadInput, printable
from gibench.scene import builtin
from gibench.scene.model import Scene
from gibench.scene.readers.assemble import assembled
from gibench.scene.readers.mesh import read_mesh
from gibench.scene.readers.scene_file import load_scene_file

_LOG = logging.getLogger(__name__)


def load_scene(name_or_path: str, called: str | None = None) -> Scene:
    """Load a built-in scene by name, or a ``.gltf``, ``.glb``, ``.obj`` or scene ``.toml`` by path.

    What a file holds that is not used, or not as it stands, is in ``Scene.warnings``, and each is
    logged as a warning of ``gibench.scene.load``.

    Args:
        name_or_path: of the scene.
        called: what a file's scene is called in place of its own name; see :func:`names_apart`.

    Raises:
        BadInput: there is no such scene, or the file is broken.
    """
    if not is_file(name_or_path):
        return builtin.build(name_or_path)
    scene = _from_file(name_or_path)
    if called is not None and called != scene.name:
        path = Path(name_or_path)
        file = printable(f"{path.absolute().parent.name}/{path.name}")
        line = f"{file} is called {called}, as another scene has its name"
        scene = replace(scene, name=called, warnings=(line, *scene.warnings))
    for warning in scene.warnings:
        _LOG.warning("%s: %s", scene.name, warning)
    return scene


def is_file(name_or_path: str) -> bool:
    """Whether :func:`load_scene` takes it for a file's path."""
    return name_or_path not in builtin.names()


def names_apart(scenes: Iterable[str]) -> dict[str, str]:
    """What to call files whose scenes would share a name, by their absolute path: the first keeps
    it, the others are numbered from 2 on. Empty where no two share one.

    Args:
        scenes: names and paths, as :func:`load_scene` takes them.
    """
    given = [key_of(scene) if is_file(scene) else scene for scene in scenes]
    own = {scene: _own_name(scene) for scene in dict.fromkeys(given)}
    taken, found, used = set(own.values()), {}, set()
    for scene in sorted(own, key=is_file):  # what is built in keeps its name
        name, number = own[scene], 1
        while name in used or (number > 1 and name in taken):
            number += 1
            name = f"{own[scene]}-{number}"
        used.add(name)
        if number > 1:
            found[scene] = name
    return found


def key_of(path: str) -> str:
    """How :func:`names_apart` names a file."""
    return str(Path(path).absolute())


def _own_name(scene: str) -> str:
    path = Path(scene)
    if not is_file(scene):
        return scene
    if path.suffix.lower() == ".toml":
        try:
            name = tomllib.loads(path.read_text("utf-8")).get("name")
        except (OSError, ValueError):  # told where it is loaded
            name = None
        if isinstance(name, str):
            return name
    return printable(path.stem)


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
