"""Charts: the scene's surface flattened into pieces, and their packing into one atlas."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace

import numpy as np
import xatlas
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gibench.arrays import Doubles, Floats, Longs, least_of_corners, most_of_corners
from gibench.scene.lightmap.projected import projected_charts
from gibench.scene.lightmap.raster import (
    covered_texels,
    doubled_areas,
)
from gibench.scene.model import MOST_UNFOLDED, Scene

_LOG = logging.getLogger(__name__)

# Overlap that lightmap coordinates from a file may show before they are refused, as a share of the
# covered area: authored charts that share an edge overlap by rounding.
LARGEST_OVERLAP = 0.005
# Texels kept between a chart's outline and the outline of its texels, so that a coordinate rounded
# to float32 (6e-5 at 1000 texels) never falls off the chart.
MARGIN = 1 / 64


@dataclass(frozen=True)
class Charts:
    """The scene's surface, flattened.

    Attributes:
        uvs: (t, 3, 2) float64 corners of every triangle; NaN for one that has no place.
        chart: (t,) int64 chart of every triangle, -1 for one that has no place.
        count: number of charts.
        placed: the charts already lie side by side in [0, 1] (coordinates from the scene's file);
            otherwise every chart is in metres, with an origin of its own, and must be packed.
    """

    uvs: Doubles
    chart: Longs
    count: int
    placed: bool


_TINY = 0.125
"""Largest coordinate below which a scene is magnified for xatlas, m."""
_THREADS_SLEEP_S = 0.02
"""Far longer than a thread takes from its last task to its sleep."""


def flatten(scene: Scene, texel_area: float) -> Charts:
    """Flatten the scene: by the lightmap coordinates it brings, else by xatlas, above
    ``MOST_UNFOLDED`` triangles by projection along axes.

    A triangle that xatlas leaves out becomes a chart of its own unless it is smaller than a
    hundredth of ``texel_area`` (m2), in which case it has no place.
    """
    if scene.lightmap_uvs is not None:
        uvs = scene.lightmap_uvs[scene.triangles].astype(np.float64)
        fault = _fault(uvs)
        if fault is None:
            chart = np.where(np.isfinite(uvs).all(axis=(1, 2)), 0, -1)
            return Charts(uvs, chart, 1, placed=True)
        _LOG.warning("%s: its lightmap coordinates %s; unwrapped anew", scene.name, fault)
    if len(scene.triangles) > MOST_UNFOLDED:
        return _projected(scene, texel_area)
    return _unfold(scene, texel_area)


def _projected(scene: Scene, texel_area: float) -> Charts:
    """Charts by projection along axes, each then stretched to be isometric on average."""
    corners = scene.corners.astype(np.float64)
    uvs, chart, count = projected_charts(scene.positions, scene.triangles, texel_area**0.5)
    area = triangle_areas(corners)
    return Charts(_isometric(uvs, chart, count, corners, area), chart, count, placed=False)


def _fault(uvs: Doubles) -> str | None:
    """What makes lightmap coordinates (t, 3, 2) unusable, or None."""
    if not np.isfinite(uvs).all():
        return "hold NaN or infinite values"
    if uvs.min() < 0 or uvs.max() > 1:
        return "leave [0, 1]"
    if not np.any(doubled_areas(uvs)):
        return "cover no area"
    overlap = _overlap(uvs)
    return None if overlap <= LARGEST_OVERLAP else f"overlap on {overlap:.1%} of the covered area"


def _overlap(uvs: Doubles, samples: int = 1024) -> float:
    """Share of the covered unit square that several triangles cover (point samples on a grid)."""
    # Samples sit off the diagonal of the grid, where authored edges do not run.
    grid = uvs * samples
    hits = np.zeros(samples * samples, np.int32)
    for triangle, x, y in covered_texels(grid):
        point = np.stack([x + 0.4871, y + 0.5237], axis=1)
        inside = np.ones(len(triangle), np.bool_)
        sign = np.sign(doubled_areas(grid[triangle]))
        for i in range(3):
            pair = np.stack([point, grid[triangle, i], grid[triangle, (i + 1) % 3]], axis=1)
            inside &= doubled_areas(pair) * sign > 0
        keep = inside & (x < samples) & (y < samples)
        hits += np.bincount(y[keep] * samples + x[keep], minlength=hits.size).astype(np.int32)
    covered = int(np.count_nonzero(hits))
    return float(np.count_nonzero(hits > 1)) / covered if covered else 0.0


def _magnification(scene: Scene) -> float:
    """What a tiny scene's lengths are multiplied with for xatlas, whose least lengths are a part of
    a scene of millimetres: a power of two, 1 from ``_TINY`` on.
    """
    largest = float(np.abs(scene.positions).max(initial=0.0))
    if largest >= _TINY or largest == 0:
        return 1.0
    return float(2.0 ** -np.floor(np.log2(largest)))


def _unfold(scene: Scene, texel_area: float) -> Charts:
    """Charts by xatlas, each then stretched to be isometric on average."""
    corners = scene.corners.astype(np.float64)
    area = triangle_areas(corners)
    atlas = xatlas.Atlas()
    magnified = _magnification(scene)
    atlas.add_mesh(
        np.ascontiguousarray(scene.positions * np.float32(magnified), np.float32),
        np.ascontiguousarray(scene.triangles, np.uint32),
        np.ascontiguousarray(scene.normals, np.float32),
    )
    # Packing is done here (pack), so xatlas gets no more than it needs for precise coordinates.
    options = xatlas.PackOptions()
    options.texels_per_unit = float(np.sqrt(4.0 / texel_area)) / magnified
    options.resolution = 0
    options.bruteForce = False
    atlas.generate(xatlas.ChartOptions(), options)
    # An Atlas that goes wakes its threads without holding their lock (xatlas, ~TaskScheduler): one
    # that is just about to sleep misses that, and the process waits for ever. Let them sleep.
    time.sleep(_THREADS_SLEEP_S)
    # (xatlas names atlas_count 0 when it could place nothing.)
    vertex, index, unit_uvs = atlas[0]
    del vertex
    scale = np.array([max(atlas.width, 1), max(atlas.height, 1)], np.float64)
    uvs = unit_uvs.astype(np.float64)[index] * scale
    twice = np.abs(doubled_areas(uvs))
    # A texel of xatlas's own packing holds texel_area / 4; a triangle squeezed below 1e-4 of its
    # area carries no usable coordinates.
    placed = np.isfinite(twice) & (twice / 2 * (texel_area / 4) > 1e-4 * area) & (area > 0)
    chart = np.full(len(area), -1, np.int64)
    labels, count = _islands(np.asarray(index, np.int64)[placed], len(unit_uvs))
    chart[placed] = labels
    uvs[~placed] = np.nan
    uvs = _isometric(uvs, chart, count, corners, area)

    alone = np.flatnonzero(~placed & (area > 0.01 * texel_area))
    uvs[alone] = _isometry(corners[alone])
    chart[alone] = count + np.arange(len(alone))
    return Charts(uvs, chart, count + len(alone), placed=False)


def _islands(index: Longs, vertices: int) -> tuple[Longs, int]:
    """Label (k,) of each triangle of ``index`` (k, 3) by shared vertices, and number of labels."""
    if not len(index):
        return np.zeros(0, np.int64), 0
    rows = np.concatenate([index[:, 0], index[:, 1]])
    columns = np.concatenate([index[:, 1], index[:, 2]])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(vertices, vertices))
    of_vertex = connected_components(graph, directed=False)[1]
    used, labels = np.unique(of_vertex[index[:, 0]], return_inverse=True)
    return labels.astype(np.int64), len(used)


def triangle_areas(corners: Doubles) -> Doubles:
    """Areas (t,) of triangles (t, 3, 3)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(np.linalg.norm(cross, axis=1) / 2)


def _isometry(corners: Doubles) -> Doubles:
    """Triangles (t, 3, 3) laid flat with their lengths kept, longest edge along x: (t, 3, 2)."""
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    first = np.argmax(length, axis=1)
    rows = np.arange(len(corners))
    a, b, c = (corners[rows, (first + i) % 3] for i in range(3))
    base = np.linalg.norm(b - a, axis=1)
    along = np.einsum("ti,ti->t", c - a, b - a) / base
    height = 2 * triangle_areas(corners) / base
    flat = np.zeros((len(corners), 3, 2))
    flat[rows, (first + 1) % 3, 0] = base
    flat[rows, (first + 2) % 3] = np.stack([along, height], axis=1)
    return flat


def _isometric(uvs: Doubles, chart: Longs, count: int, corners: Doubles, area: Doubles) -> Doubles:
    """Charts stretched linearly so that their average metric is the surface's.

    xatlas stretches every chart along u and v to fill whole texels. The metric of uv -> surface,
    averaged over a chart by area, has a symmetric root; applied to the chart it undoes any such
    stretch, exactly for plane charts.
    """
    own = np.flatnonzero(chart >= 0)
    e = uvs[own, 1:] - uvs[own, :1]  # (k, 2, 2), rows are edges
    f = corners[own, 1:] - corners[own, :1]  # (k, 2, 3)
    jacobian = np.linalg.solve(e, f)  # (k, 2, 3): d position / d uv
    metric = np.einsum("kai,kbi->kab", jacobian, jacobian) * area[own, None, None]
    entries = [np.bincount(chart[own], metric[:, a, b], count) for a in (0, 1) for b in (0, 1)]
    total = np.bincount(chart[own], area[own], count)
    values, vectors = np.linalg.eigh(
        np.stack(entries, axis=1).reshape(-1, 2, 2) / total[:, None, None]
    )
    root = np.einsum("cai,ci,cbi->cab", vectors, np.sqrt(np.maximum(values, 0)), vectors)
    result = uvs.copy()
    result[own] = np.einsum("kia,kab->kib", uvs[own], root[chart[own]])
    # Keep areas true on average too (a chart that is not plane gains a little by the root).
    flat = np.bincount(chart[own], np.abs(doubled_areas(result[own])) / 2, count)
    true = np.bincount(chart[own], area[own], count)
    result[own] *= np.sqrt(true / np.maximum(flat, 1e-300))[chart[own], None, None]
    return result


@dataclass(frozen=True)
class Layout:
    """Charts at some resolution: every chart sits in its own box of whole texels.

    Attributes:
        uvs: (t, 3, 2) float64 corners in texels, relative to the chart's box.
        width: (c,) int64 box width in texels.
        height: (c,) int64 box height.
    """

    uvs: Doubles
    width: Longs
    height: Longs


def at_resolution(charts: Charts, texels_per_unit: float) -> Layout:
    """The charts scaled by ``texels_per_unit``, each centred in the least box of whole texels."""
    if charts.placed:
        # A whole number of texels stays one, so that authored edges on texel borders stay there.
        whole = max(round(texels_per_unit), 1)
        near = abs(texels_per_unit - whole) < 1e-6 * whole
        scale = float(whole) if near else texels_per_unit
        side = np.array([int(np.ceil(scale))])
        return Layout(np.asarray(charts.uvs * scale), side, side)
    own = np.flatnonzero(charts.chart >= 0)
    uvs = np.asarray(charts.uvs * texels_per_unit)
    label = charts.chart[own]
    low = np.full((charts.count, 2), np.inf)
    high = np.full((charts.count, 2), -np.inf)
    mine = uvs[own]
    least, most = least_of_corners(mine), most_of_corners(mine)
    for axis in (0, 1):
        np.minimum.at(low[:, axis], label, least[:, axis])
        np.maximum.at(high[:, axis], label, most[:, axis])
    size = np.ceil(high - low + 2 * MARGIN)
    shift = (size - (high - low)) / 2 - low
    uvs[own] += shift[label, None]
    sizes = size.astype(np.int64)
    return Layout(uvs, sizes[:, 0], sizes[:, 1])


def _masks(charts: Charts, layout: Layout) -> tuple[Longs, Longs]:
    """Start of every chart's box in one flat list of texels, and the covered ones, ascending."""
    start = np.concatenate([[0], np.cumsum(layout.width * layout.height)])
    covered = np.zeros(int(start[-1]), np.bool_)
    for triangle, x, y in covered_texels(layout.uvs):
        chart = charts.chart[triangle]
        covered[start[chart] + y * layout.width[chart] + x] = True
    return start, np.flatnonzero(covered)


def covered_count(charts: Charts, texels_per_unit: float) -> int:
    """Number of texels the charts cover; no packing changes it, as charts move by whole texels."""
    return len(_masks(charts, at_resolution(charts, texels_per_unit))[1])


def pack(charts: Charts, texels_per_unit: float, padding: int) -> tuple[Floats, int, int]:
    """Lay the charts side by side.

    Each chart keeps ``padding`` free texels on every side, so two charts are at least twice that
    apart. They are dropped one by one, tallest first, each where it comes to lie lowest; outlines,
    not boxes, touch (the packing of Lévy, Petitjean, Ray, Maillot 2002, section 4).

    Returns:
        Corners (t, 3, 2) in texels, NaN where a triangle has no place; width; height.
    """
    layout = at_resolution(charts, texels_per_unit)
    if charts.placed:
        side = int(layout.width[0])
        return layout.uvs.astype(np.float32), side, side
    layout = _lie_down(charts, layout)
    start, covered = _masks(charts, layout)
    of_chart = np.searchsorted(start, covered, side="right") - 1
    local = covered - start[of_chart]
    x, y = local % layout.width[of_chart], local // layout.width[of_chart]
    first = np.searchsorted(of_chart, np.arange(charts.count + 1))
    boxes = (layout.width + 2 * padding) * (layout.height + 2 * padding)
    wide = int(layout.width.max(initial=1)) + 2 * padding
    width = max(wide, int(np.ceil(np.sqrt(boxes.sum() / 0.9))))
    surface = np.zeros(width, np.int64)
    place = np.zeros((charts.count, 2), np.int64)
    for c in np.lexsort((-layout.width, -layout.height)):
        span = slice(first[c], first[c + 1])
        w = int(layout.width[c]) + 2 * padding
        bottom, top = _outline(x[span], y[span], w, padding)
        windows = np.lib.stride_tricks.sliding_window_view(surface, w)
        lowest = (windows - bottom).max(axis=1)
        left = int(np.argmin(lowest))
        base = int(lowest[left])
        place[c] = left + padding, base + padding
        surface[left : left + w] = np.maximum(surface[left : left + w], base + top)
    own = np.flatnonzero(charts.chart >= 0)
    uvs = layout.uvs.copy()
    uvs[own] += place[charts.chart[own], None]
    return uvs.astype(np.float32), width, int(surface.max(initial=1))


def _lie_down(charts: Charts, layout: Layout) -> Layout:
    """Charts turned by 90 degrees where that makes them wider than high."""
    turn = layout.height > layout.width
    uvs = layout.uvs.copy()
    own = np.flatnonzero((charts.chart >= 0) & turn[np.maximum(charts.chart, 0)])
    height = layout.height[charts.chart[own]][:, None]
    uvs[own] = np.stack([height - layout.uvs[own, :, 1], layout.uvs[own, :, 0]], axis=2)
    return replace(
        layout,
        uvs=uvs,
        width=np.where(turn, layout.height, layout.width),
        height=np.where(turn, layout.width, layout.height),
    )


def _outline(x: Longs, y: Longs, width: int, padding: int) -> tuple[Longs, Longs]:
    """Lowest and one past the highest row (width,) of the texels (x, y) grown by ``padding``."""
    low = np.full(width, np.iinfo(np.int64).max // 2)
    high = np.full(width, np.iinfo(np.int64).min // 2)
    np.minimum.at(low, x + padding, y)
    np.maximum.at(high, x + padding, y + 1 + 2 * padding)
    grown_low, grown_high = low.copy(), high.copy()
    for shift in range(1, padding + 1):
        grown_low[shift:] = np.minimum(grown_low[shift:], low[:-shift])
        grown_low[:-shift] = np.minimum(grown_low[:-shift], low[shift:])
        grown_high[shift:] = np.maximum(grown_high[shift:], high[:-shift])
        grown_high[:-shift] = np.maximum(grown_high[:-shift], high[shift:])
    # A column the chart skips leaves the atlas as it is.
    empty = grown_low > grown_high
    return np.where(empty, 0, grown_low), np.where(empty, 0, grown_high)
