"""What sampled groups ask of memory as waves of one width, for caches to be modelled with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Longs

_BLOCK = 8
"""Sectors of a block that is kept or left out whole: 256 bytes, the longest line."""
_WORDS = 1 << 19
"""Sectors of a stream; of longer ones a share of all blocks is kept, chosen by a hash of the
address (Waldspurger et al. 2015, "Efficient MRC Construction with SHARDS").
"""


@dataclass(frozen=True)
class WaveStreams:
    """What sampled groups (n) of a launch do as waves (n * w).

    Attributes:
        label: of the kernel.
        simd: lanes of a wave.
        total_groups: of the launch.
        items: of a group.
        local_bytes: of a group.
        words: sectors of all requests, group by group, a group's waves in turns: ``sector << 3 |
            writes << 2 | reads << 1 | starts a request``; a share of them.
        kept: one block of addresses in so many is in ``words``.
        ends: where each group's words end (n,).
        run: the run of adjacent groups that each belongs to (n,).
        buffer_start: first sector of every buffer (b,), ascending.
        buffer_sectors: of every buffer (b,).
        sectors: of all requests of every group (n,), none left out.
        requests: of every group (n,).
        local_cycles: turns of local memory's banks of every group (n,).
        flops: of every group (n,).
        waits: of every wave, see :mod:`gibench.trace.waves` (n * w, WAITS).
        atomics_on_one: most atomics on one global address, of the whole launch.
        outside: accesses that lie in no buffer.
    """

    label: str
    simd: int
    total_groups: int
    items: int
    local_bytes: int
    words: Longs
    kept: int
    ends: Longs
    run: Longs
    buffer_start: Longs
    buffer_sectors: Longs
    sectors: Longs
    requests: Longs
    local_cycles: Longs
    flops: Doubles
    waits: Longs
    atomics_on_one: float
    outside: int

    @property
    def waves(self) -> int:
        """Waves of a group."""
        return -(-self.items // self.simd)

    def run_of(self, run: int) -> WaveStreams:
        """The groups of one run alone."""
        mine = np.nonzero(self.run == run)[0]
        starts = np.concatenate([[0], self.ends[:-1]])[mine]
        parts = [self.words[a:b] for a, b in zip(starts, self.ends[mine], strict=True)]
        waits = self.waits.reshape(len(self.run), self.waves, -1)[mine]
        return replace(
            self,
            words=np.concatenate([np.zeros(0, np.int64), *parts]),
            ends=np.cumsum([len(part) for part in parts]).astype(np.int64),
            run=self.run[mine],
            sectors=self.sectors[mine],
            requests=self.requests[mine],
            local_cycles=self.local_cycles[mine],
            flops=self.flops[mine],
            waits=waits.reshape(-1, waits.shape[-1]),
        )


def thinned(streams: WaveStreams, most: int = _WORDS) -> WaveStreams:
    """The streams with at most about ``most`` words: one block of addresses in a power of two."""
    kept = 1
    while len(streams.words) > most * kept and kept < 16:
        kept *= 2
    if kept == 1:
        return streams
    chosen = _chosen(streams.words, kept)
    before = np.concatenate([[0], np.cumsum(chosen)])
    ends = before[streams.ends]
    return replace(streams, words=streams.words[chosen], ends=ends.astype(np.int64), kept=kept)


def _chosen(words: Longs, kept: int) -> npt.NDArray[np.bool_]:
    """Whether each word's block is kept; Fibonacci hashing (Knuth 1998, section 6.4)."""
    blocks = ((words >> 3) // _BLOCK).astype(np.uint64)
    hashed = (blocks * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    chosen: npt.NDArray[np.bool_] = hashed % np.uint64(kept) == 0
    return chosen
