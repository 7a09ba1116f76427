"""The reference's OpenCL kernels on the host CPU, sharing memory with Embree.

The truth is not computed under a device profile: it runs on whatever CPU there is, on arrays that
NumPy, Embree and OpenCL see alike (``USE_HOST_PTR``, which CPU runtimes do not copy).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pyopencl as cl

from gibench.device import build_program, kernel_source, list_devices, vector_width
from gibench.errors import CannotRun

GROUP = 256


@dataclass(frozen=True)
class Shared:
    """An array that the host and the kernels both see; the queue must be idle when the host does.

    Attributes:
        array: the host's view.
        buffer: the kernels' view.
    """

    array: npt.NDArray[Any] = field(repr=False)
    buffer: Any = field(repr=False)


@dataclass(frozen=True)
class HostProgram:
    """The built kernels, their queue, work-items per group, and vertices that a work-item of the
    drawing kernels treats at once.
    """

    context: Any = field(repr=False)
    queue: Any = field(repr=False)
    kernels: dict[str, Any] = field(repr=False)
    group: int = GROUP
    lanes: int = 1

    def share(self, array: npt.NDArray[Any]) -> Shared:
        """Show an array to the kernels; an empty one as a single element nobody reads."""
        held = np.ascontiguousarray(array)
        if held.size == 0:
            held = np.zeros(1, held.dtype)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
        return Shared(held, cl.Buffer(self.context, flags, hostbuf=held))

    def empty(self, shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> Shared:
        """A new shared array, not initialised."""
        return self.share(np.empty(shape, dtype))

    def run(self, name: str, count: int, *arguments: Any) -> None:
        """Enqueue a kernel over ``count`` work-items, rounded up to whole groups."""
        values = [a.buffer if isinstance(a, Shared) else a for a in arguments]
        size = -(-count // self.group) * self.group
        self.kernels[name](self.queue, (size,), (self.group,), *values)


@cache
def host_program(group: int = GROUP) -> HostProgram:
    """The reference kernels, built once per process on the first CPU device.

    Raises:
        CannotRun: no OpenCL runtime for the CPU is installed.
    """
    device = _cpu()
    context, lanes = cl.Context([device]), vector_width(device)
    defines = {"GROUP": group, "VEC": lanes}
    built = build_program(context, kernel_source("reference/path.cl"), defines)
    kernels = {kernel.function_name: kernel for kernel in built.all_kernels()}
    return HostProgram(context, cl.CommandQueue(context), kernels, group, lanes)


def _cpu() -> Any:
    """The first CPU among the devices.

    Raises:
        CannotRun: no OpenCL runtime for the CPU is installed.
    """
    for device in list_devices():
        if device.type & cl.device_type.CPU and device.host_unified_memory:
            return device
    raise CannotRun(
        "the reference needs an OpenCL runtime for the CPU and found none",
        mend='install PoCL: pip install "pyopencl[pocl]"',
    )
