"""Caches of a device, simulated: an L1 a unit, an L2 that all share, waves of all units in turns.

Sets with least recently used replacement, lines of sectors that are fetched one by one. Writes pass
L1 by and stay in L2 until they are pushed out. Not modelled: prefetching, misses that wait for each
other, pages.
"""

# What numba compiles has no types that mypy could check.
# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-untyped-call, assignment"

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from gibench.trace.streams import WaveStreams

SECTOR = 32
"""Bytes of a sector of the streams."""
_L1_WAYS, _L2_WAYS = 8, 16
# Columns of what is counted.
LINES, TO_L2, AGAIN, WRITTEN, HIT_L1, HIT_L2, MISSED, MISSED_FIRST = range(8)
COLUMNS = 8


@dataclass(frozen=True)
class CacheSizes:
    """Caches as they are simulated.

    Attributes:
        units: that are simulated, each with its L1.
        resident: groups on a unit at once.
        l1_bytes: of a unit.
        l2_bytes: that the simulated units share.
        line_bytes: of both.
        sector_bytes: fetched at least.
    """

    units: int
    resident: int
    l1_bytes: int
    l2_bytes: int
    line_bytes: int
    sector_bytes: int


@dataclass(frozen=True)
class Traffic:
    """What the simulated groups ask of each level, of all of them together.

    Attributes:
        lines: lookups of lines in L1.
        l2_bytes: fetched from L2, or written to it.
        again_bytes: fetched from DRAM though they were touched before.
        written_bytes: pushed out of L2 to DRAM, or left in it at the end.
        first_bytes: of every buffer (b,), fetched from DRAM as they are touched for the first time.
        load_share: of requests that load: those that L1, L2, DRAM answers (3,), and those of
            DRAM that are first touches.
    """

    lines: float
    l2_bytes: float
    again_bytes: float
    written_bytes: float
    first_bytes: np.ndarray
    load_share: tuple[float, float, float, float]


def simulate(streams: WaveStreams, sizes: CacheSizes) -> Traffic:
    """Run the groups of one run through caches.

    Args:
        streams: of one run of adjacent groups, dealt to the units in turns.
        sizes: of the caches; a stream of which a share of addresses is left out meets caches
            smaller by the same share.
    """
    per = sizes.sector_bytes // SECTOR
    sectors = streams.words >> 3
    distinct, places = np.unique(sectors // per, return_inverse=True)
    starts = np.concatenate([[0], streams.ends[:-1]]).astype(np.int64)
    sums = np.zeros(COLUMNS)
    first = np.zeros(len(distinct), np.bool_)
    lines = sizes.line_bytes // sizes.sector_bytes
    _simulate(
        *(streams.words, places.astype(np.int64), distinct, starts, streams.ends),
        *(sizes.units, sizes.resident, lines),
        *(_sets(sizes.l1_bytes, sizes.line_bytes, streams.kept, _L1_WAYS), _L1_WAYS),
        *(_sets(sizes.l2_bytes, sizes.line_bytes, streams.kept, _L2_WAYS), _L2_WAYS),
        *(sums, first),
    )
    of = np.searchsorted(streams.buffer_start, distinct * per + per - 1, "right") - 1
    first_bytes = np.bincount(
        np.maximum(of[first], 0), minlength=max(1, len(streams.buffer_start))
    ).astype(np.float64)
    scale = streams.kept * sizes.sector_bytes
    loads = max(float(sums[HIT_L1] + sums[HIT_L2] + sums[MISSED]), 1.0)
    return Traffic(
        lines=float(sums[LINES]) * streams.kept,
        l2_bytes=float(sums[TO_L2]) * scale,
        again_bytes=float(sums[AGAIN]) * scale,
        written_bytes=float(sums[WRITTEN]) * scale,
        first_bytes=first_bytes * scale,
        load_share=(
            float(sums[HIT_L1]) / loads,
            float(sums[HIT_L2]) / loads,
            float(sums[MISSED]) / loads,
            float(sums[MISSED_FIRST]) / loads,
        ),
    )


def _sets(nbytes: int, line: int, kept: int, ways: int) -> int:
    return max(1, round(nbytes / (line * kept * ways)))


@njit(cache=True)
def _find(tags, used, base, ways, line, clock):  # pragma: no cover
    """The way that holds a line, or minus one less the way that is to give way to it."""
    oldest, place = used[base], 0
    for way in range(ways):
        if tags[base + way] == line:
            used[base + way] = clock
            return way
        if used[base + way] < oldest:
            oldest, place = used[base + way], way
    return -1 - place


@njit(cache=True)
def _set(line, sets):  # pragma: no cover
    """The set of a line: its upper bits are folded in, as GPUs hash addresses."""
    return (line ^ (line >> 7) ^ (line >> 15)) % sets


@njit(cache=True)
def _simulate(
    words,
    places,
    distinct,
    starts,
    ends,
    units,
    resident,
    per_line,
    l1_sets,
    l1_ways,
    l2_sets,
    l2_ways,
    sums,
    first,
):  # pragma: no cover
    groups = len(starts)
    l1_tags = np.full(units * l1_sets * l1_ways, -1, np.int64)
    l1_used = np.zeros(len(l1_tags), np.int64)
    l1_valid = np.zeros(len(l1_tags), np.int64)
    l2_tags = np.full(l2_sets * l2_ways, -1, np.int64)
    l2_used = np.zeros(len(l2_tags), np.int64)
    l2_valid = np.zeros(len(l2_tags), np.int64)
    l2_dirty = np.zeros(len(l2_tags), np.int64)
    seen = np.zeros(len(distinct), np.bool_)
    current = np.full((units, resident), -1, np.int64)
    at = np.zeros((units, resident), np.int64)
    following, alive, clock = 0, 0, 0
    for slot in range(resident):
        for unit in range(units):
            if following < groups:
                current[unit, slot], at[unit, slot] = following, starts[following]
                following += 1
                alive += 1
    while alive > 0:
        for slot in range(resident):
            for unit in range(units):
                group = current[unit, slot]
                if group < 0:
                    continue
                i = at[unit, slot]
                if i >= ends[group]:
                    if following < groups:
                        current[unit, slot], at[unit, slot] = following, starts[following]
                        following += 1
                    else:
                        current[unit, slot] = -1
                        alive -= 1
                    continue
                last_line, last, worst, loads = -1, -1, 0, False
                while True:  # one request
                    word = words[i]
                    sector = distinct[places[i]]
                    reads, writes = word & 2, word & 4
                    line = sector // per_line
                    bit = 1 << (sector % per_line)
                    if line != last_line:
                        sums[0] += 1
                        last_line = line
                    if sector != last:
                        last = sector
                        clock += 1
                        level = 2
                        if reads and not writes:
                            base = (unit * l1_sets + _set(line, l1_sets)) * l1_ways
                            way = _find(l1_tags, l1_used, base, l1_ways, line, clock)
                            if way < 0:
                                way = -1 - way
                                l1_tags[base + way], l1_used[base + way] = line, clock
                                l1_valid[base + way] = 0
                            if l1_valid[base + way] & bit:
                                level = 1
                            l1_valid[base + way] |= bit
                        if level == 2:
                            sums[1] += 1
                            base = _set(line, l2_sets) * l2_ways
                            way = _find(l2_tags, l2_used, base, l2_ways, line, clock)
                            if way < 0:
                                way = -1 - way
                                dirty = l2_dirty[base + way]
                                while dirty:
                                    sums[3] += dirty & 1
                                    dirty >>= 1
                                l2_tags[base + way], l2_used[base + way] = line, clock
                                l2_valid[base + way] = 0
                                l2_dirty[base + way] = 0
                            if not l2_valid[base + way] & bit:
                                level = 3
                                if reads:
                                    if seen[places[i]]:
                                        sums[2] += 1
                                    else:
                                        first[places[i]] = True
                                        level = 4
                            l2_valid[base + way] |= bit
                            if writes:
                                l2_dirty[base + way] |= bit
                        seen[places[i]] = True
                        if reads:
                            loads = True
                            worst = max(worst, level)
                    i += 1
                    if i >= ends[group] or words[i] & 1:
                        break
                at[unit, slot] = i
                if loads:
                    if worst == 1:
                        sums[4] += 1
                    elif worst == 2:
                        sums[5] += 1
                    else:
                        sums[6] += 1
                        sums[7] += worst == 4
    for i in range(len(l2_dirty)):
        dirty = l2_dirty[i]
        while dirty:
            sums[3] += dirty & 1
            dirty >>= 1
