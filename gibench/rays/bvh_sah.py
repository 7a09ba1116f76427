"""A binary bounding volume hierarchy by the surface-area heuristic, built a level at a time.

Every split of every node along every axis is evaluated exactly (the full sweep of Wald and Havran
2006, section 4, for boxes rather than a kd-tree), with NumPy working on all nodes of a level at
once. The tree goes down to single boxes; :mod:`gibench.rays.bvh_wide` decides where leaves are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints

Indices = npt.NDArray[np.int64]

# A split that does not lower the cost by this share is one of many equals (boxes on top of each
# other); the median of them keeps the tree balanced.
_LEAST_GAIN = 1e-6


@dataclass(frozen=True)
class BinaryTree:
    """A binary tree over boxes, nodes numbered level by level from the root, 0.

    Attributes:
        left: (m,) int32 left child; the right one follows it; -1 at a leaf.
        start: (m,) int32 first entry of the node in ``order``.
        count: (m,) int32 boxes beneath the node.
        lower, upper: (m, 3) float32 bounds.
        level_starts: first node of every level, and the number of nodes.
        order: (n,) int32 boxes, so that those of any node are contiguous.
    """

    left: Ints = field(repr=False)
    start: Ints = field(repr=False)
    count: Ints = field(repr=False)
    lower: Floats = field(repr=False)
    upper: Floats = field(repr=False)
    level_starts: tuple[int, ...]
    order: Ints = field(repr=False)


def build_binary(lower: Floats, upper: Floats, median_depth: int = 40) -> BinaryTree:
    """Build the tree over boxes ``lower`` to ``upper``, (n, 3) float32, n > 0.

    Args:
        lower: smallest corners.
        upper: largest corners.
        median_depth: below this depth nodes are split at the median, which bounds the depth by
            ``median_depth + log2(n)`` whatever the boxes.
    """
    n = len(lower)
    centres = lower.astype(np.float64) + upper
    axes = [np.argsort(centres[:, a], kind="stable").astype(np.int64) for a in range(3)]
    # In one scale for all axes, within [0, 1/2]: see _segmented_max.
    origin = lower.min(axis=0).astype(np.float64)
    scale = 0.5 / max(float((upper.max(axis=0) - origin).max()), 1e-30)
    high = (upper - origin) * scale
    low = 0.5 - (lower - origin) * scale
    sizes = np.array([n], np.int64)
    offsets = np.array([0], np.int64)  # in the final order
    order = np.empty(n, np.int64)
    lefts: list[Indices] = []
    starts: list[Indices] = []
    counts: list[Indices] = []
    level_starts = [0]
    depth = 0
    while len(sizes):
        starts.append(offsets)
        counts.append(sizes)
        split = sizes > 1
        first_child = level_starts[-1] + len(sizes)
        left = np.full(len(sizes), -1, np.int64)
        left[split] = first_child + 2 * np.arange(np.count_nonzero(split))
        lefts.append(left)
        level_starts.append(first_child)
        # Boxes of finished nodes go to their place and leave the working set.
        owner = np.repeat(np.arange(len(sizes)), sizes)
        keep = split[owner]
        if not keep.all():
            order[offsets[~split]] = axes[0][~keep]
            axes = [axis[keep] for axis in axes]
            sizes, offsets = sizes[split], offsets[split]
        if not len(sizes):
            break
        axis, at = _best_splits(axes, low, high, sizes, depth >= median_depth)
        axes = _partition(axes, sizes, axis, at, n)
        offsets = np.stack([offsets, offsets + at], axis=1).reshape(-1)
        sizes = np.stack([at, sizes - at], axis=1).reshape(-1)
        depth += 1
    start, count = np.concatenate(starts), np.concatenate(counts)
    left = np.concatenate(lefts)
    node_lower, node_upper = _bounds(lower, upper, order, left, start, level_starts)
    return BinaryTree(
        left.astype(np.int32),
        start.astype(np.int32),
        count.astype(np.int32),
        node_lower,
        node_upper,
        tuple(level_starts),
        order.astype(np.int32),
    )


def _best_splits(
    axes: list[Indices], low: Doubles, high: Doubles, sizes: Indices, median: bool
) -> tuple[Indices, Indices]:
    """Axis and number of boxes on the left of the cheapest split of every node."""
    if median:
        return np.zeros(len(sizes), np.int64), sizes // 2
    first = np.cumsum(sizes) - sizes
    last = first + sizes - 1
    owner = np.repeat(np.arange(len(sizes)), sizes)
    on_left = np.arange(len(owner)) - first[owner] + 1
    on_right = sizes[owner] - on_left
    best = np.full(len(sizes), np.inf)
    best_axis = np.zeros(len(sizes), np.int64)
    best_at = sizes // 2
    shift = owner.astype(np.float64)
    back = shift[::-1].max(initial=0.0) - shift[::-1]
    for number, refs in enumerate(axes):
        extent_left = [
            _segmented_max(low[refs, a], shift) + _segmented_max(high[refs, a], shift) - 0.5
            for a in range(3)
        ]
        extent_right = [
            (
                _segmented_max(low[refs[::-1], a], back)
                + _segmented_max(high[refs[::-1], a], back)
                - 0.5
            )[::-1]
            for a in range(3)
        ]
        # A split after box i has boxes up to i on its left and from i + 1 on its right.
        area_left = _half_area(extent_left)
        area_right = np.append(_half_area(extent_right)[1:], 0.0)
        cost = area_left * on_left + area_right * on_right
        whole = cost[last]
        cost[last] = np.inf
        least = np.minimum.reduceat(cost, first)
        places = np.flatnonzero(cost == least[owner])
        where = np.full(len(sizes), len(owner), np.int64)
        np.minimum.at(where, owner[places], places)
        at = where - first + 1
        # A box of no area leaves nothing to choose by.
        at = np.where(least < whole * (1.0 - _LEAST_GAIN), at, sizes // 2)
        better = least < best
        best = np.where(better, least, best)
        best_axis = np.where(better, number, best_axis)
        best_at = np.where(better, at, best_at)
    return best_axis, best_at


def _segmented_max(values: Doubles, shift: Doubles) -> Doubles:
    """Running maximum of ``values`` in [0, 1/2] that restarts where the whole ``shift`` grows."""
    return np.asarray(np.maximum.accumulate(values + shift) - shift)


def _half_area(extent: list[Doubles]) -> Doubles:
    x, y, z = extent
    return np.asarray(x * y + y * z + z * x)


def _partition(
    axes: list[Indices], sizes: Indices, axis: Indices, at: Indices, n: int
) -> list[Indices]:
    """Split every node's stretch of the three sorted orders in two, keeping the order."""
    first = np.cumsum(sizes) - sizes
    owner = np.repeat(np.arange(len(sizes)), sizes)
    rank = np.arange(len(owner)) - first[owner]
    goes_left = np.empty(n, np.bool_)
    for number, refs in enumerate(axes):
        mine = axis[owner] == number
        goes_left[refs[mine]] = rank[mine] < at[owner[mine]]
    result = []
    for refs in axes:
        left = goes_left[refs]
        lefts_before: Indices = np.cumsum(left) - left
        lefts_before = lefts_before - lefts_before[first][owner]
        place = np.where(left, lefts_before, at[owner] + rank - lefts_before) + first[owner]
        moved = np.empty_like(refs)
        moved[place] = refs
        result.append(moved)
    return result


def _bounds(
    lower: Floats,
    upper: Floats,
    order: Indices,
    left: Indices,
    start: Indices,
    level_starts: list[int],
) -> tuple[Floats, Floats]:
    """Bounds of every node, from the leaves up."""
    node_lower = np.empty((len(left), 3), np.float32)
    node_upper = np.empty((len(left), 3), np.float32)
    leaves = np.flatnonzero(left < 0)
    node_lower[leaves] = lower[order[start[leaves]]]
    node_upper[leaves] = upper[order[start[leaves]]]
    for first, end in reversed(list(pairwise(level_starts))):
        inner = first + np.flatnonzero(left[first:end] >= 0)
        child = left[inner]
        node_lower[inner] = np.minimum(node_lower[child], node_lower[child + 1])
        node_upper[inner] = np.maximum(node_upper[child], node_upper[child + 1])
    return node_lower, node_upper
