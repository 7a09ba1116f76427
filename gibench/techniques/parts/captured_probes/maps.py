"""Octahedral maps on the host: texels' directions, how large they are, bilinear lookups."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Longs
from gibench.techniques.parts.octahedral_maps import octahedral_decode


def texel_directions(side: int) -> Doubles:
    """Unit directions (side^2, 3) at the texels' middles, row by row."""
    at = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(at, at)
    return octahedral_decode(np.stack([x.ravel(), y.ravel()], axis=1))


def texel_solid_angles(side: int) -> Doubles:
    """Solid angles (side^2,) of the texels, sr; 4 pi together.

    On a face of the octahedron |x| + |y| + |z| = 1, whose distance from the origin is 1 / sqrt(3)
    and which is sqrt(3) times as large as its shadow in the square: dx dy / r^3. Summed over
    8 x 8 parts of a texel, as the density has a crease where the octahedron has an edge.
    """
    parts = 8
    d = texel_directions(parts * side)
    density = (np.abs(d).sum(axis=1) ** 3).reshape(side, parts, side, parts)
    angles = density.sum(axis=(1, 3)).ravel()
    return np.asarray(angles * (4 * np.pi / angles.sum()))


def border_sources(side: int) -> Longs:
    """For every texel of a bordered map, (side + 2)^2, the inner texel (row * side + column) that
    it holds: beyond an edge the map goes on mirrored about the edge's middle (Cigolle et al. 2014).
    """
    row, column = (a.ravel() - 1 for a in np.indices((side + 2, side + 2)))
    outside_row, outside_column = ((a < 0) | (a >= side) for a in (row, column))
    r = np.where(outside_column, side - 1 - row, row)
    c = np.where(outside_row, side - 1 - column, column)
    return np.asarray(np.clip(r, 0, side - 1) * side + np.clip(c, 0, side - 1), np.int64)


def wrapped_texels(side: int, radius: int) -> Longs:
    """The texels (side^2, (2 radius + 1)^2) around every texel, row by row, the map going on beyond
    its edges as :func:`border_sources` has it.
    """
    row, column = (a.ravel()[:, None] for a in np.indices((side, side)))
    step = np.arange(-radius, radius + 1)
    down, right = (a.ravel() for a in np.meshgrid(step, step, indexing="ij"))
    r, c = row + down, column + right
    over_r, over_c = ((a < 0) | (a >= side) for a in (r, c))
    # Beyond an edge as far again inside it, on the other side of the edge's middle.
    r1, c1 = (np.where(a < 0, -1 - a, np.where(a >= side, 2 * side - 1 - a, a)) for a in (r, c))
    r, c = np.where(over_c, side - 1 - r1, r1), np.where(over_r, side - 1 - c1, c1)
    return np.asarray(np.clip(r, 0, side - 1) * side + np.clip(c, 0, side - 1), np.int64)


def bordered(maps: npt.NDArray[Any], side: int) -> npt.NDArray[Any]:
    """Maps (p, side^2, c) with their borders, (p, side + 2, side + 2, c)."""
    return maps[:, border_sources(side)].reshape(len(maps), side + 2, side + 2, -1)


def bilinear(directions: Doubles, side: int) -> tuple[Longs, Doubles]:
    """The four inner texels (n, 4) of a map that a direction (n, 3) lies between, and their shares
    (n, 4).
    """
    d = directions / np.abs(directions).sum(axis=1, keepdims=True)
    sign = np.where(d[:, :2] >= 0, 1.0, -1.0)
    square = np.where(d[:, 2:] >= 0, d[:, :2], (1 - np.abs(d[:, 1::-1])) * sign)
    at = (square * 0.5 + 0.5) * side + 0.5
    corner = np.clip(np.floor(at), 0, side).astype(np.int64)
    x, y = (at - corner).T
    first = corner[:, 1] * (side + 2) + corner[:, 0]
    places = first[:, None] + np.array([0, 1, side + 2, side + 3])
    shares = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)
    return border_sources(side)[places], shares


def texel_table(side: int) -> Floats:
    """Direction and solid angle of the texels as kernels_cl/parts/captured_filter.cl reads them:
    planes x, y, z and solid angle, (4, :func:`stride`) float32, filled up with zeros.
    """
    table = np.zeros((4, stride(side)), np.float32)
    table[:3, : side**2] = texel_directions(side).T
    table[3, : side**2] = texel_solid_angles(side)
    return table


def stride(side: int) -> int:
    """Texels of a plane: whole vectors of 16."""
    return -(-(side**2) // 16) * 16
