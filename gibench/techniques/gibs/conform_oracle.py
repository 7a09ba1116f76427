"""What GIBS's kernels are held against: float64 NumPy on random surfels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Array
from gibench.device import Device
from gibench.techniques.gibs.macros import VISIBLE_FRAMES
from gibench.techniques.parts.surfel_grid import UniformGrid
from gibench.techniques.parts.surfels import SurfelGeometry, surfel_words

STRETCH = 4.0  # of surfels along their normals, in what is tested
IDENTITY = np.eye(3, 4, dtype=np.float32).reshape(1, 12)


def frame_words(
    alive: int,
    camera: Sequence[float] = (0, 0, 0),
    angle: float = 0.0,
    least: float = 0.01,
    most: float = np.inf,
    frame: int = 1,
    rays: int = 0,
) -> Array:
    """The table of a frame: what is alive, from where it is seen, radii."""
    words = surfel_words(alive, camera, angle, least, most)
    return np.concatenate([words, np.array([frame, rays, 7], np.uint32)])


def geometry(
    device: Device,
    position: Array,
    normal: Array,
    frame: Array,
    ids: Array | None = None,
    capacity: int | None = None,
    transforms: Array = IDENTITY,
) -> SurfelGeometry:
    """Surfels of object 1 at ``position`` (n, 3) under the IDs ``ids``."""
    n = len(position)
    capacity = capacity or max(n, 1)
    ids = np.arange(n) if ids is None else ids
    alive = np.zeros(capacity, np.uint32)
    alive[:n] = ids
    objects = np.zeros(capacity, np.int32)
    objects[ids] = 1
    local = np.zeros((2, 3, capacity), np.float32)
    local[0][:, ids] = np.asarray(position, np.float32).T
    local[1][:, ids] = np.asarray(normal, np.float32).T
    return SurfelGeometry(
        device.upload("frame", frame),
        device.upload("alive_ids", alive),
        device.upload("object_ids", objects),
        device.upload("transforms", transforms),
        device.upload("local_position", local[0]),
        device.upload("local_normal", local[1]),
        device.empty("world_position", (3, capacity), np.float32),
        device.empty("world_normal", (3, capacity), np.float32),
        device.empty("radii", capacity, np.float32),
        mean=device.upload("mean", np.random.default_rng(5).random((3, capacity), np.float32)),
        nearest=device.empty("nearest", capacity, np.float32),
    )


def uniform_coordinates(grid: UniformGrid, position: Array) -> Array:
    """The cell coordinates (n, 3) of points, by the device's own float32 operations."""
    table = grid.table((0, 0, 0))
    at = np.floor((np.asarray(position, np.float32) - table[:3]) * table[4])
    return np.asarray(np.clip(at, 0, np.array(grid.shape) - 1).astype(int))


def neighbour_lists(grid: UniformGrid, position: Array) -> list[set[int]]:
    """Every cell's set of surfels when each goes into its cell and all neighbours."""
    lists: list[set[int]] = [set() for _ in range(grid.cells)]
    nx, ny, nz = grid.shape
    for i, (x, y, z) in enumerate(uniform_coordinates(grid, position)):
        for cz in range(max(z - 1, 0), min(z + 2, nz)):
            for cy in range(max(y - 1, 0), min(y + 2, ny)):
                for cx in range(max(x - 1, 0), min(x + 2, nx)):
                    lists[(cz * ny + cy) * nx + cx].add(i)
    return lists


def disk_to_square(x: Array, y: Array) -> tuple[Array, Array]:
    """Shirley and Chiu 1997 by polar angle, float64; the inverse of the concentric map."""
    r, phi = np.hypot(x, y), np.arctan2(y, x)
    phi = np.where(phi < -np.pi / 4, phi + 2 * np.pi, phi)
    quarter = np.floor((phi + np.pi / 4) / (np.pi / 2)).astype(int) % 4
    t = phi * 4 / np.pi
    a = np.select([quarter == 0, quarter == 1, quarter == 2], [r, -r * (t - 2), -r], r * (t - 6))
    b = np.select([quarter == 0, quarter == 1, quarter == 2], [r * t, r, -r * (t - 4)], -r)
    return a, b


def basis(n: Array) -> tuple[Array, Array]:
    """Duff et al. 2017 for (k, 3) normals."""
    sign = np.copysign(1.0, n[:, 2])
    a = -1 / (sign + n[:, 2])
    b = n[:, 0] * n[:, 1] * a
    t = np.stack([1 + sign * n[:, 0] ** 2 * a, sign * b, -sign * n[:, 0]], 1)
    return t, np.stack([b, sign + n[:, 1] ** 2 * a, -n[:, 1]], 1)


def visibility(moments: Array, normal: Array, offset: Array) -> Array:
    """(k,) for k surfels and the offsets of one point from them, float64."""
    distance = np.linalg.norm(offset, axis=1)
    direction = offset / distance[:, None]
    t, b = basis(normal)
    x, y = (direction * t).sum(1), (direction * b).sum(1)
    below = (direction * normal).sum(1) < 0
    size = np.where(below, np.hypot(x, y), 1.0)
    at = np.stack(disk_to_square(x / size, y / size), 1)
    at = np.clip((at + 1) * 2 - 0.5, 0, 3)
    low = np.floor(at).astype(int)
    high = np.minimum(low + 1, 3)
    f = at - low
    k = np.arange(len(normal))
    m = moments.reshape(-1, 3, 4, 4)

    def mixed(which: int) -> Array:
        v = m[:, which]
        top = v[k, low[:, 1], low[:, 0]] * (1 - f[:, 0]) + v[k, low[:, 1], high[:, 0]] * f[:, 0]
        end = v[k, high[:, 1], low[:, 0]] * (1 - f[:, 0]) + v[k, high[:, 1], high[:, 0]] * f[:, 0]
        return np.asarray(top * (1 - f[:, 1]) + end * f[:, 1])

    mean, square = mixed(0), mixed(1)
    variance, beyond = np.maximum(square - mean**2, 0), distance - mean
    bound = variance / (variance + beyond**2)
    return np.asarray(np.where(beyond <= 0, 1.0, bound**3))


def gathered(
    x: Array,
    n: Array,
    position: Array,
    normal: Array,
    radius: Array,
    irradiance: Array,
    moments: Array | None,
) -> Array:
    """Irradiance and coverage of one point from all surfels there are, float64."""
    o = x - position
    h = (o * normal).sum(1)
    d = np.sqrt((o * o).sum(1) + (STRETCH**2 - 1) * h * h)
    t = np.clip(1 - d / radius, 0, 1)
    w = t * t * (3 - 2 * t) * np.maximum(normal @ n, 0)
    if moments is not None:
        w = w * visibility(moments, normal, o)
    return np.append(
        (w[:, None] * irradiance).sum(0) / w.sum() if w.sum() else np.zeros(3), w.sum()
    )


LUMA = np.array([0.299, 0.587, 0.114])
EstimatorState = tuple[Array, Array, Array, float, float, float]
"""Mean, short mean and variance (3,), blend, inconsistency, rays."""


def estimator_step(e: EstimatorState, y: Array, floored: bool) -> EstimatorState:
    """One sample into the multi-scale mean estimator (Barre-Brisebois et al. 2019), float64.

    Floored: no clamp, and each of the three means weighs a ray as much as four of those before at
    least, and 1/256.
    """
    m, s, v, b, i, n = e
    n = min(n + 1, 1021 if floored else 256)
    least = 4 / (n + 3) if floored else 0
    if floored and n == 1:
        m = y
    if not floored:
        y = np.minimum(y, 0.1 + s + 8 * np.sqrt(np.maximum(1e-5, v)))
    s2 = s + max(0.08, least) * (y - s)
    v2 = v + max(0.04, least) * ((y - s) * (y - s2) - v)
    sigma = np.sqrt(np.maximum(1e-5, v2))
    r = LUMA @ np.abs((m - s2) / sigma)
    i2 = i + 0.08 * (r - i)
    x = np.clip(r * max(0.02, i2 - 0.2), 0, 1)
    k = b * np.clip(x * x * (3 - 2 * x), 1 / 256, 1)
    b2 = b + 0.1 * (np.clip(LUMA @ (0.5 * s2 / sigma), 1 / 32, 1) - b)
    return m + max(k, least) * (y - m), s2, v2, float(b2), float(i2), n


@dataclass(frozen=True)
class Updated:
    """Surfels once they have taken in a frame's rays, float64.

    Attributes:
        estimator: (12, n).
        moments: (n, 48) mean depth, its square and counts of 16 texels.
        guides: (n, 16).
        certain: (n,) whether float32 knows the estimator: a first ray makes the variance of the
            floored one the product of a difference and of its own rounding.
    """

    estimator: Array
    moments: Array
    guides: Array
    certain: Array


@dataclass(frozen=True)
class Rays:
    """A frame's rays by surfel, in the order of ``ids``.

    Attributes:
        ids: (n,) surfels.
        first: (n + 1,) each one's first ray.
        light: (r, 4) radiance and distance.
        choice: (r, 2) weight and texel.
        radii: (n,) by surfel.
    """

    ids: Array
    first: Array
    light: Array
    choice: Array
    radii: Array


def updated(rays: Rays, estimator: Array, moments: Array, guides: Array, floored: bool) -> Updated:
    """What ``update_surfels`` makes of surfels and their rays."""
    e64, m64, g64 = (a.astype(np.float64) for a in (estimator, moments, guides))
    certain = np.ones(len(moments), bool)
    for place, surfel in enumerate(rays.ids):
        row = e64[:, surfel]
        e: EstimatorState = (row[0:3], row[3:6], row[6:9], row[9], row[10], row[11])
        for ray in range(rays.first[place], rays.first[place + 1]):
            weight, texel = np.float32(rays.choice[ray, 0]), int(rays.choice[ray, 1])
            light = rays.light[ray, :3].astype(np.float64)
            sample, short = np.pi * weight * light, e[1]
            e = estimator_step(e, sample, floored)
            rounding = 2.0**-22 * np.abs(sample - short) * (np.abs(sample) + np.abs(short))
            certain[surfel] &= bool(np.all(rounding < 1e-4 * np.maximum(e[2], 1e-5)))
            d = min(float(rays.light[ray, 3]), 2.0 * float(rays.radii[surfel]))
            count = m64[surfel, 32 + texel] + 1
            rate = max(1 / count, 0.05)
            m64[surfel, texel] += rate * (d - m64[surfel, texel])
            m64[surfel, 16 + texel] += rate * (d * d - m64[surfel, 16 + texel])
            m64[surfel, 32 + texel] = min(count, 20)
            g64[surfel, texel] += 0.1 * (LUMA @ rays.light[ray, :3] - g64[surfel, texel])
        e64[:, surfel] = np.concatenate([*e[:3], e[3:]])
    return Updated(e64, m64, g64, certain)


def random_rays(rng: np.random.Generator, n: int, floored: bool) -> tuple[Rays, Updated]:
    """Rays of ``n`` surfels, and what these were before: all of it float32 but the counts."""
    rays = rng.integers(0, 6, n)
    first = np.concatenate([[0], np.cumsum(rays)]).astype(np.uint32)
    total = int(first[-1])
    light = rng.exponential(1.0, (total, 4)).astype(np.float32)
    choice = np.stack([rng.uniform(0.5, 2, total), rng.integers(0, 16, total)], 1)
    radii = rng.uniform(0.1, 1, n).astype(np.float32)
    estimator = rng.uniform(0.05, 1, (12, n)).astype(np.float32)
    most = [1019, 1020, 1021] if floored else []
    estimator[11] = rng.choice([0, 1, 2, 40, 255, 256, *most], n)
    moments = rng.uniform(0.1, 1, (n, 48)).astype(np.float32)
    moments[:, 32:] = rng.integers(0, 21, (n, 16))
    guides = rng.uniform(0, 1, (n, 16)).astype(np.float32)
    ids = rng.permutation(n).astype(np.uint32)
    taken = Rays(ids, first, light, choice.astype(np.float32), radii)
    return taken, Updated(estimator, moments, guides, np.ones(n, bool))


def requested(inconsistency: Array, unseen: Array) -> Array:
    """Rays that surfels ask for, (n,) in 1/256: an eighth and their inconsistency, at most 4; a
    quarter of it out of sight.
    """
    share = np.where(unseen <= VISIBLE_FRAMES, 1, 0.25) * (0.125 + np.minimum(inconsistency, 4))
    return np.maximum(np.floor(256 * share), 1)
