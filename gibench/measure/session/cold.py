"""Emptying the caches between frames."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pyopencl as cl

from gibench.device import Device
from gibench.profiles import DeviceProfile

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
        lifted = replace(profile, memory_budget_bytes=1 << 40, max_buffer_bytes=1 << 40)
        self._device = Device(lifted, cl_device)
        width = self._device.vector_width
        cache = int(self._device.cl_device.global_mem_cache_size)
        wanted = max(2 * cache, 32 << 20)
        count = min(wanted, MOST_BYTES) // (4 * width)
        self._items = int(self._device.cl_device.max_compute_units) * 64
        stretch = -(-count // self._items)
        # Kept: a kernel does not keep the buffers of its arguments alive.
        self._buffer = self._device.empty("flush", count * width, np.float32)
        self.facts = ColdFacts(self._buffer.nbytes, cache, wanted <= MOST_BYTES)
        self._kernel = self._device.program("measure/roofs.cl", {"VEC": width}).kernel("roof_triad")
        # a = a + 0 * a: every line is read and written back.
        self._kernel.set_args(
            *(self._buffer.mem, self._buffer.mem, self._buffer.mem),
            *(np.float32(0.0), np.uint32(count), np.uint32(stretch)),
        )

    def __call__(self) -> None:
        """Empty the caches; returns when it is done."""
        queue = self._device.queue
        cl.enqueue_nd_range_kernel(queue, self._kernel, (self._items,), (8,))
        queue.finish()
