"""Tangents of triangles with a normal map, by MikkTSpace.

Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited", and the reference code of its tangent
space, mikktspace.c: what normal maps are made for. No package of it can be installed from PyPI for
Python 3.11, so it is written down here for triangles; ``tests/scene/test_normal_maps.py`` holds it
against what the reference code gives.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gibench.arrays import Array, Doubles

_TINY = float(np.finfo(np.float32).tiny)


def tangents(positions: Array, normals: Array, uvs: Array) -> Doubles:
    """Unit tangents and the bitangents' signs at the triangles' corners, (t, 3, 4).

    Corners share a tangent where position, normal and coordinates are the same and a fan of
    triangles that are mirrored alike in the image joins them; each triangle counts by its angle.
    Triangles without an area in the image take the tangent of a neighbour at the corner, or any.

    Args:
        positions: (t, 3, 3).
        normals: (t, 3, 3) unit.
        uvs: (t, 3, 2), v upwards.
    """
    p, n, uv = (np.asarray(a, np.float64) for a in (positions, normals, uvs))
    keys = np.concatenate((p, n, uv), axis=2).astype(np.float32).reshape(-1, 8) + np.float32(0)
    vertex = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1, 3)
    d1, d2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    s1, s2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = s1[:, 0] * s2[:, 1] - s1[:, 1] * s2[:, 0]
    along = s2[:, 1:] * d1 - s1[:, 1:] * d2
    across = s1[:, :1] * d2 - s2[:, :1] * d1
    turned = np.where(area > 0, 1.0, -1.0)
    lengths = np.linalg.norm(along, axis=1), np.linalg.norm(across, axis=1)
    good = (np.abs(area) > _TINY) & (lengths[0] > _TINY) & (lengths[1] > _TINY)
    along *= (turned / np.where(good, lengths[0], 1.0))[:, None]
    group = _groups(vertex, turned, good)
    # Of each corner: the triangle's direction in the plane of its normal, by its angle there.
    flat = _unit(along[:, None] - n * np.einsum("tx,tcx->tc", along, n)[..., None])
    before, after = np.roll(p, 1, axis=1) - p, np.roll(p, -1, axis=1) - p
    sides = [
        _unit(side - n * np.einsum("tcx,tcx->tc", side, n)[..., None]) for side in (before, after)
    ]
    angle = np.arccos(np.clip(np.einsum("tcx,tcx->tc", *sides), -1, 1))
    sums = np.zeros((int(group.max(initial=0)) + 1, 3))
    weighted = flat * np.where(good[:, None], angle, 0.0)[..., None]
    np.add.at(sums, group.reshape(-1), weighted.reshape(-1, 3))
    result = np.empty((len(p), 3, 4))
    result[..., :3] = _unit(sums)[group]
    result[..., 3] = turned[:, None]
    _borrowed(result, vertex, good)
    lost = np.linalg.norm(result[..., :3], axis=2) < 0.5
    result[lost, :3] = _any_beside(n[lost])
    return result


def _groups(vertex: Array, turned: Array, good: Array) -> Array:
    """The corners' groups (t, 3): joined across edges that two triangles share."""
    corner = np.arange(vertex.size).reshape(-1, 3)
    start, end = vertex.reshape(-1), np.roll(vertex, -1, axis=1).reshape(-1)
    at_start, at_end = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    usable = np.repeat(good, 3)
    sign = np.repeat(turned > 0, 3).astype(np.int64)
    count = int(vertex.max(initial=0)) + 1
    key = (sign * count + start) * count + end
    back = (sign * count + end) * count + start
    order = np.argsort(np.where(usable, key, -1), kind="stable")
    ordered = np.where(usable, key, -1)[order]
    place = np.searchsorted(ordered, back).clip(max=len(ordered) - 1)
    paired = usable & (ordered[place] == back)
    mine, other = np.flatnonzero(paired), order[place[paired]]
    rows = np.concatenate((at_start[mine], at_end[mine]))
    columns = np.concatenate((at_end[other], at_start[other]))
    links = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(vertex.size,) * 2)
    found: Array = connected_components(links, directed=False)[1]
    return found.reshape(-1, 3)


def _borrowed(result: Doubles, vertex: Array, good: Array) -> None:
    """Give the corners of other triangles the tangent of a good one at the same vertex."""
    if good.all():
        return
    known, first = np.unique(vertex[good].reshape(-1), return_index=True)
    of_good = result[good].reshape(-1, 4)[first]
    wanted = vertex[~good]
    place = np.searchsorted(known, wanted).clip(max=max(len(known) - 1, 0))
    mine = result[~good]
    mine[..., :3] = 0.0
    if len(known):
        found = known[place] == wanted
        mine[found] = of_good[place[found]]
    result[~good] = mine


def _any_beside(normals: Array) -> Array:
    """Unit vectors perpendicular to unit ``normals`` (m, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return _unit(axis - normals * np.einsum("mx,mx->m", axis, normals)[:, None])


def _unit(vectors: Array) -> Doubles:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > _TINY, length, 1.0))
