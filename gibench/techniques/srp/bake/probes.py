"""Probe placement (Silvennoinen and Lehtinen 2017, section 4.1).

Voxelise the scene, flood-fill its empty space, take the empty voxels beside surfaces as
candidates, thin them from the densest regions to the wanted number, then choose one radius for all
so that receivers are reached by the wanted number of probes on average. The paper's two demands,
that every surface point lies in reach of a probe and is visible from one, are then checked against
the receivers; where they fail, candidates that mend most are swapped in for redundant probes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from gibench.arrays import Bools, Doubles, Floats, Ints
from gibench.errors import BadInput
from gibench.progress import progress
from gibench.rays.offset import SHORT_OF_TARGET
from gibench.rays.tracer import RayTracer
from gibench.scene.lightmap import Lightmap, Receivers
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.voxels import beside_surfaces, regions, view_shares, voxelise
from gibench.techniques.srp.bake.weights import spatial_weight

# Voxels along the longest side of the scene.
_LONGEST = 64
_MOST_CANDIDATES = 6_000
# A candidate that sees more back faces than this is inside a solid or behind the scene; fewer are
# single sheets such as leaves and curtains (RTXGI's threshold for fixed rays is 0.25).
_MOST_BACK_FACES = 0.25
# A region of the flood fill is inside when its candidates together see mostly front faces.
_INSIDE_SHARE = 0.5
# Receivers that coverage is checked on.
_MOST_CHECKED = 20_000
_ROUNDS = 12
_CANDIDATES_TRIED = 256
# Rays traced at once: what a call costs is lost in them.
_RAYS_TOGETHER = 1 << 18


def place_probes(
    scene: Scene,
    lightmap: Lightmap,
    tracer: RayTracer,
    count: int | None,
    overlap: float,
    offset: float,
    seed: int = 0,
) -> ProbeSet:
    """Place ``count`` probes, or take the scene's own.

    Args:
        scene: the scene.
        lightmap: its receivers.
        tracer: against the scene.
        count: how many; None takes the scene's positions, or its own count where it has none.
        overlap: mean number of probes in reach of a receiver.
        offset: how far points are lifted off surfaces, m.
        seed: of the random choices.

    Raises:
        BadInput: the scene's positions are not (p, 3) finite numbers, or no voxel of the scene is
            fit for a probe.
    """
    receivers = lightmap.receivers
    given = scene.probes.positions
    if given is not None and (count is None or count == len(given)):
        positions = np.asarray(given, np.float32)
        if positions.ndim != 2 or positions.shape[1:] != (3,) or not len(positions):
            raise BadInput("probe positions are not rows of three numbers", where=scene.name)
        if not np.isfinite(positions).all():
            raise BadInput("a probe position is not finite", where=scene.name)
        return ProbeSet(positions, support_radius(positions, receivers.position, overlap))
    wanted = scene.probes.count if count is None else count
    rng = np.random.default_rng([seed, 4])
    with progress("Placing probes", 3) as advance:
        candidates = find_candidates(scene, tracer, wanted, rng)
        advance(1)
        chosen = thin(candidates, wanted, _spacing(scene, wanted))
        advance(1)
        checked = _some_receivers(receivers, rng)
        chosen = _cover(candidates, chosen, receivers, checked, overlap, tracer, offset, rng)
        advance(1)
    positions = candidates[np.sort(chosen)].astype(np.float32)
    return ProbeSet(positions, support_radius(positions, receivers.position, overlap))


def find_candidates(
    scene: Scene, tracer: RayTracer, wanted: int, rng: np.random.Generator
) -> Doubles:
    """Candidate positions (n, 3), m: empty voxels beside surfaces, inside; n >= ``wanted``.

    Raises:
        BadInput: there are fewer than ``wanted`` even on a fine grid.
    """
    for longest in (_LONGEST, 2 * _LONGEST, 4 * _LONGEST):
        voxels = voxelise(scene, longest)
        index = beside_surfaces(voxels)
        if len(index) > 4 * _MOST_CANDIDATES:
            index = index[np.sort(rng.choice(len(index), 4 * _MOST_CANDIDATES, replace=False))]
        points = voxels.centres(index)
        front, back = view_shares(points.astype(np.float32), scene, tracer)
        region = regions(voxels)[tuple(index.T)]
        members = np.maximum(np.bincount(region), 1)
        fronts = np.bincount(region, front) / members
        backs = np.bincount(region, back) / members
        inside = fronts >= _INSIDE_SHARE * (fronts + backs)
        points = points[inside[region] & (back <= _MOST_BACK_FACES) & (front > 0)]
        if len(points) > max(_MOST_CANDIDATES, wanted):
            most = max(_MOST_CANDIDATES, wanted)
            points = points[np.sort(rng.choice(len(points), most, replace=False))]
        if len(points) >= wanted:
            return np.asarray(points, np.float64)
    raise BadInput(
        f"only {len(points)} places fit for a probe were found, {wanted} are wanted",
        where=scene.name,
        mend="ask for fewer with --probes, or give positions in the scene's settings",
    )


def open_places(
    scene: Scene, tracer: RayTracer, beside: Doubles, count: int, rng: np.random.Generator
) -> Doubles:
    """At most ``count`` places (n, 3), m, spread over the space that ``beside`` (c, 3), places
    beside surfaces, lie in: empty voxels that see no more backs than those may.
    """
    voxels = voxelise(scene, _LONGEST)
    region = regions(voxels)
    region[[0, -1]] = region[:, [0, -1]] = region[:, :, [0, -1]] = 0
    index = np.floor((beside - voxels.origin) / voxels.edge).astype(np.int64)
    index = np.clip(index, 0, np.array(region.shape) - 1)
    inside = np.unique(region[tuple(index.T)])
    found = np.argwhere(np.isin(region, inside[inside > 0]))
    found = found[np.sort(rng.choice(len(found), min(len(found), count), replace=False))]
    points = voxels.centres(found)
    front, back = view_shares(points.astype(np.float32), scene, tracer)
    points = points[(front > 0) & (back <= _MOST_BACK_FACES)]
    return points if len(points) else beside[:count]


def thin(candidates: Doubles, wanted: int, spacing: float) -> npt.NDArray[np.int64]:
    """Indices of ``wanted`` candidates left after removing, one by one, the densest.

    The density is the paper's kernel estimate: the sum over the remaining candidates of
    w(distance / spacing).
    """
    alive = np.ones(len(candidates), np.bool_)
    left = len(candidates)
    while left > wanted:
        kept = np.flatnonzero(alive)
        one, other, weight = _pairs(candidates[kept], spacing)
        density: Doubles = np.bincount(one, weight, len(kept)).astype(np.float64, copy=False)
        pairs = coo_array((weight, (one, other)), shape=(len(kept), len(kept)))
        pairs.has_canonical_format = True  # no pair comes twice: there is nothing to look for
        rows = pairs.tocsr()
        neighbour, weight, start = rows.indices, rows.data, rows.indptr
        while left > wanted:
            worst = int(density.argmax())
            if density[worst] <= 1e-9:
                break  # nobody is near anybody any more: look further
            near = slice(start[worst], start[worst + 1])
            density[neighbour[near]] -= weight[near]
            density[worst] = -np.inf
            alive[kept[worst]] = False
            left -= 1
        spacing *= 1.5
    return np.flatnonzero(alive)


def _pairs(places: Doubles, spacing: float) -> tuple[Ints, Ints, Doubles]:
    """Both ends (p,) of every pair of ``places`` (n, 3) within ``spacing``, each pair in both
    directions, and their weights w(distance / spacing).

    There may be millions: coordinate by coordinate, they need a third of the time and memory.
    """
    pairs = cKDTree(places).query_pairs(spacing, output_type="ndarray")
    first, second = pairs.T.astype(np.int32)
    square = np.zeros(len(pairs))
    for along in places.T.copy():
        apart = along[first] - along[second]
        square += apart * apart
    weight = spatial_weight(np.sqrt(square) / spacing)
    return (
        np.concatenate([first, second]),
        np.concatenate([second, first]),
        np.concatenate([weight, weight]),
    )


def support_radius(positions: Floats, receivers: npt.NDArray[Any], overlap: float) -> float:
    """The radius at which receivers are reached by ``overlap`` probes on average, by bisection.

    With no more probes than that, the radius reaches every receiver from every probe.
    """
    probes = positions.astype(np.float64)
    low, high = 0.0, _farthest(probes, receivers)
    if len(probes) <= overlap:
        # The weight vanishes at the radius itself: keep the farthest receiver well inside.
        return 1.1 * high
    tree, targets = cKDTree(probes), cKDTree(receivers.astype(np.float64))
    wanted = overlap * len(receivers)
    while high - low > 1e-5 * high:
        middle = 0.5 * (low + high)
        if tree.count_neighbors(targets, middle) < wanted:
            low = middle
        else:
            high = middle
    return float(high)


def mean_overlap(probes: ProbeSet, receivers: Floats) -> float:
    """Mean number of probes in reach of one of ``receivers`` (n, 3), m."""
    targets = cKDTree(receivers.astype(np.float64))
    tree = cKDTree(probes.positions.astype(np.float64))
    return float(tree.count_neighbors(targets, probes.radius)) / max(1, len(receivers))


def _farthest(probes: Doubles, receivers: npt.NDArray[Any]) -> float:
    points = receivers.astype(np.float64)
    return max(float(np.linalg.norm(points - probe, axis=1).max()) for probe in probes)


def _spacing(scene: Scene, wanted: int) -> float:
    """The spacing of a regular grid of ``wanted`` points that covers the scene's bounds, m."""
    low, high = scene.bounds
    extent = np.maximum(high - low, 1e-3 * float((high - low).max()))
    return float(np.cbrt(np.prod(extent) / wanted))


def _some_receivers(receivers: Receivers, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    if len(receivers) <= _MOST_CHECKED:
        return np.arange(len(receivers))
    return np.sort(rng.choice(len(receivers), _MOST_CHECKED, replace=False))


def _cover(
    candidates: Doubles,
    chosen: npt.NDArray[np.int64],
    receivers: Receivers,
    checked: npt.NDArray[np.int64],
    overlap: float,
    tracer: RayTracer,
    offset: float,
    rng: np.random.Generator,
) -> npt.NDArray[np.int64]:
    """``chosen`` with redundant probes exchanged until every checked receiver that can be is
    within reach of a probe that sees it."""
    points = receivers.position[checked].astype(np.float64)
    targets = (points + offset * receivers.normal[checked]).astype(np.float32)
    normals = receivers.normal[checked].astype(np.float64)

    def sees(indices: npt.NDArray[np.int64]) -> Bools:
        return _sees(candidates[indices], targets, normals, tracer)

    seen = sees(chosen)
    hopeless = np.zeros(len(checked), np.bool_)
    for _ in range(_ROUNDS):
        radius = support_radius(candidates[chosen].astype(np.float32), points, overlap)
        reach = np.linalg.norm(candidates[chosen][:, None] - points[None], axis=2) < 0.95 * radius
        covers = seen & reach
        bare = ~covers.any(axis=0) & ~hopeless
        if not bare.any():
            break
        chosen, seen, mended = _swap(
            candidates, chosen, seen, covers, points, bare, radius, sees, rng
        )
        hopeless |= bare & ~mended
    return chosen


def _swap(
    candidates: Doubles,
    chosen: npt.NDArray[np.int64],
    seen: Bools,
    covers: Bools,
    points: Doubles,
    bare: Bools,
    radius: float,
    sees: Callable[[npt.NDArray[np.int64]], Bools],
    rng: np.random.Generator,
) -> tuple[npt.NDArray[np.int64], Bools, Bools]:
    """One round of exchange: greedy set cover of the ``bare`` receivers from nearby candidates."""
    free = np.setdiff1d(np.arange(len(candidates)), chosen)
    distance, _ = cKDTree(points[bare]).query(candidates[free])
    free = free[distance < 0.95 * radius]
    if len(free) > _CANDIDATES_TRIED:
        free = np.sort(rng.choice(free, _CANDIDATES_TRIED, replace=False))
    mended = np.zeros(len(points), np.bool_)
    if not len(free):
        return chosen, seen, mended
    offered = sees(free)
    near = np.linalg.norm(candidates[free][:, None] - points[None], axis=2) < 0.95 * radius
    offers = offered & near
    mended = offers.any(axis=0)
    while True:
        gain = (offers & bare).sum(axis=1)
        best = int(np.argmax(gain))
        if not gain[best]:
            return chosen, seen, mended
        # The probe that alone covers fewest receivers makes room.
        alone = covers & (covers.sum(axis=0) == 1)
        crowd = spatial_weight(
            np.linalg.norm(candidates[chosen][:, None] - candidates[chosen][None], axis=2) / radius
        ).sum(axis=1)
        loss = alone.sum(axis=1)
        victim = int(np.lexsort((-crowd, loss))[0])
        if loss[victim] >= gain[best]:
            return chosen, seen, mended
        chosen, seen, covers = chosen.copy(), seen.copy(), covers.copy()
        chosen[victim], seen[victim], covers[victim] = free[best], offered[best], offers[best]
        bare = ~covers.any(axis=0) & bare


def _sees(places: Doubles, targets: Floats, normals: Doubles, tracer: RayTracer) -> Bools:
    """(k, n) whether each of ``places`` (k, 3) is in front of and sees each of ``targets``."""
    result = np.zeros((len(places), len(targets)), np.bool_)
    together = max(1, _RAYS_TOGETHER // len(targets))
    for first in range(0, len(places), together):
        origins, directions, facing = [], [], []
        for place in places[first : first + together].astype(np.float32):
            toward = targets - place
            facing.append(np.flatnonzero(np.einsum("nx,nx->n", normals, toward) < 0))
            directions.append(toward[facing[-1]])
            origins.append(np.broadcast_to(place, directions[-1].shape))
        blocked = tracer.occluded(
            np.concatenate(origins), np.concatenate(directions), 1.0 - SHORT_OF_TARGET
        )
        ends = np.cumsum([len(one) for one in facing])[:-1]
        for row, seen, hidden in zip(
            result[first : first + together], facing, np.split(blocked, ends), strict=True
        ):
            row[seen] = ~hidden
    return result
