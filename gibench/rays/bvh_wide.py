"""Collapsing a binary tree to the wide tree of least expected cost.

The dynamic programme of Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal on GPUs
Through Compressed Wide BVHs", section 3.1, which chooses at once what becomes a wide node, which
binary nodes vanish and where leaves are. Cost is the surface-area heuristic's: the chance that a
ray visits a node is its area over the root's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.rays.bvh_sah import BinaryTree

WIDTH = 8
"""Children of a node and triangles of a leaf block: the kernel's float8."""
MAX_LEAF_BLOCKS = 4

# Time of a leaf block's triangles over that of a node's boxes, as measured on PoCL (bench_rays).
_BLOCK_COST = 1.0

_EMPTY, _LEAF, _INNER = 0, 1, 2


@dataclass(frozen=True)
class WideTree:
    """A tree of nodes with up to WIDTH children, breadth first from the root, 0.

    Attributes:
        kind: (w, WIDTH) int8, 0 no child, 1 a leaf, 2 a node.
        source: (w, WIDTH) int32 binary node of each child.
        child: (w, WIDTH) int32 wide node of each child that is one.
        depth: levels of nodes.
        cost: expected node visits and block tests (weighted) of a ray that meets the root.
        node_visits: expected node visits of such a ray.
        block_tests: expected block tests of such a ray.
    """

    kind: npt.NDArray[np.int8] = field(repr=False)
    source: Ints = field(repr=False)
    child: Ints = field(repr=False)
    depth: int
    cost: float
    node_visits: float
    block_tests: float


def half_area(lower: Floats, upper: Floats) -> Floats:
    """Half the surface area of boxes (n, 3)."""
    x, y, z = (np.maximum(upper - lower, 0.0)).T
    return np.asarray(x * y + y * z + z * x, np.float32)


def blocks_of(count: Ints) -> Ints:
    """Leaf blocks that hold ``count`` (n,) triangles, (n,)."""
    return np.asarray(-(-count // WIDTH), np.int32)


def collapse(tree: BinaryTree) -> WideTree:
    """The wide tree of least expected cost."""
    area = half_area(tree.lower, tree.upper)
    is_leaf, split = _choose(tree, area)
    return _extract(tree, area, is_leaf, split)


def _choose(tree: BinaryTree, area: Floats) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.int8]]:
    """For every binary node: is it a leaf, and how its child slots are shared.

    Returns (m,) bool, and (m, WIDTH + 1) int8 where entry j says how many of j slots go to the left
    child; 0 when j slots are no better than j - 1.
    """
    m = len(tree.left)
    blocks = blocks_of(tree.count)
    leaf_cost = np.where(
        blocks <= MAX_LEAF_BLOCKS, area * blocks * np.float32(_BLOCK_COST), np.float32(np.inf)
    ).astype(np.float32)
    # cost[:, j - 1]: least cost of representing the node's subtree by up to j children.
    cost = np.repeat(leaf_cost[:, None], WIDTH - 1, axis=1)
    is_leaf = np.ones(m, np.bool_)
    split = np.zeros((m, WIDTH + 1), np.int8)
    for first, end in reversed(list(pairwise(tree.level_starts))):
        inner = first + np.flatnonzero(tree.left[first:end] >= 0)
        if not len(inner):
            continue
        left, right = cost[tree.left[inner]], cost[tree.left[inner] + 1]
        shared = np.empty((len(inner), WIDTH + 1), np.float32)
        for slots in range(2, WIDTH + 1):
            options = left[:, : slots - 1] + right[:, slots - 2 :: -1][:, : slots - 1]
            best = options.argmin(axis=1)
            split[inner, slots] = best + 1
            shared[:, slots] = np.take_along_axis(options, best[:, None], axis=1)[:, 0]
        as_node = shared[:, WIDTH] + area[inner]
        is_leaf[inner] = leaf_cost[inner] <= as_node
        cost[inner, 0] = np.minimum(leaf_cost[inner], as_node)
        for slots in range(2, WIDTH):
            worse = cost[inner, slots - 2] <= shared[:, slots]
            split[inner[worse], slots] = 0
            cost[inner, slots - 1] = np.minimum(cost[inner, slots - 2], shared[:, slots])
    return is_leaf, split


def _extract(
    tree: BinaryTree,
    area: Floats,
    is_leaf: npt.NDArray[np.bool_],
    split: npt.NDArray[np.int8],
) -> WideTree:
    """Walk the choices down from the root, all wide nodes of a level at once."""
    kinds: list[npt.NDArray[np.int8]] = []
    sources: list[Ints] = []
    children: list[Ints] = []
    made, depth = 1, 0
    roots = np.array([0], np.int64)
    visits, tests = 0.0, 0.0
    whole = max(float(area[0]), 1e-30)
    while len(roots):
        depth += 1
        visits += float(area[roots].sum(dtype=np.float64)) / whole
        owner, node = _children_of(tree, roots, is_leaf, split)
        # Largest last: any-hit traversal takes the last child first, the likeliest to block.
        by_area = np.lexsort((area[node], owner))
        owner, node = owner[by_area], node[by_area]
        slot = np.arange(len(owner)) - np.searchsorted(owner, owner)
        kind = np.zeros((len(roots), WIDTH), np.int8)
        source = np.full((len(roots), WIDTH), -1, np.int32)
        child = np.full((len(roots), WIDTH), -1, np.int32)
        leaf = is_leaf[node]
        kind[owner, slot] = np.where(leaf, _LEAF, _INNER)
        source[owner, slot] = node
        blocks = blocks_of(tree.count[node[leaf]])
        tests += float((area[node[leaf]].astype(np.float64) * blocks).sum()) / whole
        inner = np.flatnonzero(~leaf)
        child[owner[inner], slot[inner]] = made + np.arange(len(inner))
        made += len(inner)
        kinds.append(kind)
        sources.append(source)
        children.append(child)
        roots = node[inner]
    return WideTree(
        np.concatenate(kinds),
        np.concatenate(sources),
        np.concatenate(children),
        depth,
        visits + _BLOCK_COST * tests,
        visits,
        tests,
    )


def _children_of(
    tree: BinaryTree,
    roots: npt.NDArray[np.int64],
    is_leaf: npt.NDArray[np.bool_],
    split: npt.NDArray[np.int8],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Binary nodes that become children of the wide nodes at ``roots``: (owner, node)."""
    owner = np.arange(len(roots), dtype=np.int64)
    node = roots.copy()
    # A root that is a leaf by itself (a tiny scene) is its own only child.
    slots = np.where(is_leaf[roots], 1, WIDTH)
    done_owner: list[npt.NDArray[np.int64]] = []
    done_node: list[npt.NDArray[np.int64]] = []
    while len(node):
        single = slots == 1
        done_owner.append(owner[single])
        done_node.append(node[single])
        owner, node, slots = owner[~single], node[~single], slots[~single]
        to_left = split[node, slots].astype(np.int64)
        fewer = (to_left == 0) | (tree.left[node] < 0)
        left = tree.left[node].astype(np.int64)[~fewer]
        shared = to_left[~fewer]
        owner = np.concatenate([owner[fewer], owner[~fewer], owner[~fewer]])
        node = np.concatenate([node[fewer], left, left + 1])
        slots = np.concatenate([slots[fewer] - 1, shared, slots[~fewer] - shared])
    return np.concatenate(done_owner), np.concatenate(done_node)
