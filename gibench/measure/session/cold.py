"""Emptying the caches between frames."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gibench.device import (
    Device,
    Launch,
    ProgramSpec,
    reads,
    scalar,
    unsigned,
    updates,
)
from gibench.profiles import DeviceProfile

_GROUP = 8  # work-items: small, so that all cores are busy
MOST_BYTES = 256 << 20
"""A virtual machine reports the whole last-level cache of its host, of which it has a share: more
than this is not streamed (10 ms a frame at 25 GB/s)."""


@dataclass(frozen=True)
class ColdFacts:
    """What is streamed between frames.

    Attributes:
        streamed_bytes: per flush, read and written.
        cache_bytes: of the last-level cache as the device reports it.
        covered: whether all of that is covered twice.
    """

    streamed_bytes: int
    cache_bytes: int
    covered: bool

    def record(self) -> dict[str, Any]:
        """As ``run.json`` has it."""
        return asdict(self)


class CacheFlush:
    """Streams through a buffer larger than the last-level cache, on the device's own cores.

    The buffer is the harness's and not counted against the profile.

    Args:
        profile: of the run.
        cl_device: whose caches are emptied.

    Raises:
        CannotRun: the device cannot allocate the buffer.
    """

    def __init__(self, profile: DeviceProfile, cl_device: Any = None) -> None:
        self._device = Device.unlimited(cl_device)
        width = self._device.vector_width
        cache = int(self._device.cl_device.global_mem_cache_size)
        wanted = max(2 * cache, 32 << 20)
        count = min(wanted, MOST_BYTES) // (4 * width)
        items = int(self._device.cl_device.max_compute_units) * 64
        stretch = -(-count // items)
        # Kept: a kernel does not keep the buffers of its arguments alive.
        self._buffer = self._device.empty("flush", count * width, np.float32)
        self.facts = ColdFacts(self._buffer.nbytes, cache, wanted <= MOST_BYTES)
        program = ProgramSpec("measure/roofs.cl", {"VEC": width})
        # a = a + 0 * a: every line is read and written back.
        args = (
            updates("a", self._buffer),
            reads("b", self._buffer),
            reads("c", self._buffer),
            scalar("scalar", np.float32(0.0)),
            unsigned("count", count),
            unsigned("stretch", stretch),
        )
        triad = Launch(program, "roof_triad", args, items=items)
        self._launch = self._device.prepare(triad, _GROUP)

    def __call__(self) -> None:
        """Empty the caches; returns when it is done."""
        queue = self._device.queue
        self._launch.enqueue(queue)
        queue.finish()
