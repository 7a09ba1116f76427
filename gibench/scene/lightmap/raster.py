"""Conservative rasterisation: which texels a triangle covers, and with which part of it.

A texel (x, y) is the square [x, x + 1] x [y, y + 1]. A texel is covered when the triangle overlaps
its inside, however little (Hasselgren et al. 2005, GPU Gems 2, chapter 42, is the idea; here the
overlap is then clipped exactly, after Sutherland and Hodgman 1974). All work is vectorised and done
in batches, so memory stays bounded whatever the size of the triangles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Longs, least_of_corners, most_of_corners

# Candidates (triangle, texel) handled at once: about 60 MB of polygons.
BATCH = 1 << 17
# Overlaps smaller than this share of a texel, or of the triangle when it is smaller than a texel,
# are float32 rounding of the coordinates rather than surface.
SMALLEST_OVERLAP = 1e-6


@dataclass(frozen=True)
class Pieces:
    """What texels cover of triangles: small triangles.

    Attributes:
        triangle: (m,) int64 triangle each piece is part of.
        x: (m,) int64 texel column.
        y: (m,) int64 texel row.
        barycentric: (m, 3, 3) float64: per corner, its weights of the triangle's three corners.
    """

    triangle: Longs
    x: Longs
    y: Longs
    barycentric: Doubles


def doubled_areas(uvs: Doubles) -> Doubles:
    """Twice the signed area of triangles ``uvs`` (t, 3, 2), shape (t,)."""
    e, f = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    return np.asarray(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])


def covered_texels(uvs: Doubles, batch: int = BATCH) -> Iterator[tuple[Longs, Longs, Longs]]:
    """Pairs of triangle and texel that overlap.

    Args:
        uvs: (t, 3, 2) corners in texels; triangles with NaN or without area cover nothing.
        batch: candidates looked at together.

    Yields:
        Triangle index, texel column, texel row; each (k,) int64, ordered by triangle, row, column.
    """
    area = doubled_areas(uvs)
    usable = np.flatnonzero(np.isfinite(area) & (area != 0))
    corners = uvs[usable]
    low = np.floor(least_of_corners(corners)).astype(np.int64)
    high = np.maximum(np.ceil(most_of_corners(corners)).astype(np.int64) - 1, low)
    size = high - low + 1
    ends = np.cumsum(size[:, 0] * size[:, 1])
    total = int(ends[-1]) if len(ends) else 0
    for first in range(0, total, batch):
        number = np.arange(first, min(first + batch, total))
        local = np.searchsorted(ends, number, side="right")
        inside = number - (ends[local] - size[local, 0] * size[local, 1])
        x = low[local, 0] + inside % size[local, 0]
        y = low[local, 1] + inside // size[local, 0]
        chosen = usable[local]
        keep = _edges_reach(uvs[chosen], np.sign(area[chosen]), x, y)
        yield chosen[keep], x[keep], y[keep]


def _edges_reach(uvs: Doubles, winding: Doubles, x: Longs, y: Longs) -> npt.NDArray[np.bool_]:
    """Whether texel (x, y) reaches to the inner side of all three edges (separating axes)."""
    reach = np.ones(len(x), np.bool_)
    for i in range(3):
        a, b = uvs[:, i], uvs[:, (i + 1) % 3]
        nx, ny = -(b[:, 1] - a[:, 1]) * winding, (b[:, 0] - a[:, 0]) * winding
        # The texel's corner that lies furthest inwards.
        dx, dy = x + (nx > 0) - a[:, 0], y + (ny > 0) - a[:, 1]
        reach &= nx * dx + ny * dy > 0
    return reach


def clip(uvs: Doubles, batch: int = BATCH) -> Iterator[Pieces]:
    """Cut triangles by the texel grid.

    Overlaps below ``SMALLEST_OVERLAP`` of a texel (of the triangle, when that is smaller) are
    dropped, so the pieces' areas add up to the triangle's to about 1e-6.

    Args:
        uvs: (t, 3, 2) corners in texels; triangles with NaN or without area are left out.
        batch: candidates looked at together.
    """
    for triangle, x, y in covered_texels(uvs, batch):
        # Polygon corners as (u, v, b1, b2), relative to the texel.
        polygon = np.zeros((len(triangle), 7, 4))
        polygon[:, :3, 0] = uvs[triangle, :, 0] - x[:, None]
        polygon[:, :3, 1] = uvs[triangle, :, 1] - y[:, None]
        polygon[:, 1, 2] = polygon[:, 2, 3] = 1.0
        count = np.full(len(triangle), 3)
        for axis in (0, 1):
            polygon, count = _cut(polygon, count, polygon[:, :, axis])
            polygon, count = _cut(polygon, count, 1.0 - polygon[:, :, axis])
        limit = SMALLEST_OVERLAP * np.minimum(1.0, np.abs(doubled_areas(uvs[triangle])) / 2)
        keep = _polygon_areas(polygon, count) >= limit
        yield _fan(triangle[keep], x[keep], y[keep], polygon[keep], count[keep])


def _cut(polygon: Doubles, count: Longs, distance: Doubles) -> tuple[Doubles, Longs]:
    """The part of convex polygons (n, 7, 4) where the signed ``distance`` (n, 7) is not negative.

    One step of Sutherland and Hodgman (1974): each edge gives its start when that is inside, then
    its crossing point when its ends lie on different sides.
    """
    n = len(polygon)
    out = np.zeros_like(polygon)
    filled = np.zeros(n, np.int64)
    # Only polygons that cross the line need work.
    valid = np.arange(7)[None, :] < count[:, None]
    outside = (distance < 0) & valid
    crossing = np.flatnonzero(outside.any(axis=1))
    whole = np.ones(n, np.bool_)
    whole[crossing] = False
    out[whole] = polygon[whole]
    filled[whole] = count[whole]
    p, d, k = polygon[crossing], distance[crossing], count[crossing]
    q, f = out[crossing], np.zeros(len(crossing), np.int64)
    rows = np.arange(len(crossing))
    for i in range(7):
        there = i < k
        if not there.any():
            break
        j = np.where(i + 1 < k, i + 1, 0)
        start, end = d[:, i], d[rows, j]
        inside = there & (start >= 0)
        at = np.flatnonzero(inside)
        q[at, f[at]] = p[at, i]
        f[at] += 1
        at = np.flatnonzero(there & ((start >= 0) != (end >= 0)))
        t = start[at] / (start[at] - end[at])
        q[at, f[at]] = p[at, i] + (p[at, j[at]] - p[at, i]) * t[:, None]
        f[at] += 1
    out[crossing], filled[crossing] = q, f
    return out, filled


def _polygon_areas(polygon: Doubles, count: Longs) -> Doubles:
    area = np.zeros(len(polygon))
    for i in range(1, 6):
        twice = doubled_areas(polygon[:, [0, i, i + 1], :2])
        area += np.where(i + 1 < count, twice, 0.0)
    return np.abs(area) / 2


def _fan(triangle: Longs, x: Longs, y: Longs, polygon: Doubles, count: Longs) -> Pieces:
    b = np.concatenate([1 - polygon[..., 2:3] - polygon[..., 3:4], polygon[..., 2:4]], axis=-1)
    owner, first = [], []
    for i in range(1, 6):
        chosen = np.flatnonzero(i + 1 < count)
        owner.append(chosen)
        first.append(np.full(len(chosen), i))
    order = np.argsort(np.concatenate(owner), kind="stable")
    own, corner = np.concatenate(owner)[order], np.concatenate(first)[order]
    corners = np.stack([b[own, 0], b[own, corner], b[own, corner + 1]], axis=1)
    return Pieces(triangle[own], x[own], y[own], corners)
