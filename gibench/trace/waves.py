"""Work-items in lockstep: waves formed from a trace, and what each of their accesses touches.

Lanes that part at a branch meet again at its immediate post-dominator, each side running on its own
meanwhile (Fung et al. 2007, "Dynamic Warp Formation and Scheduling", section 2). An access of more
than 16 bytes a lane is several requests, as on every GPU.
"""

# What numba compiles has no types that mypy could check.
# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-untyped-call, assignment"

from __future__ import annotations

import numpy as np
from numba import njit

LINE, SECTOR, REQUEST = 64, 32, 16
"""Bytes of a cache line, of a sector (the least that DRAM gives) and of a lane's request."""
BANKS, WORD = 32, 4
"""Banks of local memory and bytes of their words (32 of 4 bytes on the GPUs of the profiles)."""

# Columns of the sums of an access.
REQUESTS, LANES, LINES, FEWEST_LINES, SECTORS, FEWEST_SECTORS = range(6)
CYCLES, FEWEST_CYCLES, PRIVATE, OUTSIDE = range(6, 10)
COLUMNS = 10
# Columns of what a wave waits for: instructions issued; global loads in a row by the values they
# need; batches of global loads, and of local ones, block by block; accesses of private memory.
ISSUED, IN_A_ROW, BATCHES, LOCAL_BATCHES, SPILLED = range(5)
WAITS = 5
# A word of the stream: sector << 3 | writes << 2 | reads << 1 | starts a request.
STARTS, READS, WRITES = 1, 2, 4


@njit(cache=True)
def _sorted(values, count):  # pragma: no cover
    """Sort the first ``count`` values in place: they come nearly sorted."""
    for i in range(1, count):
        value = values[i]
        j = i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = value


@njit(cache=True)
def _counted(lanes, count, sums, row):  # pragma: no cover
    """Count a request of ``count`` lanes, which are then sorted; returns its distinct addresses."""
    _sorted(lanes, count)
    distinct = 1
    for i in range(1, count):
        distinct += lanes[i] != lanes[i - 1]
    sums[row, REQUESTS] += 1
    sums[row, LANES] += count
    return distinct


@njit(cache=True)
def _request(lanes, count, width, kind, base, local, sums, row, stream, used):  # pragma: no cover
    """One request of ``count`` lanes of ``width`` bytes each; returns the stream's new length."""
    distinct = _counted(lanes, count, sums, row)
    if local:
        banks = np.zeros(BANKS, np.int64)
        last = np.int64(-1)
        words = 0
        for i in range(count):
            first = (lanes[i] - base) // WORD
            for word in range(first, (lanes[i] - base + width - 1) // WORD + 1):
                if word > last:
                    banks[word % BANKS] += 1
                    words += 1
                    last = word
        sums[row, CYCLES] += banks.max()
        sums[row, FEWEST_CYCLES] += (words + BANKS - 1) // BANKS
        return used
    asked = distinct * width
    last, line, starts = np.int64(-1), np.int64(-1), np.int64(STARTS)
    how = (READS if kind != 1 else 0) | (WRITES if kind != 0 else 0)
    for i in range(count):
        for sector in range(lanes[i] // SECTOR, (lanes[i] + width - 1) // SECTOR + 1):
            if sector <= last:
                continue
            last = sector
            sums[row, SECTORS] += 1
            if sector * SECTOR // LINE != line:
                line = sector * SECTOR // LINE
                sums[row, LINES] += 1
            if used < len(stream):
                stream[used] = (sector << 3) | how | starts
            used += 1
            starts = 0
    sums[row, FEWEST_LINES] += (asked + LINE - 1) // LINE
    sums[row, FEWEST_SECTORS] += (asked + SECTOR - 1) // SECTOR
    return used


@njit(cache=True)
def _constant(lanes, count, width, sums, row):  # pragma: no cover
    """A load of constant memory; returns the issue slots that it takes. Where all lanes read one
    address it is as fast as a register, else each address has its turn (NVIDIA, "CUDA C++ Best
    Practices Guide", "Constant Memory").
    """
    distinct = _counted(lanes, count, sums, row)
    return 0 if distinct == 1 else distinct * ((width + REQUEST - 1) // REQUEST)


@njit(cache=True)
def _wait(
    block,
    accesses,
    first_access,
    kinds,
    chains,
    before,
    came,
    is_global,
    depth,
    value,
    floor,
    waits,
):  # pragma: no cover
    """A wave runs a block: add to what it waits for, return from when its next block may run."""
    for way in range(chains.phis[block], chains.phis[block + 1]):
        value[way] = -1
        for i in range(came):
            if before[i] == chains.phi_from[way]:
                value[way] = 0
                start, count = chains.phi_value[way]
                for node in chains.nodes[start : start + count]:
                    value[way] = max(value[way], depth[node])
    # All phis of a block take their values at once.
    for way in range(chains.phis[block], chains.phis[block + 1]):
        if value[way] >= 0:
            depth[chains.phi_node[way]] = 0
    for way in range(chains.phis[block], chains.phis[block + 1]):
        if value[way] >= 0:
            node = chains.phi_node[way]
            depth[node] = max(depth[node], value[way])
    in_global, in_local, fence = np.int64(0), np.int64(0), 0
    for number in range(accesses[block]):
        row = first_access[block] + number
        if kinds[row] == 1:
            continue
        if chains.fence[row] != fence:
            fence = chains.fence[row]
            floor = max(floor, waits[IN_A_ROW])
        at = floor
        start, count = chains.address[row]
        for node in chains.nodes[start : start + count]:
            at = max(at, depth[node])
        depth[row] = at + (1 if is_global[number] == 1 else 0)
        waits[IN_A_ROW] = max(waits[IN_A_ROW], depth[row])
        bit = np.int64(1) << min(chains.batch[row], 62)
        if is_global[number] == 1:
            in_global |= bit
        elif is_global[number] == 0:
            in_local |= bit
    in_local &= ~in_global
    while in_global:
        waits[BATCHES] += in_global & 1
        in_global >>= 1
    while in_local:
        waits[LOCAL_BATCHES] += in_local & 1
        in_local >>= 1
    start, count = chains.control[block]
    for node in chains.nodes[start : start + count]:
        floor = max(floor, depth[node])
    return max(floor, waits[IN_A_ROW]) if chains.barrier[block] else floor


@njit(cache=True)
def form_waves(
    words,
    starts,
    ends,
    simd,
    accesses,
    first_access,
    post_dominator,
    kinds,
    widths,
    instructions,
    chains,
    range_start,
    range_end,
    range_local,
    range_constant,
    span_low,
    span_high,
    block_waves,
    block_lanes,
    sums,
    where,
    strides,
    atomics,
    stream,
    wave_ends,
    wave_waits,
):  # pragma: no cover
    """Form the waves of one group.

    Args:
        words: the record.
        starts: where each item's words begin (n,).
        ends: where they end (n,).
        simd: lanes of a wave, at most 64.
        accesses: to post_dominator: of the tables.
        first_access: of every block.
        post_dominator: of every block.
        kinds: of every access.
        widths: bytes of every access.
        instructions: issue slots of every block.
        chains: which loads wait for which.
        range_start: of buffers and local memory.
        range_end: behind them.
        range_local: whether a range is local memory.
        range_constant: whether a constant cache serves it.
        span_low: where global memory begins.
        span_high: where it ends: an address in it and in no range is outside every buffer.
        block_waves: added to: waves that ran a block (b,).
        block_lanes: added to: lanes that ran it (b,).
        sums: added to: of every access (a, COLUMNS).
        where: the range that an access was last seen in (a,).
        strides: a vote on the distance of neighbouring lanes (a, 3): distance, votes, pairs.
        atomics: takes the addresses of atomics, as far as they fit.
        stream: takes the sectors of all global requests.
        wave_ends: where each wave's end in the stream (waves,).
        wave_waits: what each wave waits for (waves, WAITS).

    Returns:
        Sectors and atomics; more than fit where there was no room.
    """
    items, end_block = len(starts), len(accesses)
    used, atomic_count = 0, 0
    at = np.zeros(simd, np.int64)
    stop = np.zeros(simd, np.int64)
    pc = np.zeros(1024, np.int64)
    meet = np.zeros(1024, np.int64)
    mask = np.zeros((1024, simd), np.bool_)
    lanes = np.zeros(simd, np.int64)
    piece = np.zeros(simd, np.int64)
    following = np.zeros(simd, np.int64)
    last = np.zeros(simd, np.int64)
    before = np.zeros(simd, np.int64)
    is_global = np.zeros(max(1, accesses.max()), np.int64)
    depth = np.zeros(chains.size[0], np.int64)
    value = np.zeros(len(chains.phi_node), np.int64)
    for wave in range((items + simd - 1) // simd):
        low = wave * simd
        count = min(simd, items - low)
        depth[:] = 0
        floor = 0
        for lane in range(count):
            at[lane], stop[lane] = starts[low + lane], ends[low + lane]
            last[lane] = -1
        pc[0] = -1 - words[at[0]]
        meet[0] = end_block
        for lane in range(simd):
            mask[0, lane] = lane < count
        top = 0
        while top >= 0:
            block = pc[top]
            if block == meet[top] or block == end_block:
                top -= 1
                continue
            active, came = 0, 0
            for lane in range(simd):
                if not mask[top, lane]:
                    continue
                active += 1
                new = True
                for i in range(came):
                    new = new and before[i] != last[lane]
                if new:
                    before[came] = last[lane]
                    came += 1
                last[lane] = block
            block_waves[block] += 1
            block_lanes[block] += active
            wave_waits[wave, ISSUED] += instructions[block]
            for number in range(accesses[block]):
                row = first_access[block] + number
                is_global[number] = -1
                n = 0
                for lane in range(simd):
                    if mask[top, lane]:
                        lanes[n] = words[at[lane] + 1 + number]
                        n += 1
                found = -1
                for r in range(len(range_start)):
                    if range_start[r] <= lanes[0] < range_end[r]:
                        found = r
                        break
                if found < 0:
                    is_outside = span_low <= lanes[0] < span_high
                    sums[row, OUTSIDE if is_outside else PRIVATE] += n
                    wave_waits[wave, SPILLED] += not is_outside
                    continue
                where[row] = found
                is_global[number] = 0 if range_local[found] else 1
                kept = 0
                for i in range(n):  # lanes of another memory or outside are left out
                    if range_start[found] <= lanes[i] < range_end[found] or (
                        not range_local[found] and span_low <= lanes[i] < span_high
                    ):
                        if not range_start[found] <= lanes[i] < range_end[found]:
                            inside = False
                            for r in range(len(range_start)):
                                inside |= range_start[r] <= lanes[i] < range_end[r]
                            if not inside:
                                sums[row, OUTSIDE] += 1
                                continue
                        lanes[kept] = lanes[i]
                        kept += 1
                for i in range(1, kept):
                    stride = lanes[i] - lanes[i - 1]
                    strides[row, 2] += 1
                    if strides[row, 1] == 0:
                        strides[row, 0] = stride
                    strides[row, 1] += 1 if strides[row, 0] == stride else -1
                if range_constant[found]:
                    is_global[number] = -1
                    taken = _constant(lanes, kept, widths[row], sums, row)
                    counted = max(1, (widths[row] + REQUEST - 1) // REQUEST)
                    wave_waits[wave, ISSUED] += taken - counted
                    continue
                if kinds[row] == 2:
                    for i in range(kept):
                        if atomic_count < len(atomics):
                            atomics[atomic_count] = lanes[i]
                        atomic_count += 1
                left, offset = widths[row], 0
                while left > 0:
                    width = min(left, REQUEST)
                    for i in range(kept):
                        piece[i] = lanes[i] + offset
                    used = _request(
                        piece, kept, width, kinds[row], range_start[found], range_local[found],
                        sums, row, stream, used,
                    )  # fmt: skip
                    left -= width
                    offset += width
            floor = _wait(
                block, accesses, first_access, kinds, chains, before, came, is_global, depth,
                value, floor, wave_waits[wave],
            )  # fmt: skip
            alike, next_block = True, -1
            for lane in range(simd):
                if mask[top, lane]:
                    at[lane] += 1 + accesses[block]
                    following[lane] = -1 - words[at[lane]] if at[lane] < stop[lane] else end_block
                    if next_block < 0:
                        next_block = following[lane]
                    alike = alike and following[lane] == next_block
            if alike:
                pc[top] = next_block
                continue
            together = post_dominator[block]
            parted = top
            if together == meet[top]:
                top -= 1  # the lanes below wait there already
            else:
                pc[top] = together
            for lane in range(simd):
                # mask[parted] may be overwritten below only from the row that replaces it.
                piece[lane] = 1 if mask[parted, lane] else 0
            for lane in range(simd):
                if piece[lane] == 1 and following[lane] != together:
                    top += 1
                    pc[top], meet[top] = following[lane], together
                    target = following[lane]
                    for other in range(simd):
                        goes = piece[other] == 1 and following[other] == target
                        mask[top, other] = goes
                        if goes:
                            piece[other] = 0
        wave_ends[wave] = used
    return used, atomic_count


@njit(cache=True)
def interleave(stream, wave_ends, out):  # pragma: no cover
    """Merge the waves of a group, a request of each in turn, into ``out``."""
    waves = len(wave_ends)
    at = np.zeros(waves, np.int64)
    for wave in range(1, waves):
        at[wave] = wave_ends[wave - 1]
    used, left = 0, True
    while left:
        left = False
        for wave in range(waves):
            if at[wave] >= wave_ends[wave]:
                continue
            left = True
            while True:
                out[used] = stream[at[wave]]
                used += 1
                at[wave] += 1
                if at[wave] >= wave_ends[wave] or stream[at[wave]] & STARTS:
                    break
    return used
