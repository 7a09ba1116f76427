"""What a trace says of any GPU: pure functions of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from mmap import PAGESIZE

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Longs
from gibench.trace import waves
from gibench.trace.facts import CACHE_BYTES, SIMD_WIDTHS, AccessFacts, LaunchFacts, SimdFacts
from gibench.trace.reuse import reuse_misses
from gibench.trace.streams import WaveStreams
from gibench.trace.trace import Trace

_STREAM = 24 << 20
"""Sectors that are kept at most."""


@dataclass
class _Formed:
    """Sums of every group (g, ...) at one width, and the sectors of its global requests."""

    waves: Longs
    lanes: Longs
    sums: Longs
    where: Longs
    strides: Longs
    atomics: list[Longs]
    streams: list[Longs]
    waits: list[Longs]


def analyse(
    trace: Trace, widths: Sequence[int] = SIMD_WIDTHS, caches: Sequence[int] = ()
) -> LaunchFacts:
    """What ``trace`` says; its memory traffic at the first of ``widths``.

    Args:
        trace: of a launch.
        widths: lanes of a wave.
        caches: bytes of caches whose traffic is told besides that of ``CACHE_BYTES``.
    """
    formed = [_form(trace, simd) for simd in widths]
    first = formed[0]
    scale = trace.total_groups / len(trace.groups)
    per_group = first.lanes @ trace.tables.instructions
    sizes = sorted({*CACHE_BYTES, *caches})
    traffic = _traffic(trace, first, sizes)
    moved = dict(zip(sizes, traffic.dram, strict=True))
    addresses = np.concatenate([np.zeros(0, np.int64), *_apart(trace, first.atomics)])
    most = int(np.unique(addresses, return_counts=True)[1].max(initial=0))
    sampled = len(trace.groups) * trace.request.items
    return LaunchFacts(
        groups=trace.total_groups,
        traced=len(trace.groups),
        items=trace.request.items,
        local_bytes=trace.local_bytes,
        simd=tuple(_simd_facts(trace, f, w) for f, w in zip(formed, widths, strict=True)),
        flops=float((first.lanes @ trace.tables.flops).sum()) * scale,
        instructions=float(per_group.sum()) * scale,
        instructions_error=_error(trace, per_group, np.ones(len(per_group)))
        / max(float(per_group.mean()), 1e-30),
        dram_bytes=tuple(moved[size] for size in CACHE_BYTES),
        requested_bytes=traffic.requested,
        atomics=len(addresses) * scale,
        atomics_per_address=most,
        private_per_item=float(first.sums[:, :, waves.PRIVATE].sum()) / sampled,
        outside=int(first.sums[:, :, waves.OUTSIDE].sum()),
        reuse=traffic.reuse,
        cold=traffic.cold,
        behind=tuple(moved[size] for size in caches),
    )


def _apart(trace: Trace, atomics: Sequence[Longs]) -> list[Longs]:
    """Addresses of atomics by group, those in local memory told apart by their group."""
    start, end = (each[trace.ranges.is_local] for each in (trace.ranges.start, trace.ranges.end))
    found = []
    for group, addresses in enumerate(atomics):
        inside = (addresses[:, None] >= start) & (addresses[:, None] < end)
        found.append(np.where(inside.any(axis=1), addresses + ((group + 1) << 48), addresses))
    return found


def _form(trace: Trace, simd: int) -> _Formed:
    tables, ranges, items = trace.tables, trace.ranges, trace.request.items
    groups, blocks, accesses = len(trace.groups), len(tables.accesses), len(tables.kind)
    # To the end of the last buffer's page: what follows in it belongs to no buffer.
    buffers = ranges.is_given & ~ranges.is_local
    low = int(ranges.start[buffers].min(initial=1 << 62))
    high = -(-int(ranges.end[buffers].max(initial=0)) // PAGESIZE) * PAGESIZE
    formed = _Formed(
        np.zeros((groups, blocks), np.int64),
        np.zeros((groups, blocks), np.int64),
        np.zeros((groups, accesses, waves.COLUMNS), np.int64),
        np.full(accesses, -1, np.int64),
        np.zeros((accesses, 3), np.int64),
        [],
        [],
        [],
    )
    stream = np.empty(1 << 20, np.int64)
    atomics = np.empty(1 << 16, np.int64)
    starts = np.concatenate([[0], trace.ends[:-1]])
    room = _STREAM
    instructions = np.rint(tables.instructions).astype(np.int64)
    for group in range(groups):
        own = slice(group * items, (group + 1) * items)
        wave_ends = np.zeros(-(-items // simd), np.int64)
        while True:
            # Sums of their own, added once everything fitted.
            parts = (
                np.zeros(blocks, np.int64),
                np.zeros(blocks, np.int64),
                np.zeros((accesses, waves.COLUMNS), np.int64),
            )
            strides = formed.strides.copy()
            waits = np.zeros((len(wave_ends), waves.WAITS), np.int64)
            used, count = waves.form_waves(
                *(trace.words, starts[own], trace.ends[own], simd),
                *(tables.accesses, tables.first_access, tables.post_dominator),
                *(tables.kind, tables.nbytes, instructions, trace.chains),
                *(ranges.start, ranges.end, ranges.is_local, ranges.is_constant, low, high),
                *(*parts, formed.where, strides, atomics, stream, wave_ends, waits),
            )
            if used <= len(stream) and count <= len(atomics):
                break
            stream = np.empty(max(used, len(stream)), np.int64)
            atomics = np.empty(max(count, len(atomics)), np.int64)
        formed.waves[group], formed.lanes[group], formed.sums[group] = parts
        formed.strides = strides
        formed.atomics.append(atomics[:count].copy())
        formed.waits.append(waits)
        merged = np.empty(used, np.int64)
        waves.interleave(stream, wave_ends, merged)
        formed.streams.append(merged[:room])
        room = max(0, room - used)
    return formed


def _simd_facts(trace: Trace, formed: _Formed, simd: int) -> SimdFacts:
    column = formed.sums.sum(axis=1).astype(float)  # (groups, COLUMNS)
    instructions = trace.tables.instructions
    busy = formed.lanes @ instructions
    issued = formed.waves @ instructions * simd
    lines, fewest = column[:, waves.LINES], column[:, waves.FEWEST_LINES]
    return SimdFacts(
        simd=simd,
        lines_over_fewest=_ratio(lines, fewest),
        sectors_over_fewest=_ratio(column[:, waves.SECTORS], column[:, waves.FEWEST_SECTORS]),
        efficiency=_ratio(busy, issued),
        bank_conflicts=_ratio(column[:, waves.CYCLES], column[:, waves.FEWEST_CYCLES]),
        accesses=_access_facts(trace, formed),
        lines_error=_error(trace, lines, fewest),
        efficiency_error=_error(trace, busy, issued),
        in_a_row=float(np.concatenate(formed.waits)[:, waves.IN_A_ROW].mean()),
        batches=float(np.concatenate(formed.waits)[:, waves.BATCHES].mean()),
    )


def _access_facts(trace: Trace, formed: _Formed) -> tuple[AccessFacts, ...]:
    found = []
    for row, sums in enumerate(formed.sums.sum(axis=0)):
        if formed.where[row] < 0:
            continue
        stride, votes, pairs = (int(number) for number in formed.strides[row])
        found.append(
            AccessFacts(
                buffer=trace.ranges.names[formed.where[row]],
                kind=int(trace.tables.kind[row]),
                nbytes=int(trace.tables.nbytes[row]),
                requests=int(sums[waves.REQUESTS]),
                lines=int(sums[waves.LINES]),
                fewest_lines=int(sums[waves.FEWEST_LINES]),
                cycles=int(sums[waves.CYCLES]),
                fewest_cycles=int(sums[waves.FEWEST_CYCLES]),
                stride=stride if pairs and votes > pairs / 2 else None,
            )
        )
    return tuple(found)


@dataclass(frozen=True)
class _Traffic:
    dram: tuple[float, ...]
    requested: float
    reuse: Longs
    cold: int


def _traffic(trace: Trace, formed: _Formed, caches: Sequence[int]) -> _Traffic:
    """Bytes behind caches, first touches held to what the buffers have."""
    sizes = np.maximum(np.array(caches, np.int64) // waves.SECTOR, 1)
    again = np.zeros(len(sizes))
    reuse = np.zeros(64, np.int64)
    order = np.argsort(trace.ranges.start)
    starts, ends = trace.ranges.start[order], trace.ranges.end[order]
    first_reads = np.zeros(len(order))
    first_writes = np.zeros(len(order))
    cold = total = seen = 0
    for run in np.unique(trace.run):
        members = np.nonzero(trace.run == run)[0]
        words = np.concatenate([formed.streams[member] for member in members])
        sectors, places = np.unique(words >> 3, return_inverse=True)
        fetched, written, by_read, ever, histogram = reuse_misses(
            places, words, len(sectors), sizes
        )
        again += fetched + written
        reuse += histogram
        # The last byte of a sector lies in the buffer whose first byte may lie before it.
        of = np.searchsorted(starts, sectors * waves.SECTOR + waves.SECTOR - 1, "right")
        np.add.at(first_reads, of - 1, by_read)
        np.add.at(first_writes, of - 1, ever)
        cold += len(sectors)
        total += len(words)
        seen += len(members)
    scale = trace.total_groups / max(seen, 1)
    most = -(-(ends - starts) // waves.SECTOR)
    once = np.minimum(first_reads * scale, most) + np.minimum(first_writes * scale, most)
    dram = (again * scale + once.sum()) * waves.SECTOR
    return _Traffic(tuple(dram.tolist()), total * scale * waves.SECTOR, reuse, cold)


def _ratio(above: npt.ArrayLike, below: npt.ArrayLike) -> float:
    under = float(np.sum(below))
    return float(np.sum(above)) / under if under else float("nan")


def _error(trace: Trace, above: Doubles, below: Doubles) -> float:
    """The standard error of a ratio of sums over runs of groups, by the jackknife (Efron and Stein
    1981); NaN of a single run, 0 where the whole launch was traced.
    """
    if len(trace.groups) == trace.total_groups:
        return 0.0
    runs = np.unique(trace.run)
    if len(runs) < 2:
        return float("nan")
    left_out = np.array([_ratio(above[trace.run != run], below[trace.run != run]) for run in runs])
    n = len(runs)
    return float(np.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum()))


def wave_streams(trace: Trace, simd: int) -> WaveStreams:
    """What the traced groups ask of memory, as waves of ``simd`` lanes."""
    formed = _form(trace, simd)
    is_global = ~trace.ranges.is_local & ~trace.ranges.is_constant
    start, end = trace.ranges.start[is_global], trace.ranges.end[is_global]
    order = np.argsort(start)
    first = start[order] // waves.SECTOR
    addresses = np.concatenate([np.zeros(0, np.int64), *formed.atomics])
    low, high = int(start.min(initial=1 << 62)), int(end.max(initial=0))
    addresses = addresses[(addresses >= low) & (addresses < high)]
    most = int(np.unique(addresses, return_counts=True)[1].max(initial=0))
    return WaveStreams(
        label=trace.request.label,
        simd=simd,
        total_groups=trace.total_groups,
        items=trace.request.items,
        local_bytes=trace.local_bytes,
        words=np.concatenate([np.zeros(0, np.int64), *formed.streams]),
        kept=1,
        ends=np.cumsum([len(each) for each in formed.streams]).astype(np.int64),
        run=trace.run,
        buffer_start=first,
        buffer_sectors=-(-(end - start)[order] // waves.SECTOR),
        sectors=formed.sums[:, :, waves.SECTORS].sum(axis=1),
        requests=formed.sums[:, :, waves.REQUESTS].sum(axis=1),
        local_cycles=formed.sums[:, :, waves.CYCLES].sum(axis=1),
        flops=formed.lanes @ trace.tables.flops,
        waits=np.concatenate(formed.waits),
        atomics_on_one=most * trace.total_groups / len(trace.groups),
        outside=int(formed.sums[:, :, waves.OUTSIDE].sum()),
    )
