"""Charts of large meshes: surface seen along one of the six directions of the axes.

xatlas grows charts triangle by triangle and takes minutes for a million of them. Here every
triangle is projected along the axis that its normal is nearest to, and neighbours that go along the
same axis form a chart (box projection, cut into connected pieces). What a chart loses against an
unfolded one is evenness: surface at 55 degrees to the axis has texels of 1.7 times the area.

A chart may come to lie over itself, as a spiral staircase does seen from above; such charts are cut
by depth until no texel holds surface far apart.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gibench.arrays import (
    Doubles,
    Floats,
    Ints,
    Longs,
    least_of_corners,
    most_of_corners,
    unique_rows,
)
from gibench.scene.lightmap.raster import covered_texels

# Axes +x, -x, +y, -y, +z, -z: the two that span the plane seen, so that fronts stay fronts.
_ACROSS = np.array([(1, 2), (2, 1), (2, 0), (0, 2), (0, 1), (1, 0)])
# Neighbours may draw a triangle to their axis where its normal is at most so far from it (70
# degrees): noisy surface would fall into charts of a few triangles otherwise.
_LEAST_COSINE = 0.34
_ROUNDS = 6
# Charts of fewer texels than this join a neighbour where the angle allows it.
_SMALL_TEXELS = 16.0
# Depths in one texel that differ by more texels than this are surface over surface: at 70 degrees a
# plane's differ by 3.9 from corner to corner.
_DEEP = 6.0
_HALVINGS = 12


def projected_charts(
    positions: Floats, triangles: Ints, texel: float
) -> tuple[Doubles, Longs, int]:
    """Project triangles into charts.

    Args:
        positions: (v, 3) m.
        triangles: (t, 3), none degenerate.
        texel: side of a texel of the lightmap, m.

    Returns:
        Corners (t, 3, 2) in metres, each chart with an origin of its own; the chart of every
        triangle, (t,); the number of charts.
    """
    corners = positions[triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal /= length[:, None]
    # (t, 6) cosines to the axes +x, -x, +y, ...
    cosine = np.stack((normal, -normal), axis=2).reshape(-1, 6)
    pairs = _neighbours(positions, triangles)
    axis = _voted(cosine.argmax(axis=1), cosine, pairs)
    axis = _without_small(axis, cosine, pairs, length / 2, _SMALL_TEXELS * texel**2)
    chart, count = _connected(axis, pairs, len(triangles))
    rows = np.arange(len(triangles))[:, None, None]
    places = np.arange(3)[None, :, None]
    uvs = corners[rows, places, _ACROSS[axis][:, None, :]]
    depth = corners[rows[:, :, 0], places[:, :, 0], (axis // 2)[:, None]]
    chart, count = _cut_by_depth(uvs / texel, depth / texel, chart, count, pairs)
    return uvs, chart, count


def _neighbours(positions: Floats, triangles: Ints) -> Longs:
    """Pairs (k, 2) of triangles that share an edge, by position."""
    place = unique_rows((positions + np.float32(0)).view(np.int32))[1]
    corner = place[triangles]
    ends = np.concatenate((corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]))
    key = (ends.min(axis=1) << 32) + ends.max(axis=1)
    order = np.argsort(key)
    ordered = key[order]
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    owner = order % len(triangles)
    return np.stack((owner[same], owner[same + 1]), axis=1)


def _votes(axis: Longs, pairs: Longs, weight: Doubles | None = None) -> Doubles:
    """(t, 6) how many neighbours of each triangle go along each axis."""
    one, other = pairs.T
    keys = np.concatenate((one * 6 + axis[other], other * 6 + axis[one]))
    weights = None if weight is None else np.concatenate((weight[other], weight[one]))
    found = np.bincount(keys, weights, minlength=6 * len(axis)).astype(np.float64)
    return found.reshape(-1, 6)


def _voted(axis: Longs, cosine: Doubles, pairs: Longs) -> Longs:
    """Every triangle's axis after its neighbours' votes; its own and the angle settle a tie."""
    allowed = cosine > _LEAST_COSINE
    rows = np.arange(len(axis))
    for _ in range(_ROUNDS):
        votes = _votes(axis, pairs) + 0.5 * cosine
        votes[rows, axis] += 1.0
        votes[~allowed] = -1.0
        new = votes.argmax(axis=1)
        if (new == axis).all():
            break
        axis = new
    return axis


def _connected(label: Longs, pairs: Longs, triangles: int) -> tuple[Longs, int]:
    """Number of the connected piece of neighbours of one label that each triangle is in."""
    own = pairs[label[pairs[:, 0]] == label[pairs[:, 1]]]
    graph = coo_array(
        (np.ones(len(own), np.int8), (own[:, 0], own[:, 1])), shape=(triangles, triangles)
    )
    count, piece = connected_components(graph, directed=False)
    return piece.astype(np.int64), int(count)


def _without_small(
    axis: Longs, cosine: Doubles, pairs: Longs, area: Doubles, least: float
) -> Longs:
    """The axes with pieces below ``least`` m2 drawn to those around them, from their rims."""
    allowed = cosine > _LEAST_COSINE
    for _ in range(_ROUNDS):
        piece, count = _connected(axis, pairs, len(axis))
        size = np.bincount(piece, area, count)[piece]
        small = size < least
        if not small.any():
            break
        votes = _votes(axis, pairs, (~small).astype(np.float64))
        votes[~allowed] = 0.0
        new = np.where(small & (votes.max(axis=1) > 0), votes.argmax(axis=1), axis)
        if (new == axis).all():
            break
        axis = new
    return axis


def _cut_by_depth(
    uvs: Doubles, depth: Doubles, chart: Longs, count: int, pairs: Longs
) -> tuple[Longs, int]:
    """The charts without any that lies over itself.

    Args:
        uvs: (t, 3, 2) corners, texels.
        depth: (t, 3) of the corners along the chart's axis, texels.
        chart: (t,) of every triangle.
        count: number of charts.
        pairs: (k, 2) neighbours.
    """
    middle = depth.mean(axis=1)
    own = np.arange(len(chart))  # triangles that may lie over others
    for halving in range(1, _HALVINGS + 1):
        over = _over(uvs[own], depth[own], chart[own], count)
        if not len(over):
            break
        folded = np.zeros(count, np.bool_)
        folded[chart[own[over]]] = True
        own = own[folded[chart[own]]]
        low = np.full(count, np.inf)
        np.minimum.at(low, chart[own], middle[own])
        high = np.full(count, -np.inf)
        np.maximum.at(high, chart[own], middle[own])
        if halving == _HALVINGS:
            slab = np.arange(len(own))  # each for itself
        else:
            span = np.maximum(high - low, 1e-9)[chart[own]]
            slab = np.minimum(((middle[own] - low[chart[own]]) / span * 2).astype(np.int64), 1)
        label = chart.copy()
        label[own] = count + chart[own] * (int(slab.max(initial=0)) + 1) + slab
        chart, count = _connected(label, pairs, len(chart))
    return chart, count


def _over(uvs: Doubles, depth: Doubles, chart: Longs, count: int) -> Longs:
    """Triangles in texels of their chart where depths differ by more than ``_DEEP``."""
    low = np.full((count, 2), np.inf)
    for axis in (0, 1):
        np.minimum.at(low[:, axis], chart, least_of_corners(uvs[:, :, axis]))
    local = uvs - np.floor(low)[chart][:, None]
    high = int(np.ceil(local.max(initial=1.0))) + 1
    # Depth is linear over the triangle: d = d0 + g . (p - p0), kept to what its corners span.
    e, f = local[:, 1] - local[:, 0], local[:, 2] - local[:, 0]
    determinant = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    determinant = np.where(determinant == 0, 1.0, determinant)
    de, df = depth[:, 1] - depth[:, 0], depth[:, 2] - depth[:, 0]
    gx = (de * f[:, 1] - df * e[:, 1]) / determinant
    gy = (df * e[:, 0] - de * f[:, 0]) / determinant
    least, most = least_of_corners(depth), most_of_corners(depth)
    owners, keys, depths = [], [], []
    for triangle, x, y in covered_texels(local):
        at = depth[triangle, 0] + gx[triangle] * (x + 0.5 - local[triangle, 0, 0])
        at += gy[triangle] * (y + 0.5 - local[triangle, 0, 1])
        owners.append(triangle.astype(np.int32))
        keys.append((chart[triangle] * high + y) * high + x)
        depths.append(np.clip(at, least[triangle], most[triangle]).astype(np.float32))
    if not owners:
        return np.zeros(0, np.int64)
    owner, key, found = np.concatenate(owners), np.concatenate(keys), np.concatenate(depths)
    order = np.argsort(key)
    key, found = key[order], found[order]
    starts = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1])))
    spread = np.maximum.reduceat(found, starts) - np.minimum.reduceat(found, starts)
    deep = np.repeat(spread > _DEEP, np.diff(np.append(starts, len(key))))
    return np.unique(owner[order[deep]]).astype(np.int64)
