"""Wavefront OBJ with MTL materials.

The text is first put into the plain form that trimesh reads rightly: absolute indices (trimesh
misreads negative ones), triangles (polygons as fans, which is exact for convex ones), and one
``o`` per run of faces with the same group, material and kinds of index. Numbers and vertex
splitting are then trimesh's work.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh.exchange.obj as trimesh_obj

from gibench.arrays import Vec3
from gibench.errors import BadInput
from gibench.scene.files import find_beside, read_bytes
from gibench.scene.model import (
    BLACK,
    Material,
    Texture,
)
from gibench.scene.readers.content import Content, Part, counted, vec3
from gibench.scene.readers.textures import (
    UnreadableImage,
    average,
    texture_from_bytes,
    texture_from_image,
)

# Kd of a face without a material, or of a material that names none. The MTL specification gives
# no default; 0.8 is Material's own.
DEFAULT_COLOR: Vec3 = Material("default").base_color

Corner = tuple[int, int, int]


class _RunKey(NamedTuple):
    """Faces that become one part: same group, same material, same kinds of index."""

    group: str
    material: str
    has_uv: bool
    has_normal: bool


@dataclass
class _PlainObj:
    """An OBJ file's text in plain form."""

    vertex_lines: list[str] = field(default_factory=list)
    faces: dict[_RunKey, list[str]] = field(default_factory=dict)
    libraries: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=lambda: {"v": 0, "vt": 0, "vn": 0})
    out_of_range: int = 0
    not_faces: int = 0
    ignored_lines: int = 0


def load_obj(path: Path) -> Content:
    """Read an OBJ file with its materials and textures.

    ``o`` and ``g`` names make the objects. Kd is the albedo, times map_Kd; Ke is emitted radiance.

    Raises:
        BadInput: not a readable OBJ file, or one without faces.
    """
    text = _text(path)
    plain = _plain(text, path)
    if not plain.faces:
        what = "no triangles"
        if plain.out_of_range:
            what += f" ({counted(plain.out_of_range, 'face')} with an index out of range)"
        raise BadInput(what, where=path, mend="the file must hold faces ('f' lines)")
    runs = list(plain.faces)
    geometry = _through_trimesh(plain, runs, path)
    warnings: list[str] = []
    materials, textures, numbers = _materials(runs, plain.libraries, path, warnings)
    group_numbers = {group: i for i, group in enumerate(dict.fromkeys(run.group for run in runs))}
    parts = tuple(
        _part(geometry[str(i)], numbers[run.material], group_numbers[run.group])
        for i, run in enumerate(runs)
    )
    if plain.out_of_range:
        warnings.append(f"{counted(plain.out_of_range, 'face')} with an index out of range dropped")
    if plain.not_faces:
        warnings.append(f"{counted(plain.not_faces, 'face')} with fewer than three corners dropped")
    if plain.ignored_lines:
        warnings.append(
            f"{counted(plain.ignored_lines, 'line')} of points, lines or curves ignored"
        )
    names = tuple(group_numbers)
    return Content(parts, materials, textures, object_names=names, warnings=tuple(warnings))


def _text(path: Path) -> str:
    data = read_bytes(path)
    if b"\0" in data[:65536]:
        raise BadInput("binary data, not an OBJ text file", where=path)
    text = data.decode("utf-8", errors="replace")
    return text.replace("\\\r\n", " ").replace("\\\n", " ")


_CURVES_AND_POINTS = {"p", "l", "curv", "curv2", "surf"}


def _plain(text: str, path: Path) -> _PlainObj:
    plain = _PlainObj()
    counts = plain.counts
    group, material = "", ""
    seen: dict[str, Corner] = {}
    # Indices may point forwards, so the range is checked at the end.
    pending: list[tuple[_RunKey, list[Corner]]] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        keyword = words[0]
        if keyword in counts:
            wanted = 2 if keyword == "vt" else 3
            if keyword == "vt" and len(words) == 2:  # a 1D texture coordinate
                words.append("0")
            if len(words) <= wanted:
                raise BadInput(
                    f"line {number}: '{keyword}' with {counted(len(words) - 1, 'number')}",
                    where=path,
                    mend=f"it takes {wanted}",
                )
            plain.vertex_lines.append(" ".join(words[: wanted + 1]))
            counts[keyword] += 1
        elif keyword == "f":
            try:
                corners = [seen.get(word) or _corner(word, counts, seen) for word in words[1:]]
            except ValueError as error:
                raise BadInput(f"line {number}: face index '{error}'", where=path) from error
            if len(corners) < 3:
                plain.not_faces += 1
                continue
            key = _RunKey(
                group,
                material,
                0 not in [corner[1] for corner in corners],
                0 not in [corner[2] for corner in corners],
            )
            pending.append((key, corners))
        elif keyword in ("o", "g"):
            group = " ".join(words[1:])
        elif keyword == "usemtl":
            material = " ".join(words[1:])
        elif keyword == "mtllib":
            plain.libraries.append(line.split("mtllib", 1)[1].strip())
        elif keyword in _CURVES_AND_POINTS:
            plain.ignored_lines += 1
    _write_faces(plain, pending)
    return plain


def _corner(word: str, counts: dict[str, int], seen: dict[str, Corner]) -> Corner:
    """Absolute 1-based (vertex, uv, normal) of ``1/2/3``; 0 stands for none, -1 for outside.

    What does not depend on the place in the file is noted in ``seen``: most corners recur.
    """
    indices = [0, 0, 0]
    for i, (digits, keyword) in enumerate(zip(word.split("/"), counts, strict=False)):
        if not digits:
            continue
        try:
            index = int(digits)
        except ValueError as error:
            raise ValueError(word) from error
        if index < 0:
            index = max(counts[keyword] + 1 + index, -1) or -1
        elif index == 0:
            index = -1  # OBJ counts from 1
        indices[i] = index
    if not indices[0]:
        raise ValueError(word)
    corner = indices[0], indices[1], indices[2]
    if "-" not in word:
        seen[word] = corner
    return corner


def _write_faces(plain: _PlainObj, pending: list[tuple[_RunKey, list[Corner]]]) -> None:
    # One cache of corner texts for each kind of face, as most corners recur.
    caches: dict[tuple[bool, bool], dict[Corner, str]] = {}
    for key, corners in pending:
        cache = caches.setdefault((key.has_uv, key.has_normal), {})
        words = []
        for corner in corners:
            word = cache.get(corner)
            if word is None:
                word = cache[corner] = _corner_text(corner, key, plain.counts)
            words.append(word)
        if "" in words:
            plain.out_of_range += 1
            continue
        lines = plain.faces.setdefault(key, [])
        for second, third in pairwise(words[1:]):
            lines.append(f"f {words[0]} {second} {third}")


def _corner_text(corner: Corner, key: _RunKey, counts: dict[str, int]) -> str:
    """The corner in OBJ's writing, without the indices its run does not use; '' outside."""
    used = (True, key.has_uv, key.has_normal)
    for index, is_used, count in zip(corner, used, counts.values(), strict=True):
        if is_used and not 0 < index <= count:
            return ""
    v, t, n = corner
    if key.has_uv:
        return f"{v}/{t}/{n}" if key.has_normal else f"{v}/{t}"
    return f"{v}//{n}" if key.has_normal else str(v)


def _through_trimesh(
    plain: _PlainObj, runs: list[_RunKey], path: Path
) -> dict[str, dict[str, Any]]:
    lines = list(plain.vertex_lines)
    for i, run in enumerate(runs):
        lines.append(f"o {i}")
        lines += plain.faces[run]
    try:
        kwargs = trimesh_obj.load_obj(
            io.StringIO("\n".join(lines)),
            skip_materials=True,
            group_material=False,
            split_objects=True,
        )
    except (ValueError, IndexError, DeprecationWarning) as error:
        raise BadInput(f"not a sound OBJ file ({error})", where=path) from error
    geometry: dict[str, dict[str, Any]] = kwargs["geometry"]
    return geometry


def _part(mesh: dict[str, Any], material: int, object_id: int) -> Part:
    visual = mesh.get("visual")
    return Part(
        positions=np.asarray(mesh["vertices"]),
        triangles=np.asarray(mesh["faces"], np.int64),
        material=material,
        object_id=object_id,
        normals=mesh.get("vertex_normals"),
        uvs=None if visual is None else visual.uv,
    )


class _Images:
    """trimesh's resolver for an MTL file: keeps the bytes and notes what was missing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.missing: list[str] = []

    def get(self, name: str) -> bytes:
        """The content of an image file named by a ``map_`` statement, which may carry options."""
        found = find_beside(self.folder, _without_options(name))
        if found is None:
            self.missing.append(_without_options(name))
            raise FileNotFoundError(name)
        return found.read_bytes()


# Options of texture maps in MTL and how many arguments each takes at most (Wavefront MTL
# specification); -o, -s and -t take one to three numbers.
_MAP_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1,
    "-mm": 2, "-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-type": 1,
}  # fmt: skip


def _without_options(statement: str) -> str:
    """The file name at the end of a ``map_`` statement; it may hold spaces."""
    rest = statement.strip()
    while (option := rest.partition(" ")[0]) in _MAP_OPTIONS:
        rest = rest.partition(" ")[2].strip()
        for i in range(_MAP_OPTIONS[option]):
            argument, _, after = rest.partition(" ")
            if i > 0 and not _is_number(argument):
                break
            rest = after.strip()
    return rest


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _materials(
    runs: list[_RunKey], libraries: list[str], path: Path, warnings: list[str]
) -> tuple[tuple[Material, ...], tuple[Texture, ...], dict[str, int]]:
    """The used materials, their textures, and each material's number by name."""
    images = _Images(path.parent)
    found: dict[str, dict[str, Any]] = {}
    for library in dict.fromkeys(libraries):
        file = find_beside(path.parent, library)
        if file is None:
            warnings.append(f"material file '{library}' not found: default colours used")
            continue
        text = read_bytes(file).decode("utf-8", errors="replace")
        plain = "\n".join(line.partition("#")[0] for line in text.splitlines())
        try:
            found.update(trimesh_obj.parse_mtl(plain, resolver=images))
        except (ValueError, TypeError, KeyError, IndexError) as error:
            warnings.append(f"material file '{library}' is not sound ({error}): not used")
    names = list(dict.fromkeys(run.material for run in runs))
    if unknown := [name for name in names if name and name not in found]:
        warnings.append(
            f"{counted(len(unknown), 'material')} not defined ({', '.join(unknown[:3])}): "
            "default colours used"
        )
    textures: dict[str, Texture] = {}
    materials = [_material(name, found.get(name, {}), images, textures) for name in names]
    if images.missing:
        missing = list(dict.fromkeys(images.missing))
        warnings.append(
            f"{counted(len(missing), 'texture')} missing or unreadable ({', '.join(missing[:3])}): "
            "plain colours used"
        )
    masked = sum("map_d" in found.get(name, {}) for name in names)
    if masked:
        warnings.append(f"alpha masks of {counted(masked, 'material')} ignored: drawn opaque")
    return tuple(materials), tuple(textures.values()), {name: i for i, name in enumerate(names)}


def _material(
    name: str, entries: dict[str, Any], images: _Images, textures: dict[str, Texture]
) -> Material:
    texture = -1
    image = entries.get("image")
    if image is not None:
        file = image.info["file_path"]
        try:
            if file not in textures:
                textures[file] = texture_from_image(_without_options(file), image)
            texture = list(textures).index(file)
        except UnreadableImage:
            images.missing.append(_without_options(file))
    emission = _color(entries.get("ke"), BLACK)
    if any(emission) and "map_ke" in entries:
        statement = " ".join(entries["map_ke"])
        try:
            glow = average(texture_from_bytes(statement, images.get(statement)))
            emission = vec3(np.multiply(emission, glow))
        except (OSError, UnreadableImage):
            images.missing.append(_without_options(statement))
    # With a texture but no Kd, the texture is the albedo; with Kd 0 the exporter has left it to
    # the texture as well.
    color = _color(entries.get("kd"), (1.0, 1.0, 1.0) if texture >= 0 else DEFAULT_COLOR)
    if texture >= 0 and not any(color):
        color = (1.0, 1.0, 1.0)
    albedo = vec3(np.clip(color, 0.0, 1.0))
    return Material(name or "default", albedo, emission, texture)


def _color(values: Any, default: Vec3) -> Vec3:
    """A colour of one or three numbers; the default where there is none."""
    try:
        numbers = np.asarray(values, np.float64).ravel()
    except (ValueError, TypeError):
        return default
    if numbers.size == 1:
        numbers = np.repeat(numbers, 3)
    if numbers.size < 3 or not np.isfinite(numbers).all() or (numbers < 0).any():
        return default
    return vec3(numbers[:3])
