"""Wavefront OBJ (Wavefront, "Advanced Visualizer Manual", appendix B1: object files).

Materials are read by ``mtl.py``. Three further numbers of a vertex are its colour (MeshLab's and
ZBrush's convention), linear as Kd is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from trimesh.visual.texture import unmerge_faces

from gibench.errors import BadInput
from gibench.scene.readers.content import Array, Content, Part, counted
from gibench.scene.readers.mtl import Library, read_libraries
from gibench.scene.readers.polygons import cut, fan, fans_hold
from gibench.scene.readers.text import argument, read_text, statements

Corner = tuple[int, int, int]


class _RunKey(NamedTuple):
    """Faces that become one part: same group, same material, same kinds of index."""

    group: str
    material: str
    has_uv: bool
    has_normal: bool


@dataclass
class _Plain:
    """An OBJ file's numbers and faces; corners are (vertex, uv, normal), counted from 1."""

    numbers: dict[str, list[tuple[float, ...]]] = field(
        default_factory=lambda: {"v": [], "vt": [], "vn": []}
    )
    colors: dict[int, tuple[float, ...]] = field(default_factory=dict)  # by vertex, from 0
    faces: dict[_RunKey, list[list[Corner]]] = field(default_factory=dict)
    libraries: list[str] = field(default_factory=list)
    out_of_range: int = 0
    not_faces: int = 0
    ignored_lines: int = 0


def load_obj(path: Path) -> Content:
    """Read an OBJ file with its materials and textures.

    ``o`` and ``g`` names make the objects.

    Raises:
        BadInput: not a readable OBJ file, or one without faces.
    """
    plain = _plain(read_text(path, "an OBJ text file"), path)
    if not plain.faces:
        what = "no triangles"
        if plain.out_of_range:
            what += f" ({counted(plain.out_of_range, 'face')} with an index out of range)"
        raise BadInput(what, where=path, mend="the file must hold faces ('f' lines)")
    runs = list(plain.faces)
    crossing = 0
    arrays = {key: np.array(rows, np.float64) for key, rows in plain.numbers.items()}
    colors = _colors(plain, len(arrays["v"]))
    library = read_libraries(
        path.parent, plain.libraries, [run.material for run in runs], colors is not None
    )
    group_numbers = {group: i for i, group in enumerate(dict.fromkeys(run.group for run in runs))}
    parts = []
    for run in runs:
        triangles, crossed = _triangles(plain.faces[run], arrays["v"])
        crossing += crossed
        parts.append(_part(run, triangles, arrays, colors, library, group_numbers[run.group]))
    return Content(
        parts=tuple(parts),
        materials=library.materials,
        textures=library.textures,
        object_names=tuple(group_numbers),
        warnings=(*library.warnings, *_remarks(plain, crossing)),
        maps=library.maps,
    )


def _remarks(plain: _Plain, crossing: int) -> list[str]:
    said = []
    if plain.out_of_range:
        said.append(f"{counted(plain.out_of_range, 'face')} with an index out of range dropped")
    if plain.not_faces:
        said.append(f"{counted(plain.not_faces, 'face')} with fewer than three corners dropped")
    if plain.ignored_lines:
        said.append(f"{counted(plain.ignored_lines, 'line')} of points, lines or curves ignored")
    if crossing:
        said.append(
            f"{counted(crossing, 'polygon')} without an area, or crossing its own outline: taken "
            "as a fan of triangles"
        )
    return said


_CURVES_AND_POINTS = {"p", "l", "curv", "curv2", "surf"}


def _plain(text: str, path: Path) -> _Plain:
    plain = _Plain()
    group, material = "", ""
    seen: dict[str, Corner] = {}
    # Indices may point forwards, so the range is checked at the end.
    pending: list[tuple[_RunKey, list[Corner]]] = []
    for number, statement in statements(text):
        keyword = statement.split(None, 1)[0]
        if keyword in plain.numbers:
            words = statement.partition("#")[0].split()
            _read_numbers(plain, keyword, words[1:], number, path)
        elif keyword == "f":
            words = statement.partition("#")[0].split()
            try:
                corners = [seen.get(w) or _corner(w, plain.numbers, seen) for w in words[1:]]
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
            group = " ".join(argument(statement).split())
        elif keyword == "usemtl":
            material = " ".join(argument(statement).split())
        elif keyword == "mtllib":
            plain.libraries.append(argument(statement))
        elif keyword in _CURVES_AND_POINTS:
            plain.ignored_lines += 1
    for key, corners in pending:
        if _inside(key, corners, plain):
            plain.faces.setdefault(key, []).append(corners)
        else:
            plain.out_of_range += 1
    return plain


def _read_numbers(plain: _Plain, keyword: str, words: list[str], number: int, path: Path) -> None:
    """One ``v``, ``vt`` or ``vn``."""
    wanted = 2 if keyword == "vt" else 3
    try:
        values = tuple([float(word) for word in words])
    except ValueError as error:
        wrong = next(word for word in words if not _is_number(word))
        raise BadInput(
            f"not a sound OBJ file: line {number}: '{wrong}' is no number",
            where=path,
            mend="write numbers with a point, not a comma" if "," in wrong else None,
        ) from error
    if keyword == "vt" and len(values) == 1:  # a 1D texture coordinate
        values = (*values, 0.0)
    if len(values) < wanted:
        raise BadInput(
            f"line {number}: '{keyword}' with {counted(len(values), 'number')}",
            where=path,
            mend=f"it takes {wanted}",
        )
    rows = plain.numbers[keyword]
    if keyword == "v" and len(values) >= 6:
        plain.colors[len(rows)] = values[-3:]
    rows.append(values[:wanted])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _corner(
    word: str, numbers: dict[str, list[tuple[float, ...]]], seen: dict[str, Corner]
) -> Corner:
    """Absolute 1-based (vertex, uv, normal) of ``1/2/3``; 0 stands for none, -1 for outside.

    What does not depend on the place in the file is noted in ``seen``: most corners recur.
    """
    indices = [0, 0, 0]
    for i, (digits, rows) in enumerate(zip(word.split("/"), numbers.values(), strict=False)):
        if not digits:
            continue
        try:
            index = int(digits)
        except ValueError as error:
            raise ValueError(word) from error
        if index < 0:
            index = max(len(rows) + 1 + index, -1) or -1
        elif index == 0:
            index = -1  # OBJ counts from 1
        indices[i] = index
    if not indices[0]:
        raise ValueError(word)
    corner = indices[0], indices[1], indices[2]
    if "-" not in word:
        seen[word] = corner
    return corner


def _inside(key: _RunKey, corners: list[Corner], plain: _Plain) -> bool:
    used = (True, key.has_uv, key.has_normal)
    for place, rows in enumerate(plain.numbers.values()):
        if used[place] and not all(0 < corner[place] <= len(rows) for corner in corners):
            return False
    return True


def _colors(plain: _Plain, vertices: int) -> Array | None:
    """(v, 3) colours where the file has any; white where a vertex has none."""
    if not plain.colors:
        return None
    colors = np.ones((vertices, 3))
    colors[list(plain.colors)] = list(plain.colors.values())
    return np.clip(np.nan_to_num(colors, nan=1.0), 0.0, 1.0)


def _triangles(faces: list[list[Corner]], vertices: Array) -> tuple[Array, int]:
    """Corners (t, 3, 3) of the triangles of ``faces`` in their order, and how many cross
    themselves.
    """
    crossing = 0
    sizes = np.array([len(face) for face in faces])
    pieces: list[Array] = [np.empty((0, 3, 3), np.int64)] * len(faces)
    for size in np.unique(sizes).tolist():
        mine = np.flatnonzero(sizes == size)
        corners = np.array([faces[i] for i in mine], np.int64)
        fanned = corners[:, fan(size)]
        if size > 3:
            with np.errstate(all="ignore"):
                points = vertices[corners[:, :, 0] - 1]
                holds = fans_hold(points)
        for row, i in enumerate(mine):
            pieces[i] = fanned[row]
            if size > 3 and not holds[row]:
                order, simple = cut(points[row])
                pieces[i] = corners[row][order]
                crossing += not simple
    return np.concatenate(pieces), crossing


def _part(
    run: _RunKey,
    corners: Array,
    arrays: dict[str, Array],
    colors: Array | None,
    library: Library,
    object_id: int,
) -> Part:
    """A vertex for each combination of indices that the run uses."""
    v, t, n = (np.ascontiguousarray(corners[:, :, i]) - 1 for i in range(3))
    masks: dict[str, Array] = {}
    used = [name for name, has in (("vt", run.has_uv), ("vn", run.has_normal)) if has]
    if used:
        kinds = {"vt": t, "vn": n}
        faces, masks["v"], *others = unmerge_faces(
            v, *(kinds[name] for name in used), maintain_faces=False
        )
        masks |= dict(zip(used, others, strict=True))
    else:
        masks["v"], faces = np.unique(v, return_inverse=True)
        faces = faces.reshape(v.shape)
    number = library.numbers[run.material]
    uvs = arrays["vt"][masks["vt"]] if run.has_uv else None
    return Part(
        positions=arrays["v"][masks["v"]],
        triangles=np.asarray(faces, np.int64),
        material=number,
        object_id=object_id,
        normals=arrays["vn"][masks["vn"]] if run.has_normal else None,
        uvs=library.uvs_of(number, "map_kd", uvs),
        emission_uvs=library.uvs_of(number, "map_ke", uvs),
        opacity_uvs=library.uvs_of(number, "map_d", uvs),
        colors=None if colors is None else colors[masks["v"]],
    )
