"""Sample sets of the bake: directions, low-discrepancy points, points on texels' surfaces."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.scene.lightmap import Fragments


def strata(count: int) -> tuple[int, int]:
    """(rows, columns) with rows * columns == count, as square as the divisors of count allow."""
    rows = next(d for d in range(int(np.sqrt(count)), 0, -1) if count % d == 0)
    return rows, count // rows


def sphere_directions(count: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Stratified uniform directions (count, 3) on the sphere (Bennett 2019, eq. 5.2).

    The unit square is cut into as square a grid as has exactly ``count`` cells of equal size; a
    count with no such grid (a prime, say) is cut into rows that differ by one cell in length, each
    row as high as its share of cells, so that every cell keeps the same area.
    """
    rows, columns = strata(count)
    if columns > 4 * rows:
        rows = max(1, round(np.sqrt(count)))
    lengths = np.full(rows, count // rows)
    lengths[: count % rows] += 1
    row = np.repeat(np.arange(rows), lengths)
    column = np.concatenate([np.arange(length) for length in lengths])
    bottom = np.concatenate(([0], np.cumsum(lengths)))[:-1] / count
    jitter = rng.random((count, 2))
    x = bottom[row] + jitter[:, 0] * lengths[row] / count
    y = (column + jitter[:, 1]) / lengths[row]
    # theta = 2 arccos(sqrt(1 - x)), so cos(theta) = 1 - 2 x.
    z = 1.0 - 2.0 * x
    radius = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    azimuth = 2.0 * np.pi * y
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)


def primary_points(count: int, stride: int, seed: int) -> Floats:
    """The points (stride, 4) float32 in [0, 1)^4 shared by all receivers; zero past ``count``.

    Owen-scrambled Sobol points (dimensions 0 and 1 make the direction, 2 and 3 the origin), sorted
    along a Morton curve of the direction so that neighbouring rays run through the same boxes.
    """
    from scipy.stats import qmc  # slow to load

    with warnings.catch_warnings():
        # Counts that are not powers of two lose some balance; that is the user's choice.
        warnings.simplefilter("ignore", UserWarning)
        points = qmc.Sobol(4, scramble=True, seed=seed).random(count)
    order = np.argsort(_morton(points[:, :2]), kind="stable")
    padded = np.zeros((stride, 4), np.float32)
    padded[:count] = np.minimum(points[order], np.nextafter(np.float32(1), np.float32(0)))
    return padded


def _morton(points: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    cells = (points * 1024).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        code |= ((cells[:, 0] >> bit) & 1) << (2 * bit + 1)
        code |= ((cells[:, 1] >> bit) & 1) << (2 * bit)
    return code


def fragment_shares(fragments: Fragments) -> Floats:
    """(m,) float32: cumulative share of its receiver's area up to and including each fragment."""
    start = fragments.start
    sums = np.concatenate(([0.0], np.cumsum(fragments.area.astype(np.float64))))
    counts = np.diff(start)
    owner = np.repeat(np.arange(len(counts)), counts)
    total = (sums[start[1:]] - sums[start[:-1]])[owner]
    within = sums[1:] - sums[start[:-1]][owner]
    even = (np.arange(len(owner)) - start[:-1][owner] + 1) / counts[owner]
    share: Floats = np.divide(within, total, out=even, where=total > 0).astype(np.float32)
    share[start[1:][counts > 0] - 1] = 1.0
    return share


def surface_points(
    fragments: Fragments, per_receiver: int, rng: np.random.Generator
) -> tuple[Floats, Ints]:
    """Points stratified by area over every receiver's covered surface.

    Returns:
        (n, k, 3) float32 positions, m, and (n, k) int32 the scene triangle each lies on.
    """
    receivers = len(fragments.start) - 1
    share = fragment_shares(fragments).astype(np.float64)
    owner = np.repeat(np.arange(receivers), np.diff(fragments.start))
    at = (np.arange(per_receiver) + rng.random((receivers, per_receiver))) / per_receiver
    wanted = np.minimum(at, 1.0 - 1e-9) + np.arange(receivers)[:, None]
    found = np.searchsorted(owner + share, wanted.ravel(), side="right")
    found = np.minimum(found, np.repeat(fragments.start[1:] - 1, per_receiver))
    first = found == np.repeat(fragments.start[:-1], per_receiver)
    low = np.where(first, 0.0, share[np.maximum(found - 1, 0)])
    width = np.maximum(share[found] - low, 1e-12)
    rest = np.clip((at.ravel() - low) / width, 0.0, 1.0)
    weights = triangle_weights(rest, rng.random(len(rest)))
    points = np.einsum("nc,ncx->nx", weights, fragments.corners[found].astype(np.float64))
    shape = (receivers, per_receiver)
    triangle = fragments.triangle[found].reshape(shape).astype(np.int32)
    return points.reshape(*shape, 3).astype(np.float32), triangle


def triangle_weights(u: npt.NDArray[Any], v: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Barycentric weights (n, 3), uniform over a triangle for uniform ``u`` and ``v`` (n,)."""
    a = np.sqrt(np.asarray(u, np.float64))
    return np.stack([1.0 - a, a * (1.0 - v), a * v], axis=1)


def triangle_planes(corners: Floats) -> Floats:
    """(t, 4) float32: every triangle's unit normal and its distance from the origin, m."""
    c = corners.astype(np.float64)
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    distance = np.einsum("tx,tx->t", normal, c.mean(axis=1))
    return np.concatenate([normal, distance[:, None]], axis=1).astype(np.float32)


def with_angles(points: Floats) -> Floats:
    """(n, 8) float32 of points (n, 4): u0, cos and sin of 2 pi u1, u2, u3, padding."""
    angle = 2.0 * np.pi * points[:, 1].astype(np.float64)
    columns = points[:, 0], np.cos(angle), np.sin(angle), points[:, 2], points[:, 3]
    return np.pad(np.stack(columns, axis=1).astype(np.float32), ((0, 0), (0, 3)))
