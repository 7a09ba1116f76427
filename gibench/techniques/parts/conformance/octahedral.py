"""Octahedral maps in float64 NumPy (Cigolle et al. 2014): encoded, bordered and looked up."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Array
from gibench.techniques.parts.conformance.shading import bilinear


def encode(d: Array) -> Array:
    """Directions (..., 3) to [-1, 1]^2 (Cigolle et al. 2014)."""
    d = d / np.abs(d).sum(axis=-1, keepdims=True)
    x, y, z = np.moveaxis(d, -1, 0)
    sx, sy = np.where(x >= 0, 1, -1), np.where(y >= 0, 1, -1)
    fx, fy = (1 - np.abs(y)) * sx, (1 - np.abs(x)) * sy
    return np.stack([np.where(z >= 0, x, fx), np.where(z >= 0, y, fy)], axis=-1)


def decode(p: Array) -> Array:
    """Points of the square to directions (Cigolle et al. 2014)."""
    x, y = np.moveaxis(np.asarray(p, np.float64), -1, 0)
    z = 1 - np.abs(x) - np.abs(y)
    sx, sy = np.where(x >= 0, 1, -1), np.where(y >= 0, 1, -1)
    fx, fy = (1 - np.abs(y)) * sx, (1 - np.abs(x)) * sy
    d = np.stack([np.where(z >= 0, x, fx), np.where(z >= 0, y, fy), z], axis=-1)
    return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))


def texel_directions(side: int) -> Array:
    """(side * side, 3), row by row."""
    at = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(at, at)
    return decode(np.stack([x.ravel(), y.ravel()], axis=1))


def bordered(maps: Array) -> Array:
    """Maps (p, s + 2, s + 2, c) whose border repeats, for every texel just outside the square, the
    inner texel whose direction a point outside the square stands for: reflected at the edge, then
    mirrored about the edge's middle."""
    out = np.array(maps)
    side = maps.shape[1] - 2
    for row in range(side + 2):
        for column in range(side + 2):
            r, c = row - 1, column - 1  # without border
            if 0 <= r < side and 0 <= c < side:
                continue
            if not 0 <= r < side:
                r, c = min(max(r, 0), side - 1), side - 1 - c
            if not 0 <= c < side:
                r, c = side - 1 - r, min(max(c, 0), side - 1)
            out[:, row, column] = maps[:, r + 1, c + 1]
    return out


def lookup(map_: Array, directions: Array) -> Array:
    """Bilinear in one probe's bordered map (s + 2, s + 2, c)."""
    side = map_.shape[0] - 2
    at = (encode(directions) * 0.5 + 0.5) * side + 0.5
    return bilinear(map_, at[:, 0], at[:, 1], wrap=False)
