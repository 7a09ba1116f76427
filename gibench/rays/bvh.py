"""The wide bounding volume hierarchy that kernels_cl/common/bvh.cl traverses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.errors import BadInput
from gibench.progress import progress
from gibench.rays.bvh_sah import BinaryTree, build_binary
from gibench.rays.bvh_wide import WIDTH, WideTree, blocks_of, collapse

NODE_FLOATS = 7 * WIDTH
"""Lower x, upper x, lower y, ..., upper z of the children, then the children (int32)."""
BLOCK_FLOATS = 10 * WIDTH
"""Corner 0 x, y, z, corner 1, corner 2 of WIDTH triangles, then their scene indices (int32)."""
STACK_ENTRIES = 128
"""Nodes that a ray's traversal can keep for later."""
BVH_MACROS = {
    "BVH_STACK": STACK_ENTRIES,
    "BVH_NODE_FLOATS": NODE_FLOATS,
    "BVH_BLOCK_FLOATS": BLOCK_FLOATS,
}
"""Of every program that includes kernels_cl/common/bvh.cl."""

# A node visit takes one entry off the stack and puts up to WIDTH on it.
_MAX_DEPTH = (STACK_ENTRIES - 1) // (WIDTH - 1)
# Wide enough apart that the first is never needed by a real scene.
_MEDIAN_DEPTHS = (40, 16, 0)


@dataclass(frozen=True)
class Bvh:
    """A built tree.

    Attributes:
        nodes: (w, NODE_FLOATS) float32; a child is the number of a node, or, negative, the
            complement of 4 * (first block) + (blocks - 1) of a leaf. Missing children have
            lower = inf, upper = -inf.
        blocks: (b, BLOCK_FLOATS) float32; missing triangles are degenerate.
        triangle_count: triangles in the scene.
        depth: levels of nodes.
        sah_cost: expected node visits plus weighted block tests of a ray that meets the root box.
        node_visits: expected node visits of such a ray.
        block_tests: expected block tests of such a ray.
    """

    nodes: Floats = field(repr=False)
    blocks: Floats = field(repr=False)
    triangle_count: int
    depth: int
    sah_cost: float
    node_visits: float
    block_tests: float

    @property
    def node_count(self) -> int:
        """Number of wide nodes."""
        return len(self.nodes)

    @property
    def block_count(self) -> int:
        """Number of leaf blocks."""
        return len(self.blocks)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return self.nodes.nbytes + self.blocks.nbytes


def build_bvh(corners: Floats) -> Bvh:
    """Build the tree over triangles ``corners``, (t, 3, 3) float32, m.

    Raises:
        BadInput: a corner is not finite.
    """
    corners = np.ascontiguousarray(corners, np.float32).reshape(-1, 3, 3)
    if not np.isfinite(corners).all():
        bad = int(np.count_nonzero(~np.isfinite(corners).all(axis=(1, 2))))
        raise BadInput(f"{bad} triangles have corners that are not finite")
    if not len(corners):
        return Bvh(_empty_nodes(1), np.zeros((1, BLOCK_FLOATS), np.float32), 0, 1, 0.0, 1.0, 0.0)
    with progress("Building the ray tracing tree") as advance:
        lower, upper = corners.min(axis=1), corners.max(axis=1)
        for median_depth in _MEDIAN_DEPTHS:
            tree = build_binary(lower, upper, median_depth)
            wide = collapse(tree)
            advance(1)
            if wide.depth <= _MAX_DEPTH:
                break
        return _assemble(corners, tree, wide)


def _empty_nodes(count: int) -> Floats:
    nodes = np.zeros((count, 7, WIDTH), np.float32)
    nodes[:, 0:6:2] = np.inf
    nodes[:, 1:6:2] = -np.inf
    return nodes.reshape(count, NODE_FLOATS)


def _assemble(corners: Floats, tree: BinaryTree, wide: WideTree) -> Bvh:
    """Write nodes and leaf blocks as the kernel reads them."""
    used = wide.kind > 0
    leaf = wide.kind == 1
    source = np.where(used, wide.source, 0)
    nodes = _empty_nodes(len(wide.kind)).reshape(-1, 7, WIDTH)
    for axis in range(3):
        nodes[:, 2 * axis] = np.where(used, tree.lower[source, axis], np.inf)
        nodes[:, 2 * axis + 1] = np.where(used, tree.upper[source, axis], -np.inf)
    leaves = wide.source[leaf]
    count = tree.count[leaves]
    blocks = blocks_of(count)
    first_block = np.cumsum(blocks) - blocks
    child = wide.child.copy()
    child[leaf] = ~(4 * first_block + blocks - 1).astype(np.int32)
    nodes[:, 6] = np.where(used, child, 0).astype(np.int32).view(np.float32)
    return Bvh(
        nodes.reshape(-1, NODE_FLOATS),
        _blocks(corners, tree.order, tree.start[leaves], count, first_block, int(blocks.sum())),
        len(corners),
        wide.depth,
        wide.cost,
        wide.node_visits,
        wide.block_tests,
    )


def _blocks(
    corners: Floats,
    order: Ints,
    start: Ints,
    count: Ints,
    first_block: npt.NDArray[np.integer],
    total: int,
) -> Floats:
    within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    triangle = order[np.repeat(start, count) + within]
    lane = np.repeat(first_block, count) * WIDTH + within
    blocks = np.zeros((total, 10, WIDTH), np.float32)
    of_block, in_block = np.divmod(lane, WIDTH)
    blocks[of_block, :9, in_block] = corners[triangle].reshape(-1, 9)
    ids = np.full((total, WIDTH), -1, np.int32)
    ids[of_block, in_block] = triangle
    blocks[:, 9] = ids.view(np.float32)
    return blocks.reshape(total, BLOCK_FLOATS)
