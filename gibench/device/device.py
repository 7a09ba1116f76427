"""Opening an OpenCL device and holding it to a profile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
import numpy.typing as npt
import pyopencl as cl

from gibench.device.buffers import Buffer, MemoryLedger, nbytes_of
from gibench.device.build import Define, build_program, macro_options, vector_width
from gibench.device.pocl import name_processor
from gibench.device.source import kernel_source
from gibench.errors import BadInput, CannotRun, GibenchError
from gibench.profiles import DeviceProfile


def list_devices() -> list[Any]:
    """Every OpenCL device of every platform, PoCL's first.

    Raises:
        CannotRun: there is no OpenCL platform at all.
    """
    try:
        platforms = cl.get_platforms()
    except cl.LogicError as error:
        raise CannotRun(
            "no OpenCL platform was found",
            mend="install one: pip install 'pyopencl[pocl]' brings PoCL, which runs on any CPU",
        ) from error
    devices = [
        device
        for platform in sorted(platforms, key=lambda p: "Portable" not in p.name)
        for device in platform.get_devices()
    ]
    if not devices:
        raise CannotRun(
            "the OpenCL platforms found offer no device",
            mend="install one: pip install 'pyopencl[pocl]' brings PoCL, which runs on any CPU",
        )
    for device in devices:
        name_processor(device)
    return devices


@dataclass
class Program:
    """A built program; kernels are retrieved once and kept (each retrieval costs)."""

    source: str
    built: Any = field(repr=False)
    defines: Mapping[str, Define]

    def kernel(self, name: str) -> Any:
        """A new kernel object called ``name``, with arguments of its own.

        Raises:
            GibenchError: the program has no such kernel.
        """
        try:
            return cl.Kernel(self.built, name)
        except cl.Error as error:
            raise GibenchError(f"the program has no kernel '{name}' ({error})") from error


class Device:
    """An opened OpenCL device held to a profile's limits.

    Every buffer is counted in ``memory`` before it is allocated; every launch is checked against
    the profile's work-group size, SIMD multiple and local memory and against the kernel's own
    limits before it is enqueued (``launch_problem``).

    Args:
        profile: whose limits bind.
        cl_device: the device; by default the first of :func:`list_devices`.
        kernel_root: another kernel tree than the installed one.
    """

    def __init__(
        self,
        profile: DeviceProfile,
        cl_device: Any = None,
        kernel_root: Traversable | None = None,
    ) -> None:
        self.profile = profile
        self.cl_device = list_devices()[0] if cl_device is None else cl_device
        self.context = cl.Context([self.cl_device])
        self.queue = cl.CommandQueue(
            self.context, properties=cl.command_queue_properties.PROFILING_ENABLE
        )
        self.memory = MemoryLedger(profile)
        self.kernel_root = kernel_root
        self._programs: dict[tuple[str, tuple[str, ...]], Program] = {}

    @property
    def vector_width(self) -> int:
        """Floats per vector that suit this device: 16 with AVX-512, 8 with AVX, 1 on most GPUs."""
        return vector_width(self.cl_device)

    # -- buffers -----------------------------------------------------------------------------

    def empty(self, name: str, shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> Buffer:
        """A zero-filled buffer of ``shape`` and ``dtype``.

        Raises:
            CannotRun: it does not fit the profile, or the device itself cannot allocate it.
        """
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        buffer = self._allocate(name, shape, np.dtype(dtype))
        if buffer.nbytes:
            # Copied, not filled: Oclgrind takes no fill for an initialisation.
            cl.enqueue_copy(self.queue, buffer.mem, np.zeros(shape, buffer.dtype))
        return buffer

    def upload(self, name: str, array: npt.NDArray[Any]) -> Buffer:
        """A buffer that holds a copy of ``array``.

        Raises:
            CannotRun: it does not fit the profile, or the device itself cannot allocate it.
        """
        buffer = self._allocate(name, array.shape, array.dtype)
        if buffer.nbytes:
            cl.enqueue_copy(self.queue, buffer.mem, np.ascontiguousarray(array))
        return buffer

    def write(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Overwrite ``buffer`` from its start with ``array`` (converted to the buffer's type)."""
        data = np.ascontiguousarray(array, dtype=buffer.dtype)
        if data.nbytes > buffer.nbytes:
            raise ValueError(f"{data.nbytes} bytes do not fit buffer '{buffer.name}'")
        if data.nbytes:
            cl.enqueue_copy(self.queue, buffer.mem, data)

    def read(self, buffer: Buffer) -> npt.NDArray[Any]:
        """The content of ``buffer``, after everything enqueued before has finished."""
        out = np.empty(buffer.shape, buffer.dtype)
        if out.nbytes:
            cl.enqueue_copy(self.queue, out, buffer.mem)
        return out

    def release(self, *buffers: Buffer) -> None:
        """Free ``buffers`` and take them out of the ledger."""
        self.queue.finish()
        for buffer in buffers:
            self.memory.release(buffer.name)
            buffer.mem.release()

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Buffer:
        nbytes = nbytes_of(shape, dtype)
        self.memory.reserve(name, nbytes)
        try:
            mem = cl.Buffer(self.context, cl.mem_flags.READ_WRITE, max(nbytes, 1))
        except (cl.MemoryError, cl.LogicError, cl.RuntimeError) as error:
            self.memory.release(name)
            raise CannotRun(
                f"the executing device cannot allocate the {nbytes:,} bytes of '{name}' ({error})",
                mend="lower --receivers, --probes or --sh-order",
            ) from error
        return Buffer(name, shape, dtype, mem)

    # -- programs ----------------------------------------------------------------------------

    def program(self, path: str, defines: Mapping[str, Define] | None = None) -> Program:
        """Build ``path`` (beneath ``kernels_cl``) with ``defines`` as macros; cached.

        Raises:
            GibenchError: the compiler refuses it; the message carries the first line of its log.
        """
        defines = dict(defines or {})
        key = (path, macro_options(defines))
        if key not in self._programs:
            source = kernel_source(path, self.kernel_root)
            try:
                built = build_program(self.context, source, defines)
            except cl.RuntimeError as error:
                raise GibenchError(f"building {path} with {defines} failed: {error}") from error
            self._programs[key] = Program(source, built, defines)
        return self._programs[key]

    def launch_problem(self, kernel: Any, workgroup_size: int, local_bytes: int = 0) -> str | None:
        """Why ``kernel`` cannot be launched with ``workgroup_size``, or None when it can.

        Args:
            kernel: the kernel.
            workgroup_size: work-items per group.
            local_bytes: local memory passed as arguments, beyond what the kernel declares itself.
        """
        info = cl.kernel_work_group_info
        profile = self.profile
        if problem := profile.workgroup_size_problem(workgroup_size):
            return problem
        own = int(kernel.get_work_group_info(info.WORK_GROUP_SIZE, self.cl_device))
        if workgroup_size > own:
            return f"work-group size {workgroup_size} is over the {own} this kernel allows"
        fixed = int(kernel.get_work_group_info(info.COMPILE_WORK_GROUP_SIZE, self.cl_device)[0])
        if fixed not in (0, workgroup_size):  # reqd_work_group_size
            return f"work-group size {workgroup_size} is not the {fixed} this kernel is made for"
        static = int(kernel.get_work_group_info(info.LOCAL_MEM_SIZE, self.cl_device))
        needed = static + local_bytes
        if needed > profile.local_memory_bytes:
            return (
                f"{needed:,} bytes of local memory are over the {profile.local_memory_bytes:,} "
                f"of profile {profile.name}"
            )
        if needed > self.cl_device.local_mem_size:
            return f"{needed:,} bytes of local memory are over the executing device's own limit"
        return None


def select_cl_device(index: int | None) -> Any:
    """The device number ``index`` of :func:`list_devices` (the first when None).

    Raises:
        BadInput: there is no such number.
    """
    devices = list_devices()
    if index is None:
        return devices[0]
    if not 0 <= index < len(devices):
        raise BadInput(
            f"no OpenCL device number {index}",
            mend=f"'gibench devices' lists the {len(devices)} there are, counted from 0",
        )
    return devices[index]
