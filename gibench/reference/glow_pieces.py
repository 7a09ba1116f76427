"""Triangles that emit by images, in the pieces that the path tracer chooses from.

A triangle is cut along the lines of a grid over its image, of a texel a cell where that makes few
enough pieces, and each piece is chosen by its area times the mean luminance in its cell: so light
comes from where the image is bright, and the density of samples at a point is known from its cell
alone. Triangles whose coordinates have no area (palettes), or repeat the image many times, are
sampled evenly, as their corners' bounds in the image are bright.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Longs
from gibench.reference.luminance import luminance
from gibench.scene.glow import Glow
from gibench.scene.lightmap.raster import clip, doubled_areas

# Cells that triangles may touch altogether. Probabilities are float32, of steps of 2^-24.
MOST_CELLS = 1 << 17
# A triangle that spans more repetitions of its image is sampled evenly.
MOST_PERIODS = 8.0
# A triangle of less area than this in its image, of a texel, has none.
_LEAST_AREA = 1e-4

ROW_WORDS = 13
"""Of a packed row: six coordinates; first pixel, width and height of its image; first word, width
and height of its cells; the density where it is even (a float), else 0."""


@dataclass(frozen=True)
class GlowPieces:
    """What is sampled of triangles that emit by images.

    Attributes:
        row: (e,) row of ``Glow`` each piece belongs to.
        corners: (e, 3, 2) its corners, as weights of the triangle's corners 1 and 2.
        power: (e,) area times luminance, m2 W/m2/sr.
        cells: for each image, (h, w) mean luminance in the cells of its grid.
        even: (k,) luminance by which a row is sampled evenly, 0 for one that is cut into cells.
    """

    row: Longs
    corners: Doubles = field(repr=False)
    power: Doubles = field(repr=False)
    cells: tuple[Doubles, ...] = field(repr=False)
    even: Doubles = field(repr=False)

    def packed(self, glow: Glow, triangles: int, total: float) -> npt.NDArray[np.uint32]:
        """What kernels_cl/reference/glow.cl reads: for each of ``triangles`` where its row begins;
        the rows of ROW_WORDS; the pixels of all images, which begin at a multiple of three words;
        the cells' densities, floats.

        Args:
            glow: what the pieces are of.
            triangles: of the scene.
            total: the power of all emitters.
        """
        count = len(glow.triangle)
        pad = -(triangles + ROW_WORDS * count) % 3
        pixels = [np.ascontiguousarray(image, np.float32).reshape(-1) for image in glow.images]
        densities = [(cells / total).astype(np.float32).reshape(-1) for cells in self.cells]
        at = triangles + ROW_WORDS * count + pad
        first = at + np.concatenate(([0], np.cumsum([len(one) for one in pixels])))
        cell = first[-1] + np.concatenate(([0], np.cumsum([len(one) for one in densities])))[:-1]
        table = np.zeros(triangles, np.uint32)
        table[glow.triangle] = triangles + ROW_WORDS * np.arange(count)
        rows = np.empty((count, ROW_WORDS), np.uint32)
        rows[:, :6] = np.ascontiguousarray(glow.uvs, np.float32).reshape(-1, 6).view(np.uint32)
        rows[:, 6] = (first[:-1] // 3)[glow.image]
        sizes = np.array([image.shape[:2] for image in glow.images]).reshape(-1, 2)
        rows[:, 7:9] = sizes[glow.image][:, ::-1]
        rows[:, 9] = cell[glow.image]
        grids = np.array([cells.shape for cells in self.cells]).reshape(-1, 2)
        rows[:, 10:12] = grids[glow.image][:, ::-1]
        rows[:, 12] = (self.even / total).astype(np.float32).view(np.uint32)
        floats = [one.view(np.uint32) for one in (*pixels, *densities)]
        return np.concatenate([table, rows.reshape(-1), np.zeros(pad, np.uint32), *floats])


def glow_pieces(glow: Glow, areas: Doubles, most: int = MOST_CELLS) -> GlowPieces:
    """Cut the triangles of ``glow``, of ``areas`` (k,) m2, into pieces of one cell each."""
    uvs = glow.uvs.astype(np.float64)
    sizes = np.array([image.shape[:2] for image in glow.images])[glow.image]
    extent = np.ptp(uvs, axis=1)
    area = np.abs(doubled_areas(uvs)) / 2 * sizes.prod(axis=1)
    is_even = (area < _LEAST_AREA) | (extent.max(axis=1) > MOST_PERIODS)
    bright = [_smoothed(luminance(image)) for image in glow.images]
    step = _step(extent[~is_even], sizes[~is_even], most)
    cells = tuple(_coarser(one, step) for one in bright)
    even = np.zeros(len(uvs))
    rows, corners, power = [], [], []
    for number, grid in enumerate(cells):
        mine = np.flatnonzero(is_even & (glow.image == number))
        even[mine] = _in_bounds(bright[number], uvs[mine])
        mine = mine[even[mine] > 0]
        rows.append(mine)
        corners.append(np.broadcast_to(np.array(((0, 0), (1, 0), (0, 1))), (len(mine), 3, 2)))
        power.append(even[mine] * areas[mine])
        mine = np.flatnonzero(~is_even & (glow.image == number))
        height, width = grid.shape
        at = np.stack((uvs[mine, :, 0] * width, (1 - uvs[mine, :, 1]) * height), axis=-1)
        for pieces in clip(at):
            chosen, b = mine[pieces.triangle], pieces.barycentric[:, :, 1:]
            weight = grid[pieces.y % height, pieces.x % width]
            share = np.abs(doubled_areas(b))
            keep = weight * share > 0
            rows.append(chosen[keep])
            corners.append(b[keep])
            power.append((weight * share * areas[chosen])[keep])
    return GlowPieces(
        np.concatenate(rows).astype(np.int64),
        np.concatenate(corners),
        np.concatenate(power),
        cells,
        even,
    )


def _step(extent: Doubles, sizes: npt.NDArray[np.int64], most: int) -> int:
    """Texels to a side of a cell: the least power of two for which cells are few enough."""
    step, largest = 1, int(sizes.max(initial=1))
    while step < largest and (extent * sizes[:, ::-1] / step + 1).prod(axis=1).sum() > most:
        step *= 2
    return step


def _smoothed(bright: Doubles) -> Doubles:
    """Mean over each texel of a bilinear, repeating image: its own value weighs 3/4 along either
    axis, each neighbour 1/8.
    """
    for axis in (0, 1):
        bright = (np.roll(bright, 1, axis) + 6 * bright + np.roll(bright, -1, axis)) / 8
    return bright


def _coarser(bright: Doubles, step: int) -> Doubles:
    """Means over the cells of a grid of about ``step`` texels a side, of which whole ones fill the
    image; a texel that lies in several counts in each.
    """
    for axis in (0, 1):
        size = bright.shape[axis]
        count = -(-size // step)
        edges = np.arange(count + 1) * size / count
        sums = np.concatenate(
            (np.zeros_like(bright.take([0], axis)), bright.cumsum(axis)), axis=axis
        )
        low, high = np.floor(edges[:-1]).astype(int), np.ceil(edges[1:]).astype(int)
        shape = [1, 1]
        shape[axis] = count
        bright = (sums.take(high, axis) - sums.take(low, axis)) / (high - low).reshape(shape)
    # Sums of positive numbers, whose differences must not be below nothing by rounding.
    return np.maximum(bright, 0.0)


def _in_bounds(bright: Doubles, uvs: Doubles) -> Doubles:
    """Mean luminance over the texels in the bounds of triangles (m, 3, 2), (m,)."""
    height, width = bright.shape
    sums = np.zeros((2 * height + 1, 2 * width + 1))
    sums[1:, 1:] = np.tile(bright, (2, 2)).cumsum(axis=0).cumsum(axis=1)
    bounds = []
    for along, size in ((uvs[:, :, 0] * width, width), ((1 - uvs[:, :, 1]) * height, height)):
        low = np.floor(along.min(axis=1) - 1e-3).astype(np.int64)
        count = np.floor(along.max(axis=1) + 1e-3).astype(np.int64) - low + 1
        bounds.append((low % size, low % size + np.minimum(count, size)))
    (left, right), (top, bottom) = bounds
    found = sums[bottom, right] - sums[bottom, left] - sums[top, right] + sums[top, left]
    found = np.where(found > 1e-12 * sums[-1, -1], found, 0.0)
    return np.asarray(found / ((right - left) * (bottom - top)))
