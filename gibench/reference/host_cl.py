"""The reference's OpenCL kernels on the host CPU, sharing memory with Embree.

The truth is not computed under a device profile: it runs on whatever CPU there is, on arrays that
NumPy, Embree and OpenCL see alike (:class:`gibench.device.SharedBuffer`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pyopencl as cl

from gibench.device import Argument, Device, Launch, ProgramSpec, SharedBuffer, list_devices
from gibench.device.build import Define
from gibench.device.selection import first_device
from gibench.errors import CannotRun
from gibench.reference.packed import RECORD_MACROS

GROUP = 256


@dataclass(frozen=True)
class HostProgram:
    """The reference's kernels on a device without limits.

    Attributes:
        device: where they run.
        program: what they are built from.
        group: work-items per group.
        lanes: vertices that a work-item of the drawing kernels treats at once.
    """

    device: Device = field(repr=False)
    program: ProgramSpec
    group: int = GROUP
    lanes: int = 1

    @property
    def queue(self) -> Any:
        """The device's queue."""
        return self.device.queue

    def share(self, array: npt.NDArray[Any]) -> SharedBuffer:
        """Show an array to the kernels; an empty one as a single element nobody reads."""
        return self.device.share("reference", array)

    def empty(self, shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> SharedBuffer:
        """A new shared array, not initialised."""
        return self.share(np.empty(shape, dtype))

    def run(self, name: str, count: int, *arguments: Argument) -> None:
        """Enqueue a kernel over ``count`` work-items, rounded up to whole groups."""
        self.device.enqueue(Launch(self.program, name, arguments, items=count), self.group)


@cache
def host_program(
    group: int = GROUP,
    cutouts: bool = False,
    glow: bool = False,
    normal_maps: bool = False,
    scale: float = 1.0,
) -> HostProgram:
    """The reference kernels, built once per process on the first CPU device.

    Args:
        group: work-items per group.
        cutouts: for scenes with cut-outs.
        glow: for scenes with triangles that emit by images.
        normal_maps: for shading by normal maps.
        scale: of the distance by which rays leave surfaces near the origin.

    Raises:
        CannotRun: no OpenCL runtime for the CPU is installed.
    """
    device = Device.unlimited(_cpu())
    return program_on(
        device, group, cutouts=cutouts, glow=glow, normal_maps=normal_maps, scale=scale
    )


def program_on(
    device: Device,
    group: int = GROUP,
    *,
    cutouts: bool = False,
    glow: bool = False,
    normal_maps: bool = False,
    scale: float = 1.0,
) -> HostProgram:
    """The reference kernels on a device that shares the host's memory; see :func:`host_program`."""
    lanes = device.vector_width
    defines: dict[str, Define] = {**RECORD_MACROS, "GROUP": group, "VEC": lanes, "RAY_SCALE": scale}
    defines |= {"CUTOUTS": 1} if cutouts else {}
    defines |= {"GLOW": 1} if glow else {}
    defines |= {"NORMAL_MAPS": 1} if normal_maps else {}
    program = ProgramSpec("reference/path.cl", defines)
    return HostProgram(device, program, group, lanes)


def _cpu() -> Any:
    """The first CPU among the devices; that of PYOPENCL_CTX where it is one.

    Raises:
        CannotRun: no OpenCL runtime for the CPU is installed.
    """
    for device in [first_device(), *list_devices()]:
        if device.type & cl.device_type.CPU and device.host_unified_memory:
            return device
    raise CannotRun(
        "the reference needs an OpenCL runtime for the CPU and found none",
        mend='install PoCL: pip install "pyopencl[pocl]"',
    )
