"""Unwrapping a scene once: the lightmap kept by the content it was made from."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Iterator
from dataclasses import fields
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

import numpy as np

from gibench.files import write_whole
from gibench.scene.lightmap import Fragments, Lightmap, Receivers
from gibench.scene.model import Scene


def cached_lightmap(scene: Scene, receivers: int, cache_dir: Path) -> Lightmap:
    """The lightmap of ``scene`` with about ``receivers`` receivers, from the cache where it is.

    A file that cannot be read is made again; one that cannot be written is left out.

    Raises:
        BadInput: the scene cannot be unwrapped.
    """
    from gibench.scene.lightmap.atlas import unwrap

    path = cache_dir / "lightmaps" / f"{lightmap_key(scene, receivers)}.npz"
    stored = _load(path)
    if stored is not None:
        return stored
    lightmap = unwrap(scene, receivers)
    _save(path, lightmap)
    return lightmap


def lightmap_key(scene: Scene, receivers: int) -> str:
    """Name of the stored lightmap: what unwrapping looks at, its size and the code that unwraps.

    Lights, the environment, cameras and probes are not part of it: a scene that differs in them
    alone has the same lightmap. Texture coordinates and textures count where a material uses them.
    """
    digest = hashlib.sha256(f"{receivers} {version('xatlas')}".encode())
    surfaces = [(one.base_color, one.emission, one.texture) for one in scene.materials]
    digest.update(repr(surfaces).encode())
    arrays = [scene.positions, scene.triangles, scene.normals, scene.material_ids]
    own = np.empty(0) if scene.lightmap_uvs is None else scene.lightmap_uvs
    used = sorted({one.texture for one in scene.materials if one.texture >= 0})
    if used:
        arrays += [scene.uvs, *(scene.textures[number].pixels for number in used)]
    if scene.cutouts is not None:
        arrays += scene.cutouts.arrays()
        digest.update(files("gibench.scene").joinpath("cutouts.py").read_bytes())
    if scene.glow is not None:
        arrays += scene.glow.arrays()
    for array in (*arrays, own):
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    for name, content in sorted(_sources(files("gibench.scene.lightmap"))):
        digest.update(name.encode() + content)
    return digest.hexdigest()[:32]


def _sources(folder: Traversable, prefix: str = "") -> Iterator[tuple[str, bytes]]:
    """Names and contents of the Python files in ``folder`` and beneath it."""
    for entry in folder.iterdir():
        if entry.name.endswith(".py"):
            yield prefix + entry.name, entry.read_bytes()
        elif entry.is_dir():
            yield from _sources(entry, f"{prefix}{entry.name}/")


def _load(path: Path) -> Lightmap | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            size = stored["size"]
            return Lightmap(
                width=int(size[0]),
                height=int(size[1]),
                triangle_uvs=stored["triangle_uvs"],
                receivers=Receivers(**{f.name: stored[f"r_{f.name}"] for f in fields(Receivers)}),
                fragments=Fragments(**{f.name: stored[f"f_{f.name}"] for f in fields(Fragments)}),
                requested=int(size[2]),
            )
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
        return None


def _save(path: Path, lightmap: Lightmap) -> None:
    arrays = {f"r_{f.name}": getattr(lightmap.receivers, f.name) for f in fields(Receivers)}
    arrays |= {f"f_{f.name}": getattr(lightmap.fragments, f.name) for f in fields(Fragments)}
    size = np.array([lightmap.width, lightmap.height, lightmap.requested], np.int64)
    body = io.BytesIO()
    np.savez(body, allow_pickle=False, size=size, triangle_uvs=lightmap.triangle_uvs, **arrays)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, body.getbuffer())
    except OSError:
        return
