"""Simulated caches against a plain simulation in Python, and streams whose traffic is known."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
import pytest

from gibench.project.caches import SECTOR, CacheSizes, simulate
from gibench.trace.streams import WaveStreams, thinned

READ, WRITE = 3, 5
"""A request that reads, one that writes, of one sector."""


def streams(groups: list[list[int]], buffers: tuple[int, ...] = (1 << 20,)) -> WaveStreams:
    """Groups of one wave each; words are ``sector << 3 | how``."""
    starts = np.cumsum([0, *buffers[:-1]])
    n = len(groups)
    return WaveStreams(
        label="test", simd=32, total_groups=n, items=32, local_bytes=0,
        words=np.array([w for g in groups for w in g], np.int64), kept=1,
        ends=np.cumsum([len(g) for g in groups]), run=np.zeros(n, np.int64),
        buffer_start=starts, buffer_sectors=np.array(buffers),
        sectors=np.array([len(g) for g in groups]), requests=np.array([len(g) for g in groups]),
        local_cycles=np.zeros(n, np.int64), flops=np.zeros(n),
        waits=np.ones((n, 5), np.int64), atomics_on_one=0.0, outside=0,
    )  # fmt: skip


def plain(groups: list[list[int]], sizes: CacheSizes) -> dict[str, float]:
    """Fully associative caches of one unit that runs one group after the other."""
    l1, l2 = OrderedDict[int, set[int]](), OrderedDict[int, set[int]]()
    dirty: dict[int, set[int]] = {}
    seen = set[int]()
    per = sizes.line_bytes // sizes.sector_bytes
    rooms = (sizes.l1_bytes // sizes.line_bytes, sizes.l2_bytes // sizes.line_bytes)
    told = {"l2": 0, "first": 0, "again": 0, "written": 0}

    def look(cache: OrderedDict[int, set[int]], room: int, sector: int) -> bool:
        line = sector // per
        if line not in cache:
            if len(cache) == room:
                gone, _ = cache.popitem(last=False)
                if cache is l2:
                    told["written"] += len(dirty.pop(gone, ()))
            cache[line] = set()
        cache.move_to_end(line)
        hit = sector in cache[line]
        cache[line].add(sector)
        return hit

    for word in (w for g in groups for w in g):
        sector, writes = (word >> 3) * SECTOR // sizes.sector_bytes, word & 4
        if writes or not look(l1, rooms[0], sector):
            told["l2"] += 1
            if not look(l2, rooms[1], sector) and not writes:
                told["again" if sector in seen else "first"] += 1
            if writes:
                dirty.setdefault(sector // per, set()).add(sector)
        seen.add(sector)
    told["written"] += sum(len(each) for each in dirty.values())
    return told


@pytest.mark.parametrize("sector", (32, 64))
def test_one_unit_of_one_set_is_a_plain_lru(sector: int, rng: np.random.Generator) -> None:
    # 8 ways of L1 and 16 of L2 make one set each: fully associative.
    sizes = CacheSizes(1, 1, 8 * 128, 16 * 128, 128, sector)
    words = (rng.integers(0, 120, (3, 400)) << 3) | rng.choice(
        [READ, WRITE], (3, 400), p=(0.8, 0.2)
    )
    groups = words.tolist()
    found, told = simulate(streams(groups), sizes), plain(groups, sizes)
    assert found.l2_bytes == told["l2"] * sector
    assert found.again_bytes == told["again"] * sector
    assert found.first_bytes.sum() == told["first"] * sector
    assert found.written_bytes == told["written"] * sector
    assert found.lines == 1200
    assert sum(found.load_share[:3]) == pytest.approx(1)


def test_what_fits_is_fetched_once_and_what_does_not_every_time() -> None:
    once = [(s << 3) | READ for s in range(256)]  # 8 KB
    groups = [once * 4]
    fits = simulate(streams(groups), CacheSizes(1, 1, 16384, 1 << 20, 128, 32))
    assert fits.l2_bytes == 8192 and fits.again_bytes == 0 and fits.first_bytes.sum() == 8192
    small = simulate(streams(groups), CacheSizes(1, 1, 1024, 1 << 20, 128, 32))
    assert small.l2_bytes == 4 * 8192 and small.again_bytes == 0
    tiny = simulate(streams(groups), CacheSizes(1, 1, 1024, 2048, 128, 32))
    assert tiny.again_bytes == 3 * 8192


def test_units_have_an_l1_each_and_share_l2() -> None:
    once = [(s << 3) | READ for s in range(64)]
    groups = [list(once) for _ in range(8)]
    alone = simulate(streams(groups), CacheSizes(1, 1, 16384, 1 << 20, 128, 32))
    apart = simulate(streams(groups), CacheSizes(8, 1, 16384, 1 << 20, 128, 32))
    assert alone.l2_bytes == 2048 and apart.l2_bytes == 8 * 2048
    assert apart.first_bytes.sum() == alone.first_bytes.sum() == 2048


def test_first_touches_are_told_by_buffer() -> None:
    groups = [[(s << 3) | READ for s in (0, 5, 10, 11, 12, 30)]]
    found = simulate(streams(groups, (10, 20, 70)), CacheSizes(1, 1, 1024, 65536, 128, 32))
    assert found.first_bytes.tolist() == [64, 96, 32]


def test_a_share_of_addresses_says_what_all_do(rng: np.random.Generator) -> None:
    # Blocks of 256 bytes drawn by a power law: some are read again soon, most never.
    blocks = (rng.pareto(0.7, 120_000) * 40).astype(np.int64) % 40000
    words = ((blocks * 8 + rng.integers(0, 8, len(blocks))) << 3) | READ
    whole = streams([each.tolist() for each in np.split(words, 6)])
    few = thinned(whole, 30_000)
    assert few.kept == 4 and 0.1 < len(few.words) / len(whole.words) < 0.5
    assert few.ends[-1] == len(few.words)
    sizes = CacheSizes(2, 1, 16384, 262144, 128, 32)
    a, b = simulate(whole, sizes), simulate(few, sizes)
    assert b.first_bytes.sum() == pytest.approx(a.first_bytes.sum(), rel=0.1)
    # What a quarter of the blocks fetches again scatters by 3 %, and is some 3 % too much.
    assert b.again_bytes == pytest.approx(a.again_bytes, rel=0.25)
