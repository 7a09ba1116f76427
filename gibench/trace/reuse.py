"""Reuse distances of a stream of sectors, and what caches of given sizes would fetch of it."""

# What numba compiles has no types that mypy could check.
# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-untyped-call, assignment"

from __future__ import annotations

import numpy as np
from numba import njit

from gibench.trace.waves import READS, WRITES


@njit(cache=True)
def reuse_misses(places, words, distinct, sizes):  # pragma: no cover
    """Sectors that fully associative LRU caches fetch and write back.

    Reuse distances by a Fenwick tree over time (Bennett and Kruskal 1975, "LRU Stack Processing").

    Args:
        places: number of every word's sector (n,), 0 to distinct - 1.
        words: of the stream (n,).
        distinct: number of sectors.
        sizes: of the caches, in sectors, ascending (s,).

    Returns:
        Fetches (s,), write-backs (s,) that are no first touch; sectors first touched by a read
        (distinct,), sectors ever written (distinct,); reuses by distance: power of two (64,).
    """
    count = len(words)
    tree = np.zeros(count + 1, np.int64)
    last = np.full(distinct, -1, np.int64)
    dirty = np.zeros(distinct, np.int64)
    fetched = np.zeros(len(sizes), np.int64)
    written = np.zeros(len(sizes), np.int64)
    cold = np.zeros(distinct, np.bool_)
    ever = np.zeros(distinct, np.bool_)
    histogram = np.zeros(64, np.int64)
    every = (1 << len(sizes)) - 1
    for time in range(count):
        place, before = places[time], last[places[time]]
        reads, writes = words[time] & READS, words[time] & WRITES
        if before < 0:
            cold[place] = reads != 0
        else:
            distance = 0
            i = time
            while i > 0:
                distance += tree[i]
                i -= i & -i
            i = before + 1
            while i > 0:
                distance -= tree[i]
                i -= i & -i
            power = 0
            while (1 << power) <= distance:
                power += 1
            histogram[power] += 1
            for s in range(len(sizes)):
                if distance < sizes[s]:
                    break
                if reads:
                    fetched[s] += 1
                dirty[place] &= ~(1 << s)
            i = before + 1
            while i <= count:
                tree[i] -= 1
                i += i & -i
        if writes:
            if not ever[place]:
                ever[place] = True
            else:
                for s in range(len(sizes)):
                    if not dirty[place] & (1 << s):
                        written[s] += 1
            dirty[place] = every
        i = time + 1
        while i <= count:
            tree[i] += 1
            i += i & -i
        last[place] = time
    return fetched, written, cold, ever, histogram
