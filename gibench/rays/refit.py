"""Refitting a tree: which of its nodes and triangles to visit when some triangles move.

The tree keeps its shape, and only bounds follow the triangles: hits are exact whatever moves, but
the further triangles move apart that were close when the tree was built, the more its boxes overlap
and the longer rays take. Nothing here rebuilds it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Ints
from gibench.rays.bvh import Bvh
from gibench.rays.bvh_wide import WIDTH


@dataclass(frozen=True)
class RefitPlan:
    """What kernels_cl/rays/refit.cl visits, made once from the tree as it was built.

    Attributes:
        triangle_slots: (n,) int32 where each moving triangle lies: WIDTH * block + lane, ascending.
        node_slots: (s,) int32 the children with a moving triangle beneath: WIDTH * node + child,
            those of the deepest nodes first.
        levels: first entry of each level in ``node_slots`` and their number, deepest first.
        leaf_blocks: blocks of the leaves among them.
        inner: how many of them are nodes.
    """

    triangle_slots: Ints = field(repr=False)
    node_slots: Ints = field(repr=False)
    levels: tuple[tuple[int, int], ...]
    leaf_blocks: int
    inner: int

    @staticmethod
    def of(bvh: Bvh, moving: npt.NDArray[np.bool_]) -> RefitPlan:
        """The plan for ``bvh`` where the triangles ``moving`` (t,) move."""
        ids = bvh.blocks.reshape(-1, 10, WIDTH)[:, 9].view(np.int32)
        moves = (ids >= 0) & np.append(moving, False)[ids]  # -1 is the last: no triangle
        nodes = bvh.nodes.reshape(-1, 7, WIDTH)
        child = nodes[:, 6].view(np.int32)
        inner = (nodes[:, 0] < np.inf) & (child >= 0)
        leaf = (nodes[:, 0] < np.inf) & (child < 0)
        first, blocks = ~child >> 2, (~child & 3) + 1
        before = np.concatenate([[0], np.cumsum(moves.any(axis=1))])
        touched = np.zeros(child.shape, np.bool_)
        touched[leaf] = before[(first + blocks)[leaf]] > before[first[leaf]]
        slots, levels, at = [], [], 0
        for level in reversed(_levels(child, inner)):
            below = inner[level]
            touched[level] |= below & touched[np.where(below, child[level], 0)].any(axis=2)
            number, slot = np.nonzero(touched[level])
            if len(number):
                slots.append(WIDTH * level[number] + slot)
                levels.append((at, len(number)))
                at += len(number)
        return RefitPlan(
            np.flatnonzero(moves).astype(np.int32),
            np.concatenate([np.empty(0, np.int64), *slots]).astype(np.int32),
            tuple(levels),
            int(blocks[leaf & touched].sum()),
            int(np.count_nonzero(inner & touched)),
        )


def _levels(
    child: npt.NDArray[np.int32], inner: npt.NDArray[np.bool_]
) -> list[npt.NDArray[np.int64]]:
    """The nodes of every level, from the root down."""
    level = np.zeros(1, np.int64)
    levels = []
    while len(level):
        levels.append(level)
        level = child[level][inner[level]].astype(np.int64)
    return levels
