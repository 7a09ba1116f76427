"""Buffers counted against a profile's memory budget."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.errors import CannotRun
from gibench.profiles import DeviceProfile


@dataclass(frozen=True)
class Buffer:
    """A device buffer with the shape and type of what it holds.

    Attributes:
        name: what it holds; unique within its group in the ledger.
        shape: logical shape.
        dtype: element type.
        mem: the ``pyopencl.Buffer``.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    mem: Any = field(repr=False, compare=False)

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return int(np.prod(self.shape, dtype=np.int64)) * self.dtype.itemsize


@dataclass(frozen=True)
class SharedBuffer(Buffer):
    """A buffer in the host's own memory.

    Attributes:
        array: the host's view; the queue must be idle when the host looks.
    """

    array: npt.NDArray[Any] = field(repr=False, compare=False)


@dataclass
class MemoryLedger:
    """Counts every allocation against the profile's budget and largest buffer.

    Attributes:
        profile: whose budget binds.
        allocated: bytes of every live buffer, by name.
        peak_bytes: the most that was ever live at once.
    """

    profile: DeviceProfile
    allocated: dict[str, int] = field(default_factory=dict)
    peak_bytes: int = 0

    @property
    def total_bytes(self) -> int:
        """Bytes live now."""
        return sum(self.allocated.values())

    def reserve(self, name: str, nbytes: int) -> None:
        """Count ``nbytes`` for the buffer ``name``, before it is allocated.

        Raises:
            CannotRun: the buffer or the total would not fit; says the bytes asked and there.
        """
        if name in self.allocated:
            raise ValueError(f"a buffer called '{name}' is already allocated")
        profile = self.profile
        if nbytes > profile.max_buffer_bytes:
            raise CannotRun(
                f"buffer '{name}' asks for {nbytes:,} bytes; profile {profile.name} allows "
                f"{profile.max_buffer_bytes:,} in one buffer",
                mend="lower --receivers, --probes or --sh-order, or pass --fit",
            )
        if self.total_bytes + nbytes > profile.memory_budget_bytes:
            there = profile.memory_budget_bytes - self.total_bytes
            raise CannotRun(
                f"buffer '{name}' asks for {nbytes:,} bytes; {there:,} of profile "
                f"{profile.name}'s {profile.memory_budget_bytes:,} are left",
                mend="lower --receivers, --probes or --sh-order, or pass --fit",
            )
        self.allocated[name] = nbytes
        self.peak_bytes = max(self.peak_bytes, self.total_bytes)

    def release(self, name: str) -> None:
        """Forget the buffer ``name``."""
        del self.allocated[name]
