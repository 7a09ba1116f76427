"""Work that never differs, timed between frames: what of it takes longer, the machine did."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from gibench.device import Device, Launch, ProgramSpec, scalar, unsigned, writes
from gibench.measure.statistics.worst import BESIDE_PER_FRAME

_GROUP, _ITEMS_PER_UNIT = 8, 64
_FIRST_TURNS = 2000
_REPEATS = 10
LEAST_MS, MOST_MS = 0.25, 50.0


class ConstantWork:
    """Multiply-adds in registers on all cores of the device, a quarter of a frame long.

    It touches no memory that a frame has in a cache. Its one small buffer is the harness's and not
    counted against the profile.

    Args:
        frame_ms: median length of a frame.
        cl_device: executes.

    Raises:
        CannotRun: the device cannot allocate its buffer.
    """

    def __init__(self, frame_ms: float, cl_device: Any = None) -> None:
        self._device = device = Device.unlimited(cl_device)
        self._items = int(device.cl_device.max_compute_units) * _ITEMS_PER_UNIT
        # Kept: a kernel does not keep the buffers of its arguments alive.
        self._out = device.empty("constant_work", self._items * device.vector_width, np.float32)
        wanted = float(np.clip(frame_ms / BESIDE_PER_FRAME, LEAST_MS, MOST_MS))
        self._launch = self._prepare(_FIRST_TURNS)
        self()  # it may compile
        took = min(self() for _ in range(_REPEATS))
        self._launch = self._prepare(max(1, round(_FIRST_TURNS * wanted / took)))

    def __call__(self) -> float:
        """Do it; wall time, ms."""
        queue = self._device.queue
        begin = time.perf_counter_ns()
        self._launch.enqueue(queue)
        queue.finish()
        return (time.perf_counter_ns() - begin) * 1e-6

    def _prepare(self, turns: int) -> Any:
        program = ProgramSpec("measure/roofs.cl", {"VEC": self._device.vector_width})
        args = (
            writes("out", self._out),
            scalar("factor", np.float32(0.5)),
            unsigned("turns", turns),
            unsigned("count", self._items),
        )
        launch = Launch(program, "roof_fma", args, items=self._items, workgroup_size=_GROUP)
        return self._device.prepare(launch, _GROUP)
