"""Whole stretches of an OBJ file's lines at once: what makes a file of millions of lines quick.

A stretch is lines of one keyword that hold nothing but numbers, which NumPy parses together. What
is any different (comments, continued lines, faces of several kinds, anything unsound) is handed on
as text, for ``obj.py`` to read line by line: the result is the same, and so are the errors.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles

Corners = npt.NDArray[np.int64]
"""Faces of one size, (n, size, 3): vertex, texture coordinate and normal of every corner."""

_LINES = 1 << 16  # of a stretch at most, which bounds memory
_TIMES = f"{{1,{_LINES}}}+"
_NUMBER_LINES = r"(?:[ \t]++[-+0-9.eE]++)++[ \t]*+\n)" + _TIMES
_FACE_LINES = r"(?:f(?:[ \t]++-?[0-9]++(?:/(?:-?[0-9]++)?+){0,2}+)++[ \t]*+\n)" + _TIMES
# Not after a line that a backslash continues.
_STRETCH = re.compile(
    r"(?m)^(?<!\\\n)(?:"
    + "|".join([*(f"(?:{word}{_NUMBER_LINES}" for word in ("vn", "vt", "v")), _FACE_LINES])
    + ")"
)
# Shorter stretches are no faster than lines.
_LEAST_LINES = 8


@dataclass(frozen=True)
class Numbers:
    """Lines of ``v``, ``vt`` or ``vn``.

    Attributes:
        keyword: of the lines.
        rows: (n, 3) of ``v`` and ``vn``, (n, 2) of ``vt``.
        colors: (n, 3 or 4), what stands behind positions of vertices, or None.
    """

    keyword: str
    rows: Doubles
    colors: Doubles | None


@dataclass(frozen=True)
class Faces:
    """Lines of ``f`` with as many corners each, all written alike.

    Attributes:
        corners: as in the file, (n, size, 3): counted from 1, or backwards from -1, or 0.
        has: whether corners have texture coordinates, and normals.
    """

    corners: Corners
    has: tuple[bool, bool]

    def counted_from(self, counts: list[int]) -> Corners:
        """The corners counted from 1, with 0 for none and -1 for outside.

        Args:
            counts: how many vertices, texture coordinates and normals the file has so far.
        """
        found = self.corners
        backwards = np.maximum(np.array(counts) + 1 + found, -1)
        absolute = np.where(found < 0, np.where(backwards == 0, -1, backwards), found)
        used = np.array([True, *self.has])
        return np.asarray(np.where(absolute == 0, np.where(used, -1, 0), absolute))


@dataclass(frozen=True)
class Block:
    """Some lines.

    Attributes:
        text: of the lines.
        content: what they hold; None where they have to be read one by one.
    """

    text: str
    content: Numbers | Faces | None = None


def blocks(text: str) -> Iterator[Block]:
    """The file's lines in their order, as many at once as can be."""
    done = 0
    for found in _STRETCH.finditer(text):
        lines = found[0]
        parts = _parsed(lines) if lines.count("\n", 0, 4000) >= _LEAST_LINES else None
        if parts is None:
            continue
        if found.start() > done:
            yield Block(text[done : found.start()])
        yield from parts
        done = found.end()
    if done < len(text):
        yield Block(text[done:])


def _parsed(lines: str) -> list[Block] | None:
    keyword = lines[:2].strip()
    if keyword == "f":
        return _faces(lines)
    numbers = _numbers(lines, keyword)
    return None if numbers is None else [Block(lines, numbers)]


def _floats(text: str) -> Doubles | None:
    """All numbers of a text, or None where it holds anything else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _numbers(lines: str, keyword: str) -> Numbers | None:
    # The keyword becomes a number of its own, which shows where lines begin.
    values = _floats(lines.replace(keyword, "nan"))
    count = lines.count("\n")
    if values is None or len(values) % count:
        return None
    rows = values.reshape(count, -1)
    if not np.isnan(rows[:, 0]).all() or np.isnan(rows[:, 1:]).any():
        return None
    rows = rows[:, 1:]
    wanted = 2 if keyword == "vt" else 3
    if rows.shape[1] < wanted:
        return None
    colors = rows[:, 3:7].copy() if keyword == "v" and rows.shape[1] >= 6 else None
    return Numbers(keyword, rows[:, :wanted].copy(), colors)


def _faces(lines: str) -> list[Block] | None:
    values = _floats(lines.replace("f", "nan").replace("/", " inf "))
    if values is None:
        return None
    starts = np.flatnonzero(np.isnan(values))
    lengths = np.diff(np.append(starts, len(values)))
    changes = np.flatnonzero(np.diff(lengths)) + 1
    if len(starts) != lines.count("\n") or len(changes) * _LEAST_LINES > len(starts):
        return None
    edges = [0, *changes.tolist(), len(starts)]
    ends = np.append(starts, len(values))
    found = []
    for first, last in pairwise(edges):
        rows = values[ends[first] : ends[last]].reshape(last - first, -1)[:, 1:]
        faces = _alike(rows)
        if faces is None:
            return None
        found.append(faces)
    # The text counts once: with the last.
    return [*(Block("", faces) for faces in found[:-1]), Block(lines, found[-1])]


def _alike(rows: Doubles) -> Faces | None:
    """Faces of which every line is a row of numbers, infinity in the place of each slash."""
    slashes = np.isinf(rows)
    if (slashes != slashes[0]).any() or np.abs(rows[~slashes]).max() >= 2**31:
        return None
    columns = _columns(slashes[0].tolist())
    if columns is None or len(columns) < 3:
        return None
    kinds = {tuple(at >= 0 for at in corner) for corner in columns}
    if len(kinds) > 1:
        return None
    corners = np.zeros((len(rows), len(columns), 3), np.int64)
    for corner, places in enumerate(columns):
        for kind, at in enumerate(places):
            if at >= 0:
                corners[:, corner, kind] = rows[:, at]
    (_, has_uv, has_normal) = next(iter(kinds))
    return Faces(corners, (has_uv, has_normal))


def _columns(slashes: list[bool]) -> list[list[int]] | None:
    """For each corner the columns of its three indices, -1 for none."""
    corners: list[list[int]] = []
    kind = -1  # of the index that may come: 0 to 2; -1 where only a new corner may
    for at, slash in enumerate(slashes):
        if slash:
            if kind < 0 or kind == 2:
                return None
            kind += 1
        elif kind > 0 and corners[-1][kind] < 0:
            corners[-1][kind] = at
        else:
            corners.append([at, -1, -1])
            kind = 0
    return corners
