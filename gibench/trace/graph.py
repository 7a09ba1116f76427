"""Where lanes that parted meet again: immediate post-dominators of a kernel's blocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Longs


def post_dominators(successors: Sequence[Sequence[int]]) -> Longs:
    """The immediate post-dominator (n,) of every block; ``n`` stands for the end of the kernel.

    By the iteration of Cooper, Harvey and Kennedy 2001, "A Simple, Fast Dominance Algorithm",
    figure 3, on the graph turned round. A block from which no way leads to the end (a loop without
    one) has the end for its post-dominator.

    Args:
        successors: of every block; a block without any ends the kernel.
    """
    count = len(successors)
    after = [list(each) or [count] for each in successors]
    before: list[list[int]] = [[] for _ in range(count + 1)]
    for block, nexts in enumerate(after):
        for each in nexts:
            before[each].append(block)
    order = _post_order(before, count)
    rank = {block: place for place, block in enumerate(order)}
    found: dict[int, int] = {count: count}
    changed = True
    while changed:
        changed = False
        for block in reversed(order[:-1]):
            known = [each for each in after[block] if each in found]
            meet = known[0]
            for each in known[1:]:
                while each != meet:
                    if rank[each] < rank[meet]:
                        each = found[each]
                    else:
                        meet = found[meet]
            if found.get(block) != meet:
                found[block] = meet
                changed = True
    return np.array([found.get(block, count) for block in range(count)], np.int64)


def _post_order(edges: Sequence[Sequence[int]], root: int) -> list[int]:
    """Depth-first post-order from ``root``, which comes last."""
    order: list[int] = []
    seen, stack = {root}, [(root, iter(edges[root]))]
    while stack:
        node, rest = stack[-1]
        following = next((each for each in rest if each not in seen), None)
        if following is None:
            order.append(node)
            stack.pop()
        else:
            seen.add(following)
            stack.append((following, iter(edges[following])))
    return order
