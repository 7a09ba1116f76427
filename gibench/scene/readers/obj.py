"""Wavefront OBJ (Wavefront, "Advanced Visualizer Manual", appendix B1: object files).

Materials are read by ``mtl.py``. Three further numbers of a vertex are its colour (MeshLab's and
ZBrush's convention), linear as Kd is.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gibench.arrays import Array
from gibench.errors import BadInput, printable
from gibench.progress import progress
from gibench.scene.readers.content import Content, Part, counted
from gibench.scene.readers.mtl import GLOSS_MAP, NORMAL_MAP, Library, read_libraries
from gibench.scene.readers.obj_blocks import Corners, Faces, Numbers, blocks
from gibench.scene.readers.obj_colors import vertex_colors
from gibench.scene.readers.polygons import cut, fan, fans_hold
from gibench.scene.readers.rows import Rows
from gibench.scene.readers.text import argument, read_text, statements

Corner = tuple[int, int, int]
# Letters from which on a file is read by whole blocks of lines, with progress.
LARGE_TEXT = 1 << 22


class _RunKey(NamedTuple):
    """Faces that become one part: same group, same material, same kinds of index."""

    group: str
    material: str
    has_uv: bool
    has_normal: bool


@dataclass
class _Plain:
    """An OBJ file's numbers and faces; corners are (vertex, uv, normal), counted from 1."""

    numbers: dict[str, Rows] = field(
        default_factory=lambda: {"v": Rows(3), "vt": Rows(2), "vn": Rows(3)}
    )
    # Three or four numbers behind the positions of vertices, from a number on.
    colors: list[tuple[int, Array]] = field(default_factory=list)
    faces: dict[_RunKey, list[list[Corner] | Corners]] = field(default_factory=dict)
    libraries: list[str] = field(default_factory=list)
    out_of_range: int = 0
    not_faces: int = 0
    ignored_lines: int = 0
    unread: Counter[str] = field(default_factory=Counter)


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
    arrays = {key: rows.array() for key, rows in plain.numbers.items()}
    colors, said_of_colors = vertex_colors(plain.colors, len(arrays["v"]))
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
        warnings=(*library.warnings, *said_of_colors, *_remarks(plain, crossing)),
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
    if plain.unread:
        told = ", ".join([keyword for keyword, _ in plain.unread.most_common(5)])
        said.append(f"{counted(plain.unread.total(), 'statement')} not known, left out ({told})")
    if crossing:
        said.append(
            f"{counted(crossing, 'polygon')} without an area, or crossing its own outline: taken "
            "as a fan of triangles"
        )
    return said


_CURVES_AND_POINTS = {"p", "l", "curv", "curv2", "surf"}
# Of smoothing and display, which nothing here does, and what belongs to curves and surfaces.
_NO_EFFECT = {
    "s", "mg", "bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj", "ctech", "stech",
    "vp", "cstype", "deg", "bmat", "step", "parm", "trim", "hole", "scrv", "sp", "end", "con",
}  # fmt: skip


class _Lines:
    """Takes an OBJ file's lines in their order."""

    def __init__(self, path: Path) -> None:
        self.plain = _Plain()
        self._path = path
        self._group, self._material = "", ""
        self._seen: dict[str, Corner] = {}
        # Indices may point forwards, so the range is checked at the end.
        self._pending: list[tuple[_RunKey, list[Corner] | Corners]] = []

    def read(self, text: str, first_line: int) -> None:
        """Lines of any kind, one by one."""
        plain, seen, path = self.plain, self._seen, self._path
        for at, statement in statements(text):
            number = first_line + at - 1
            keyword = statement.split(None, 1)[0]
            if keyword in plain.numbers:
                words = statement.partition("#")[0].split()
                _read_numbers(plain, keyword, words[1:], number, path)
            elif keyword in ("f", "fo"):  # fo: outlines of faces before version 3
                words = statement.partition("#")[0].split()
                try:
                    corners = [seen.get(w) or _corner(w, plain.numbers, seen) for w in words[1:]]
                except ValueError as error:
                    raise BadInput(f"line {number}: face index '{error}'", where=path) from error
                if len(corners) < 3:
                    plain.not_faces += 1
                    continue
                has_uv = 0 not in [corner[1] for corner in corners]
                has_normal = 0 not in [corner[2] for corner in corners]
                self._pending.append((self._key(has_uv, has_normal), corners))
            elif keyword in ("o", "g"):
                self._group = " ".join(argument(statement).split())
            elif keyword == "usemtl":
                self._material = " ".join(argument(statement).split())
            elif keyword == "mtllib":
                plain.libraries.append(argument(statement))
            elif keyword in _CURVES_AND_POINTS:
                plain.ignored_lines += 1
            elif keyword not in _NO_EFFECT:
                plain.unread[keyword[:24]] += 1

    def _key(self, has_uv: bool, has_normal: bool) -> _RunKey:
        return _RunKey(self._group, self._material, has_uv, has_normal)

    def add_numbers(self, block: Numbers) -> None:
        """Lines of ``v``, ``vt`` or ``vn``."""
        rows = self.plain.numbers[block.keyword]
        if block.colors is not None:
            self.plain.colors.append((len(rows), block.colors))
        rows.extend(block.rows)

    def add_faces(self, block: Faces) -> None:
        """Lines of ``f``, all of one kind."""
        counts = [len(rows) for rows in self.plain.numbers.values()]
        has_uv, has_normal = block.has
        self._pending.append((self._key(has_uv, has_normal), block.counted_from(counts)))

    def finished(self) -> _Plain:
        """All that was read, without faces whose indices are out of range."""
        for key, corners in self._pending:
            if isinstance(corners, np.ndarray):
                sound = self._sound(key, corners)
                self.plain.out_of_range += len(corners) - int(sound.sum())
                if sound.any():
                    self.plain.faces.setdefault(key, []).append(corners[sound])
            elif _inside(key, corners, self.plain):
                self.plain.faces.setdefault(key, []).append(corners)
            else:
                self.plain.out_of_range += 1
        return self.plain

    def _sound(self, key: _RunKey, corners: Corners) -> Array:
        limits = np.array([len(rows) for rows in self.plain.numbers.values()])
        used = np.array([True, key.has_uv, key.has_normal])
        inside = (corners > 0) & (corners <= limits) | ~used
        return np.asarray(inside.all(axis=(1, 2)))


def _plain(text: str, path: Path, whole_blocks_from: int = LARGE_TEXT) -> _Plain:
    """The file's numbers and faces.

    Args:
        text: of the file.
        path: of the file, for messages.
        whole_blocks_from: letters from which on lines of one kind are read many at a time.
    """
    lines = _Lines(path)
    if len(text) < whole_blocks_from:
        lines.read(text, 1)
        return lines.finished()
    with progress(f"Reading {printable(path.name)}", len(text)) as advance:
        number = 1
        for block in blocks(text):
            if isinstance(block.content, Numbers):
                lines.add_numbers(block.content)
            elif isinstance(block.content, Faces):
                lines.add_faces(block.content)
            else:
                lines.read(block.text, number)
            number += block.text.count("\n")
            advance(len(block.text))
    return lines.finished()


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
        plain.colors.append((len(rows), np.array([values[3:7]])))
    rows.append(values[:wanted])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _corner(word: str, numbers: dict[str, Rows], seen: dict[str, Corner]) -> Corner:
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


def _triangles(faces: list[list[Corner] | Corners], vertices: Array) -> tuple[Array, int]:
    """Corners (t, 3, 3) of the triangles of ``faces`` in their order, and how many cross
    themselves.
    """
    crossing = 0
    pieces: list[Array] = []
    for single, some in groupby(faces, lambda face: isinstance(face, list)):
        if not single:
            for block in some:
                found, crossed = _cut(np.asarray(block), vertices)
                pieces += found
                crossing += crossed
            continue
        listed = list(some)
        own: list[Array] = [np.empty((0, 3, 3), np.int64)] * len(listed)
        sizes = np.array([len(face) for face in listed])
        for size in np.unique(sizes).tolist():
            mine = np.flatnonzero(sizes == size)
            found, crossed = _cut(np.array([listed[i] for i in mine], np.int64), vertices)
            crossing += crossed
            for i, piece in zip(mine, found, strict=True):
                own[i] = piece
        pieces += own
    return np.concatenate(pieces), crossing


def _cut(corners: Corners, vertices: Array) -> tuple[list[Array], int]:
    """The triangles (k, 3, 3) of each of the polygons (n, size, 3), and how many polygons cross
    themselves.
    """
    size = corners.shape[1]
    fanned = list(corners[:, fan(size)])
    crossing = 0
    if size > 3:
        with np.errstate(all="ignore"):
            points = vertices[corners[:, :, 0] - 1]
            holds = fans_hold(points)
        for row in np.flatnonzero(~holds):
            order, simple = cut(points[row])
            fanned[row] = corners[row][order]
            crossing += not simple
    return fanned, crossing


def _part(
    run: _RunKey,
    corners: Array,
    arrays: dict[str, Array],
    colors: Array | None,
    library: Library,
    object_id: int,
) -> Part:
    """A vertex for each combination of indices that the run uses."""
    from trimesh.visual.texture import unmerge_faces  # slow to load

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
        low = int(v.min())
        is_used = np.zeros(int(v.max()) + 1 - low, np.bool_)
        is_used[v - low] = True
        masks["v"], faces = np.flatnonzero(is_used) + low, (np.cumsum(is_used) - 1)[v - low]
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
        normal_uvs=library.uvs_of(number, NORMAL_MAP, uvs),
        gloss_uvs=library.uvs_of(number, GLOSS_MAP, uvs),
        colors=None if colors is None else colors[masks["v"]],
    )
