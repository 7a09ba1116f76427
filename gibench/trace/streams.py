"""What sampled groups ask of memory as waves of one width, for caches to be modelled with.

Kept on disk by a hash of what was traced: a launch is traced once, whatever it is projected on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Longs
from gibench.trace.request import Sampling, TraceRequest

VERSION = 1
"""Of what is kept: another one makes traces anew."""
SAMPLING = Sampling(runs=3, length=24, words=16 << 20, seconds=5.0, unroll=True)
"""Runs long enough that groups which share a unit and its caches are in them."""
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


def streams_of(
    request: TraceRequest,
    widths: Sequence[int],
    cache: Path | None = None,
    sampling: Sampling = SAMPLING,
) -> dict[int, WaveStreams]:
    """The streams of a launch at several widths, traced where they are not in the cache.

    Args:
        request: what is launched.
        widths: lanes of a wave, at most 64 each.
        cache: where traces are kept; None keeps none.
        sampling: how much is traced.

    Raises:
        GibenchError: it cannot be traced, or faults.
    """
    key = request_key(request, sampling) if cache is not None else ""
    found: dict[int, WaveStreams] = {}
    missing = []
    for width in dict.fromkeys(widths):
        kept = None if cache is None else _kept(cache / f"trace-{key}-{width}.npz")
        if kept is None:
            missing.append(width)
        else:
            found[width] = kept
    if missing:
        from gibench.trace.analysis import wave_streams
        from gibench.trace.trace import trace_launch

        trace = trace_launch(request, sampling)
        for width in missing:
            found[width] = thinned(wave_streams(trace, width))
            if cache is not None:
                _keep(cache / f"trace-{key}-{width}.npz", found[width])
    return found


def request_key(request: TraceRequest, sampling: Sampling) -> str:
    """A hash of everything that a trace depends on."""
    digest = hashlib.sha256(
        repr(
            (
                *(VERSION, sampling, request.source, sorted(request.defines.items())),
                *(request.kernel, request.items, request.groups),
            )
        ).encode()
    )
    for each in request.args:
        digest.update(repr((each.name, each.nbytes, each.written)).encode())
        if each.data is not None:
            data = np.ascontiguousarray(each.data)
            digest.update(repr((data.dtype.str, data.shape)).encode())
            digest.update(data.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()[:32]


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


def _kept(path: Path) -> WaveStreams | None:
    if not path.is_file():
        return None
    try:
        with np.load(path) as stored:
            values: dict[str, Any] = {}
            for each in fields(WaveStreams):
                value = stored[each.name]
                values[each.name] = value.item() if value.ndim == 0 else value
    except (OSError, ValueError, KeyError):
        return None  # cut short by a crash: traced anew
    return WaveStreams(**values)


def _keep(path: Path, streams: WaveStreams) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial.npz")
    np.savez_compressed(
        partial, **{each.name: getattr(streams, each.name) for each in fields(streams)}
    )
    partial.replace(path)
