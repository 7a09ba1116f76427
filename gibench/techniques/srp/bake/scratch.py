"""What a worker of the transport's bake keeps between chunks: device memory, and a clock."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.device import Buffer, Device


@dataclass
class Timings:
    """Seconds spent and rays traced in each part of the work."""

    seconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, part: str, since: float, count: int = 0) -> float:
        """Book the time ``since`` to ``part``; returns now."""
        now = perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - since
        self.counts[part] = self.counts.get(part, 0) + count
        return now


class Scratch:
    """Named device buffers that grow as more is asked for.

    Args:
        device: holds them; for one thread at a time.
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self._held: dict[str, Buffer] = {}

    def __getitem__(self, name: str) -> Buffer:
        return self._held[name]

    def room(self, name: str, nbytes: int) -> Buffer:
        """A buffer of at least ``nbytes``, kept until more is asked for."""
        held = self._held.get(name)
        if held is None or held.nbytes < nbytes:
            if held is not None:
                self.device.release(held)
            held = self.device.empty(name, max(nbytes, 16), np.uint8)
            self._held[name] = held
        return held

    def send(self, name: str, array: npt.NDArray[Any]) -> Buffer:
        """The buffer ``name`` with the bytes of ``array``."""
        buffer = self.room(name, array.nbytes)
        self.device.write_bytes(buffer, array)
        return buffer

    def fetch(self, buffer: Buffer, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Any:
        """What ``buffer`` begins with."""
        out = np.empty(shape, dtype)
        self.device.read_into(buffer, out)
        return out
