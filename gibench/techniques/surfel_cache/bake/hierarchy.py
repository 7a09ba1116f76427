"""The hierarchy over the surfels (Jendersie et al. 2016, section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gibench.arrays import Doubles, Longs
from gibench.techniques.surfel_cache.bake.data import Hierarchy, SurfelSet
from gibench.techniques.surfel_cache.bake.surfels import query_threads

NORMAL_WEIGHT: Final = 0.1
"""C_n of section 4.3."""
BALANCE_WEIGHT: Final = 0.02
"""C_b of section 4.3."""

CLUSTERING, EXACT, KD_TREE = "clustering", "exact", "kd-tree"
HIERARCHIES: Final = (CLUSTERING, EXACT, KD_TREE)
MOST_EXACT: Final = 8192
"""Surfels that ``exact`` takes at most: of so many the pairs' distances are 0.5 GiB."""

# Clusters that are left when the neighbour graph gives way to all pairs.
_ALL_PAIRS = 2048
# Candidates looked at for each cluster in the neighbour graph.
_CANDIDATES = 16


def hierarchy_of(surfels: SurfelSet, kind: str) -> Hierarchy:
    """The tree over ``surfels``; ``kind`` is one of HIERARCHIES."""
    if kind == KD_TREE:
        return kd_tree(surfels.position)
    most = len(surfels) if kind == EXACT else _ALL_PAIRS
    return agglomerative(surfels, most)


# -- agglomerative ----------------------------------------------------------------------------


@dataclass
class _Clusters:
    """The clusters that are left.

    Attributes:
        node: (k,) int64 their numbers: below n a surfel, from there on merged ones in their order.
        centre: (k, 3) float64 area-weighted, over the scene's extent.
        facing: (k, 3) float64 sum of their surfels' normals.
        size: (k,) float64 surfels.
    """

    node: Longs
    centre: Doubles
    facing: Doubles
    size: Doubles

    @property
    def normal(self) -> Doubles:
        """Unit normals (k, 3); nothing where they cancel."""
        length = np.linalg.norm(self.facing, axis=1, keepdims=True)
        return np.where(length > 1e-9, self.facing / np.maximum(length, 1e-30), 0.0)

    def taken(self, rows: npt.NDArray[Any]) -> _Clusters:
        return _Clusters(self.node[rows], self.centre[rows], self.facing[rows], self.size[rows])


def distance(
    centre_a: Doubles, normal_a: Doubles, size_a: Doubles,
    centre_b: Doubles, normal_b: Doubles, size_b: Doubles,
) -> Doubles:  # fmt: skip
    """Section 4.3's metric; centres over the scene's extent, sizes in surfels of one area."""
    apart = ((centre_a - centre_b) ** 2).sum(axis=-1)
    turned = 1 - (normal_a * normal_b).sum(axis=-1)
    unlike = np.abs(size_a - size_b) / np.maximum(size_a, size_b)
    return np.asarray(apart + NORMAL_WEIGHT * turned + BALANCE_WEIGHT * unlike)


def agglomerative(surfels: SurfelSet, all_pairs: int = _ALL_PAIRS) -> Hierarchy:
    """Clusters merged two by two, those at the least distance first.

    With all pairs of distances the order is that of the generic algorithm (Muellner 2011). As long
    as more than ``all_pairs`` clusters are left, clusters that are each other's nearest are merged
    all at once: their neighbours come from a kd-tree over centre, normal and logarithm of the size,
    the nearest among them from the metric itself. What that gives up is the order between merges
    far apart, and partners that are not among the candidates.

    Args:
        surfels: one or more.
        all_pairs: clusters from which on all pairs are looked at.
    """
    n = len(surfels)
    position = surfels.position.astype(np.float64)
    extent = float(np.linalg.norm(position.max(axis=0) - position.min(axis=0))) or 1.0
    left = _Clusters(
        np.arange(n, dtype=np.int64),
        position / extent,
        surfels.normal.astype(np.float64),
        np.ones(n),
    )
    merges = np.empty((n - 1, 2), np.int64)
    made = 0
    while len(left.node) > max(all_pairs, 2):
        a, b = _mutual_pairs(left)
        merges[made : made + len(a)] = np.stack([left.node[a], left.node[b]], axis=1)
        left = _merged(left, a, b, n + made)
        made += len(a)
    _merge_all_pairs(left, merges, made, n)
    return tree_of(merges, n)


def _mutual_pairs(left: _Clusters) -> tuple[Longs, Longs]:
    """Pairs of clusters that are each other's nearest; at least one."""
    normal = left.normal
    place = np.concatenate(
        [
            left.centre,
            np.sqrt(NORMAL_WEIGHT / 2) * normal,  # 1 - cosine is half the squared difference
            np.sqrt(BALANCE_WEIGHT) * np.log(left.size)[:, None],
        ],
        axis=1,
    )
    own = np.arange(len(place))
    most = min(_CANDIDATES + 1, len(place))
    near = cKDTree(place).query(place, most, workers=query_threads(len(place)))[1]
    near = np.asarray(near, np.int64)
    far = distance(
        left.centre[:, None], normal[:, None], left.size[:, None],
        left.centre[near], normal[near], left.size[near],
    )  # fmt: skip
    far[near == own[:, None]] = np.inf
    at = far.argmin(axis=1)
    best, least = near[own, at], far[own, at]
    # Of several pairs at one distance the one of lower numbers: so that no ring of equals stalls.
    mutual = np.flatnonzero(best[best] == own)
    mutual = mutual[mutual < best[mutual]]
    if not len(mutual):
        first = int(least.argmin())
        return np.array([first]), np.array([best[first]])
    return mutual, best[mutual]


def _merged(left: _Clusters, a: Longs, b: Longs, first: int) -> _Clusters:
    """The clusters with pairs ``a``, ``b`` put together, numbered from ``first`` on."""
    stay = np.ones(len(left.node), np.bool_)
    stay[a] = stay[b] = False
    rest = left.taken(np.flatnonzero(stay))
    size = left.size[a] + left.size[b]
    weight = (left.size[a] / size)[:, None]
    return _Clusters(
        np.concatenate([rest.node, first + np.arange(len(a), dtype=np.int64)]),
        np.concatenate([rest.centre, left.centre[a] * weight + left.centre[b] * (1 - weight)]),
        np.concatenate([rest.facing, left.facing[a] + left.facing[b]]),
        np.concatenate([rest.size, size]),
    )


def _merge_all_pairs(left: _Clusters, merges: Longs, made: int, n: int) -> None:
    """Merge what is left, always the nearest of all pairs, into ``merges`` from row ``made`` on."""
    count = len(left.node)
    node, centre, facing, size = left.node, left.centre, left.facing, left.size
    normal = left.normal
    pairs = np.empty((count, count), np.float64)
    for own in range(count):
        pairs[own] = distance(centre[own], normal[own], size[own], centre, normal, size)
    np.fill_diagonal(pairs, np.inf)
    best = pairs.argmin(axis=1) if count > 1 else np.zeros(count, np.int64)
    least = pairs[np.arange(count), best] if count > 1 else np.full(count, np.inf)
    for step in range(made, n - 1):
        a = int(least.argmin())
        b = int(best[a])
        merges[step] = node[a], node[b]
        total = size[a] + size[b]
        centre[a] = (centre[a] * size[a] + centre[b] * size[b]) / total
        facing[a] += facing[b]
        size[a], node[a] = total, n + step
        length = np.linalg.norm(facing[a])
        normal[a] = facing[a] / length if length > 1e-9 else 0.0
        pairs[b, :] = pairs[:, b] = np.inf
        least[b] = np.inf
        alive = np.isfinite(pairs[a])
        row = np.full(count, np.inf)
        row[alive] = distance(
            centre[a], normal[a], size[a], centre[alive], normal[alive], size[alive]
        )
        pairs[a], pairs[:, a] = row, row
        # Rows that a or b was nearest to look again; others can only have come nearer to a.
        again = np.flatnonzero(((best == a) | (best == b)) & np.isfinite(least))
        nearer = row < least
        best[nearer], least[nearer] = a, row[nearer]
        again = np.unique(np.append(again, a))
        best[again] = pairs[again].argmin(axis=1)
        least[again] = pairs[again, best[again]]


def tree_of(merges: Longs, n: int) -> Hierarchy:
    """The hierarchy of ``merges`` (n - 1, 2): row k makes node n + k of two earlier ones."""
    size = np.ones(2 * n - 1, np.int64)
    for k in range(n - 1):
        size[n + k] = size[merges[k, 0]] + size[merges[k, 1]]
    count = 2 * n - 1
    begin, end, child = (np.empty(count, np.int64) for _ in range(3))
    leaf = np.empty(n, np.int32)
    level, at = [0], 0
    nodes, starts = np.array([count - 1]), np.array([0])
    while len(nodes):
        here = slice(at, at + len(nodes))
        begin[here], end[here] = starts, starts + size[nodes]
        inner = nodes >= n
        leaf[starts[~inner]] = nodes[~inner]
        at += len(nodes)
        level.append(at)
        first = at + 2 * np.arange(int(inner.sum()))
        own = np.full(len(nodes), -1, np.int64)
        own[inner] = first
        child[here] = own
        pair = merges[nodes[inner] - n]
        begun = starts[inner]
        starts = np.stack([begun, begun + size[pair[:, 0]]], axis=1).reshape(-1)
        nodes = pair.reshape(-1)
    begins, ends, children = (each.astype(np.int32) for each in (begin, end, child))
    return Hierarchy(leaf, begins, ends, children, np.array(level, np.int32))


# -- kd-tree ----------------------------------------------------------------------------------


def kd_tree(position: npt.NDArray[Any]) -> Hierarchy:
    """Positions (n, 3) halved by their number along the longest axis, down to single ones."""
    n = len(position)
    place = position.astype(np.float64)
    leaf = np.arange(n)
    begin, end, child = ([] for _ in range(3))  # type: tuple[list[Longs], list[Longs], list[Longs]]
    level, at = [0], 0
    starts, ends = np.array([0]), np.array([n])
    while len(starts):
        leaf = _sorted_along(place, leaf, starts, ends)
        inner = ends - starts > 1
        at += len(starts)
        level.append(at)
        own = np.full(len(starts), -1, np.int64)
        own[inner] = at + 2 * np.arange(int(inner.sum()))
        begin.append(starts)
        end.append(ends)
        child.append(own)
        low, high = starts[inner], ends[inner]
        middle = (low + high) // 2
        starts = np.stack([low, middle], axis=1).reshape(-1)
        ends = np.stack([middle, high], axis=1).reshape(-1)
    begins, ends, children = (np.concatenate(each).astype(np.int32) for each in (begin, end, child))
    return Hierarchy(leaf.astype(np.int32), begins, ends, children, np.array(level, np.int32))


def _sorted_along(place: Doubles, leaf: Longs, starts: Longs, ends: Longs) -> Longs:
    """The leaves with every stretch sorted along the longest axis of what it holds."""
    sizes = ends - starts
    ordered = leaf.copy()
    own = np.repeat(np.arange(len(starts)), sizes)
    first = np.cumsum(sizes) - sizes
    rows = np.arange(len(own)) - np.repeat(first - starts, sizes)
    points = place[leaf[rows]]
    low = np.minimum.reduceat(points, first, axis=0)
    high = np.maximum.reduceat(points, first, axis=0)
    axis = (high - low).argmax(axis=1)
    along = points[np.arange(len(own)), axis[own]]
    ordered[rows] = leaf[rows][np.lexsort((along, own))]
    return ordered
