"""Motions in TOML: ``[[motion]]`` tables."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Vec3
from gibench.errors import BadInput
from gibench.scene.colours import Change, Colours
from gibench.scene.files import read_bytes
from gibench.scene.poses import IDENTITY, Keyframes, Matrix3, Turn, turn_about
from gibench.scene.toml_table import Table

_TURN_KEYS = ("object", "through", "axis", "period_frames", "swing_degrees")
_KEYFRAME_KEYS = (
    "object", "material", "through", "frames", "positions", "rotate_degrees", "matrices", "albedo",
    "emission", "step", "repeat",
)  # fmt: skip
_POSES = ("matrices", "positions", "rotate_degrees")
_COLOURS = ("albedo", "emission")


def read_motions(entries: Any, where: object) -> tuple[Change, ...]:
    """The motions of a list of ``[[motion]]`` tables.

    Each names an ``object`` and has either ``axis`` (and ``period_frames``, ``swing_degrees``) or
    ``frames`` with one of ``positions`` (m) and ``rotate_degrees`` (about x, then y, then z) or
    both, or with ``matrices`` (4 x 4, row-major); see :mod:`gibench.scene.poses`. With ``frames``
    it may have ``albedo`` and ``emission`` besides, or only these, of an ``object`` or of a
    ``material``; see :mod:`gibench.scene.colours`.

    Raises:
        BadInput: an unknown key, a wrong value, or no rigid motion.
    """
    if not isinstance(entries, list):
        raise BadInput("'motion' is not a list of tables", where=where, mend="write [[motion]]")
    motions: list[Change] = []
    for number, entry in enumerate(entries, 1):
        try:
            motions += _changes(entry, f"[[motion]] {number}", where)
        except BadInput as error:
            if error.where is not None:
                raise
            raise BadInput(error.what, where=where, mend=error.mend) from error
    return tuple(motions)


def _changes(entry: Any, label: str, where: object) -> list[Change]:
    if not isinstance(entry, dict):
        raise BadInput(f"{label} is not a table", where=where)
    if ("axis" in entry) == ("frames" in entry):
        raise BadInput(f"{label} has no motion", where=where, mend="give either axis or frames")
    table = Table(entry, label, where, _TURN_KEYS if "axis" in entry else _KEYFRAME_KEYS)
    if "material" in table:
        if clash := [key for key in ("object", "through", *_POSES) if key in table]:
            table.fail(clash[0], "a material has albedo and emission alone; name an object instead")
        return [_colours(table, table.text("material"))]
    name = table.text("object")
    through = table.vector("through") if "through" in table else None
    if "axis" in table:
        period = table.whole("period_frames", 240, low=1)
        swing = table.number("swing_degrees", 0.0, low=0, high=360)
        return [Turn(name, table.vector("axis"), through, period, swing)]
    coloured = any(key in table for key in _COLOURS)
    found: list[Change] = [_colours(table, name)] if coloured else []
    if not coloured or any(key in table for key in _POSES):
        found.insert(0, _keyframes(table, name, through))
    return found


def _frames(table: Table) -> tuple[int, ...]:
    frames = _list(table, "frames")
    if not all(isinstance(n, int) and not isinstance(n, bool) for n in frames):
        table.fail("frames", "give a list of whole numbers")
    return tuple(frames)


def _colours(table: Table, name: str) -> Colours:
    if not any(key in table for key in _COLOURS):
        table.fail("albedo", "give albedo or emission, one per frame")
    return Colours(
        name,
        _frames(table),
        _greys_or_colours(table, "albedo") if "albedo" in table else (),
        _greys_or_colours(table, "emission") if "emission" in table else (),
        of_material="material" in table,
        step=table.flag("step"),
        repeat=table.flag("repeat"),
    )


def _greys_or_colours(table: Table, key: str) -> tuple[Vec3, ...]:
    entries = _list(table, key)
    greys = [[entry] * 3 if isinstance(entry, int | float) else entry for entry in entries]
    return tuple(
        Table({key: entry}, f"{table.label}, keyframe {n}", table.where, (key,)).vector(key)
        for n, entry in enumerate(greys, 1)
    )


def _keyframes(table: Table, name: str, through: Vec3 | None) -> Keyframes:
    frames = _frames(table)
    if "matrices" in table:
        if clash := [key for key in ("positions", "rotate_degrees", "through") if key in table]:
            table.fail("matrices", f"give either matrices or {clash[0]}")
        rotations, positions = _matrices(table)
        through = 0.0, 0.0, 0.0
        return Keyframes(name, frames, positions, rotations, through, table.flag("repeat"))
    if "positions" not in table and "rotate_degrees" not in table:
        table.fail(
            "positions",
            "give positions, rotate_degrees or matrices, or albedo or emission, one per frame",
        )
    positions, rotations = ((0.0, 0.0, 0.0),) * len(frames), (IDENTITY,) * len(frames)
    if "positions" in table:
        positions = _vectors(table, "positions")
    if "rotate_degrees" in table:
        rotations = tuple(_turned(degrees) for degrees in _vectors(table, "rotate_degrees"))
    return Keyframes(name, frames, positions, rotations, through, table.flag("repeat"))


def _list(table: Table, key: str) -> list[Any]:
    value = table.entries.get(key)
    if not isinstance(value, list):
        table.fail(key, "give a list with one entry per keyframe")
    return value


def _vectors(table: Table, key: str) -> tuple[Vec3, ...]:
    return tuple(
        Table({key: entry}, f"{table.label}, keyframe {n}", table.where, (key,)).vector(key)
        for n, entry in enumerate(_list(table, key), 1)
    )


def _matrices(table: Table) -> tuple[tuple[Matrix3, ...], tuple[Vec3, ...]]:
    rotations, positions = [], []
    for n, entry in enumerate(_list(table, "matrices"), 1):
        matrix = Table(
            {"matrices": entry}, f"{table.label}, keyframe {n}", table.where, ("matrices",)
        ).matrix("matrices")
        rotations.append(_matrix3(matrix[:3, :3]))
        x, y, z = matrix[:3, 3].tolist()
        positions.append((x, y, z))
    return tuple(rotations), tuple(positions)


def _matrix3(matrix: Any) -> Matrix3:
    a, b, c = (tuple(row) for row in matrix.tolist())
    return a, b, c


def _turned(degrees: Vec3) -> Matrix3:
    linear = np.eye(3)
    for axis, angle in enumerate(degrees):
        linear = turn_about(axis, angle) @ linear
    return _matrix3(linear)


def load_motions(path: Path) -> tuple[Change, ...]:
    """The motions in a TOML file of ``[[motion]]`` tables.

    Raises:
        BadInput: the file cannot be read, or holds no sound motion.
    """
    try:
        entries = tomllib.loads(read_bytes(path).decode("utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadInput(f"no motion can be read from it ({error})", where=path) from error
    table = Table(entries, "the motion file", path, ("motion",))
    if not table.entries.get("motion"):
        raise BadInput("it holds no [[motion]]", where=path, mend="name an object and its motion")
    return read_motions(table.entries["motion"], path)


def motions_hash(motions: Sequence[Change]) -> str | None:
    """SHA-256 of all there is in ``motions``; None where there are none."""
    return hashlib.sha256(repr(tuple(motions)).encode()).hexdigest() if motions else None
