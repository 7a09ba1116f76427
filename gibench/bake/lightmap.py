"""Unwrapping a scene once: the lightmap kept by the content it was made from."""

from __future__ import annotations

import hashlib
import tempfile
import zipfile
from dataclasses import fields
from importlib.resources import files
from pathlib import Path

import numpy as np

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
    """Name of the stored lightmap: its scene, its size and the code that unwraps."""
    digest = hashlib.sha256(f"{scene.content_hash()} {receivers}".encode())
    for source in sorted(files("gibench.scene.lightmap").iterdir(), key=lambda entry: entry.name):
        if source.name.endswith(".py"):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:32]


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
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
            try:
                np.savez(file, size=size, triangle_uvs=lightmap.triangle_uvs, **arrays)
                file.close()
                Path(file.name).replace(path)  # atomic: readers see all of it or nothing
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise
    except OSError:
        return
