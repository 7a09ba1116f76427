"""Further bounces by random rays against the probes' own maps (Anonymous 2022, section 4.3.3).

Bounce by bounce every texel sends a few rays from the surface it shows, drawn by the cosine. Where
a ray ends, the radiance of the bounce before is read from the nearest probe that sees the place: it
may lie no farther from the probe than what the probe's map shows there. What arrives is smoothed
over the map by a cross-bilateral filter that normals and depths hold back, and is what the next
bounce reads. The sum over all bounces is the light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gibench.arrays import Doubles, Floats, Longs
from gibench.progress import progress
from gibench.rays.offset import surface_offset
from gibench.rays.tracer import RayTracer
from gibench.scene.model import Scene
from gibench.techniques.parts.captured_probes.maps import bilinear, wrapped_texels
from gibench.techniques.parts.captured_probes.points import Points, points_of
from gibench.techniques.parts.captured_probes.resample import ProbeMaps
from gibench.techniques.parts.probe_volume import Volume

NEAREST = 8
"""Probes that are asked, nearest first, whether they see where a ray ends."""
SEEN = 0.5
"""Chebyshev's bound from which one does: no more than a standard deviation behind the mean."""
# A neighbour counts by this power of the cosine between its normal and the texel's, and by
# exp(-x) where it lies x of these shares of the texel's distance off the texel's plane.
_NORMAL_POWER = 32.0
_DEPTH_SHARE = 0.02


@dataclass(frozen=True)
class RayGather:
    """How bounces are gathered.

    Attributes:
        rays: of a texel and bounce.
        denoise: radius of the cross-bilateral filter, texels; 0 for none.
        bias: taken off the distance of a place before it is compared, m.
        far: unit of the maps' distances, m.
    """

    rays: int
    denoise: int
    bias: float
    far: float


@dataclass(frozen=True)
class _Texels:
    """What a probe's map shows: its front-facing texels, and how they are smoothed."""

    shown: Longs = field(repr=False)
    at: Points = field(repr=False)
    albedo: Floats = field(repr=False)
    weights: Floats | None = field(repr=False)


@dataclass(frozen=True)
class Looked:
    """Where radiance is read.

    Attributes:
        positions: (n, 3) of the probes that count, m.
        numbers: (n,) of them among all.
        moments: (p, t, 2) mean distance and mean squared distance of all maps.
        side: texels of a map's side.
        how: places are compared.
    """

    positions: Doubles
    numbers: Longs
    moments: Floats
    side: int
    how: RayGather


def bounced_radiance(
    scene: Scene,
    tracer: RayTracer,
    maps: Sequence[ProbeMaps],
    volume: Volume,
    usable: npt.NDArray[np.bool_],
    side: int,
    first: Floats,
    most: int,
    settled: float,
    how: RayGather,
) -> Floats:
    """Radiance maps (p, t, 3), W/m2/sr, of ``first`` and its bounces.

    Args:
        scene: the scene.
        tracer: of the scene.
        maps: the probes' G-buffers.
        volume: where the probes are; not scrolled.
        usable: (p,) probes that count.
        side: texels of a map's side.
        first: (p, t, 3) what is emitted or reflects direct light alone.
        most: bounces after the first, at most.
        settled: share of the light under which a bounce is the last.
        how: they are gathered.
    """
    numbers = np.flatnonzero(usable)
    total, before = first.copy(), first
    if not len(numbers):
        return total
    moments = np.stack([own.moments for own in maps])
    looked = Looked(volume.positions[numbers], numbers, moments, side, how)
    neighbours = wrapped_texels(side, how.denoise) if how.denoise else None
    texels = [
        _texels(scene, own, position, neighbours, side, how.denoise)
        for own, position in zip(maps, volume.positions, strict=True)
    ]
    tree = cKDTree(looked.positions)
    with progress("Lighting probes, bounce by bounce", most) as advance:
        for bounce in range(most):
            now = np.zeros_like(first)
            for number, own in enumerate(texels):
                if usable[number] and len(own.shown):
                    rng = np.random.default_rng([bounce, number])
                    light = _arriving(scene, tracer, own, looked, tree, before, bounce, rng)
                    if neighbours is not None and own.weights is not None:
                        light = _smoothed(light, own, neighbours, side)
                    now[number, own.shown] = own.albedo * light
            total += now
            advance(1)
            before = now
            if float(now[usable].sum()) <= settled * float(total[usable].sum()):
                break
    return total


def cosine_directions(normal: Doubles, rng: np.random.Generator) -> Doubles:
    """Unit directions (n, 3) about normals (n, 3), by the cosine: the normal and a point of the
    unit sphere, added.
    """
    point = rng.normal(size=normal.shape)
    point /= np.maximum(np.linalg.norm(point, axis=1, keepdims=True), 1e-30)
    d = normal + point
    length = np.linalg.norm(d, axis=1, keepdims=True)
    return np.where(length > 1e-6, d / np.maximum(length, 1e-6), normal)


def _arriving(
    scene: Scene,
    tracer: RayTracer,
    own: _Texels,
    looked: Looked,
    tree: cKDTree,
    before: Floats,
    bounce: int,
    rng: np.random.Generator,
) -> Floats:
    """Irradiance over pi (n, 3) at a probe's texels, of the bounce before."""
    origin = own.at.position + surface_offset(scene) * own.at.geometric
    total = np.zeros((len(own.shown), 3), np.float32)
    for _ in range(looked.how.rays):
        directions = cosine_directions(own.at.normal, rng)
        leaves = np.flatnonzero(np.einsum("nx,nx->n", directions, own.at.geometric) > 0)
        d = directions[leaves]
        hits = tracer.closest(origin[leaves].astype(np.float32), d.astype(np.float32))
        missed = hits.triangle < 0
        if bounce == 0:
            total[leaves[missed]] += scene.environment.radiance(d[missed]).astype(np.float32)
        corners = scene.corners[hits.triangle[~missed]].astype(np.float64)
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        front = np.einsum("nx,nx->n", facing, d[~missed]) < 0
        there = np.flatnonzero(~missed)[front]
        place = origin[leaves[there]] + hits.distance[there, None].astype(np.float64) * d[there]
        total[leaves[there]] += looked_up(looked, tree, before, place, facing[front])
    return total / np.float32(looked.how.rays)


def looked_up(
    looked: Looked, tree: cKDTree, radiance: Floats, place: Doubles, facing: Doubles
) -> Floats:
    """Radiance (n, 3) that places (n, 3) of fronts that look along ``facing`` (n, 3) send out: of
    the nearest probe that sees them, or where none does of the one before them that sees them least
    badly; none where no probe is before them.
    """
    count = len(place)
    found = np.zeros((count, 3), np.float32)
    if not count:
        return found
    asked = min(NEAREST, len(looked.numbers))
    _, near = tree.query(place, k=asked)
    near = near.reshape(count, asked)
    left, best = np.arange(count), np.zeros(count)
    for turn in range(asked):
        own = near[left, turn]
        offset = place[left] - looked.positions[own]
        distance = np.linalg.norm(offset, axis=1)
        texel, share = bilinear(offset / np.maximum(distance, 1e-9)[:, None], looked.side)
        probe = looked.numbers[own][:, None]
        mean, square = np.einsum("nk,nkc->cn", share, looked.moments[probe, texel].astype(float))
        behind = np.maximum((distance - looked.how.bias) / looked.how.far - mean, 0)
        variance = np.maximum(np.abs(mean**2 - square), 1e-30)
        # The bound of Donnelly and Lauritzen 2006 on how much a probe sees.
        bound = variance / (variance + behind**2)
        bound[np.einsum("nx,nx->n", offset, facing[left]) >= 0] = 0.0
        better = bound > best[left]
        values = radiance[probe[better], texel[better]]
        share = share[better].astype(np.float32)
        found[left[better]] = np.einsum("nk,nkc->nc", share, values)
        best[left[better]] = bound[better]
        left = left[best[left] < SEEN]
        if not len(left):
            break
    return found


def _texels(
    scene: Scene,
    maps: ProbeMaps,
    position: Doubles,
    neighbours: Longs | None,
    side: int,
    radius: int,
) -> _Texels:
    shown, at = points_of(scene, maps)
    weights = None
    if neighbours is not None:
        distance = np.linalg.norm(at.position - position, axis=1)
        weights = bilateral_weights(shown, at, distance, neighbours, side, radius)
    return _Texels(shown, at, maps.albedo[shown], weights)


def bilateral_weights(
    shown: Longs, at: Points, distance: Doubles, neighbours: Longs, side: int, radius: int
) -> Floats:
    """(n, k) float32 what each of the ``neighbours`` (t, k) of the texels ``shown`` (n,) counts;
    they sum to 1, as a texel counts itself.

    Args:
        shown: texels that show fronts.
        at: what they show.
        distance: (n,) of that from the probe, m.
        neighbours: of every texel of the map (:func:`wrapped_texels`).
        side: texels of a map's side.
        radius: of the filter, texels.
    """
    row = np.full(side**2, -1, np.int64)
    row[shown] = np.arange(len(shown))
    other = row[neighbours[shown]]
    known = other >= 0
    other = np.maximum(other, 0)
    normal, position = at.normal.astype(np.float32), at.position
    cosine = np.einsum("nx,nkx->nk", normal, normal[other])
    flat = np.maximum(cosine, 0) ** _NORMAL_POWER
    off = np.stack(
        [np.einsum("nx,nx->n", at.geometric, position[column] - position) for column in other.T],
        axis=1,
    )
    near = np.exp(-np.abs(off) / (_DEPTH_SHARE * distance[:, None]))
    step = np.arange(-radius, radius + 1)
    spread = (step[:, None] ** 2 + step[None] ** 2).ravel() / (2 * (radius / 2) ** 2)
    weight = np.where(known, flat * near * np.exp(-spread), 0.0)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True), np.float32)


def _smoothed(light: Floats, own: _Texels, neighbours: Longs, side: int) -> Floats:
    """Light (n, 3) at the texels shown, by their weights."""
    assert own.weights is not None
    whole = np.zeros((side**2, 3), np.float32)
    whole[own.shown] = light
    near = neighbours[own.shown]
    found = np.zeros_like(light)
    for column in range(near.shape[1]):
        found += own.weights[:, column, None] * whole[near[:, column]]
    return found
