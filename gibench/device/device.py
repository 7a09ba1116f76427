"""An opened OpenCL device, held to a profile."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
import numpy.typing as npt
import pyopencl as cl

from gibench.device.able import cannot_run, lacks
from gibench.device.buffers import Buffer, MemoryLedger, SharedBuffer
from gibench.device.build import (
    Define,
    Layout,
    build_program,
    lanes_together,
    macro_options,
    preferred_layout,
    width_of,
)
from gibench.device.launch import Launch, PreparedLaunch, instrumented, set_arguments
from gibench.device.layout import BufferSpec
from gibench.device.pocl_cache import check_cache
from gibench.device.program import Program, ProgramSpec, find_instrument
from gibench.device.selection import first_device
from gibench.device.source import kernel_source
from gibench.errors import CannotRun, GibenchError
from gibench.profiles import DeviceProfile, unlimited_profile


class Device:
    """An opened OpenCL device held to a profile's limits.

    Every buffer is counted in ``memory`` before it is allocated; every launch is checked against
    the profile's work-group size, SIMD multiple and local memory and against the kernel's own
    limits before it is enqueued (``launch_problem``).

    Args:
        profile: whose limits bind.
        cl_device: the device; by default :func:`first_device`.
        kernel_root: another kernel tree than the installed one.
        layout: of kernels that are tuned; by default what the device prefers.

    Raises:
        CannotRun: the device lacks what everything needs (:func:`gibench.device.able.lacks`).
    """

    def __init__(
        self,
        profile: DeviceProfile,
        cl_device: Any = None,
        kernel_root: Traversable | None = None,
        layout: Layout | None = None,
    ) -> None:
        self.profile = profile
        self.cl_device = first_device() if cl_device is None else cl_device
        self._layout = layout
        if problem := lacks(self.cl_device):
            raise cannot_run(self.cl_device, problem)
        check_cache(self.cl_device)
        self.context = cl.Context([self.cl_device])
        self.queue = cl.CommandQueue(
            self.context, properties=cl.command_queue_properties.PROFILING_ENABLE
        )
        self.memory = MemoryLedger(profile)
        self.kernel_root = kernel_root
        self._programs: dict[tuple[str, tuple[str, ...]], Program] = {}
        # Kernels of launches that are enqueued only once, by what was checked of them.
        self._kernels: dict[tuple[int, str, int, int], Any] = {}

    @staticmethod
    def unlimited(cl_device: Any = None, kernel_root: Traversable | None = None) -> Device:
        """A device that only its own limits bind: for bakes, the reference, the machine's roofs."""
        return Device(unlimited_profile(), cl_device, kernel_root)

    def beside(self) -> Device:
        """The same device with a queue, a ledger and kernels of its own, for another thread; what
        is built or allocated by either can be used by both.
        """
        other = copy(self)
        other.queue = cl.CommandQueue(
            self.context, properties=cl.command_queue_properties.PROFILING_ENABLE
        )
        other.memory = MemoryLedger(self.profile)
        other._kernels = {}
        return other

    @property
    def vector_width(self) -> int:
        """Floats per vector that kernels are compiled for: 16 with AVX-512, 8 with AVX, 1 in the
        layout ``simt``.
        """
        return width_of(self.cl_device, self.layout)

    @property
    def layout(self) -> Layout:
        """The layout of kernels that are tuned."""
        return self._layout or preferred_layout(self.cl_device)

    @property
    def lanes_together(self) -> int:
        """Work-items that are computed in whole vectors only (:func:`lanes_together`)."""
        return lanes_together(self.cl_device)

    # -- buffers -----------------------------------------------------------------------------

    def create(self, spec: BufferSpec, data: npt.NDArray[Any] | None = None) -> Buffer:
        """The buffer that ``spec`` declares, with a copy of ``data``, or zeros.

        Raises:
            CannotRun: it does not fit the profile, or the device itself cannot allocate it.
            ValueError: ``data`` has another shape or type than declared.
        """
        if data is None:
            # Copied, not filled: Oclgrind takes no fill for an initialisation.
            data = np.zeros(spec.shape, spec.dtype)
        elif (data.shape, data.dtype) != (spec.shape, spec.dtype):
            raise ValueError(
                f"buffer '{spec.name}' is declared as {spec.dtype}{list(spec.shape)}, "
                f"its data are {data.dtype}{list(data.shape)}"
            )
        buffer = self._allocate(spec)
        if buffer.nbytes:
            cl.enqueue_copy(self.queue, buffer.mem, np.ascontiguousarray(data))
        return buffer

    def allocate(
        self, specs: Iterable[BufferSpec], data: Mapping[str, npt.NDArray[Any]] | None = None
    ) -> dict[str, Buffer]:
        """The buffers that ``specs`` declare, by name, with ``data`` where there is any, or zeros.

        Raises:
            CannotRun: one does not fit the profile, or the device itself cannot allocate it.
            ValueError: there are data for none of them, or of another shape or type than declared.
        """
        specs, data = list(specs), data or {}
        if strangers := sorted(set(data) - {spec.name for spec in specs}):
            raise ValueError(f"no buffer '{strangers[0]}' is declared")
        return {spec.name: self.create(spec, data.get(spec.name)) for spec in specs}

    def empty(self, name: str, shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> Buffer:
        """A zero-filled buffer of ``shape`` and ``dtype``.

        Raises:
            CannotRun: it does not fit the profile, or the device itself cannot allocate it.
        """
        return self.create(BufferSpec.of(name, shape, dtype))

    def upload(self, name: str, array: npt.NDArray[Any]) -> Buffer:
        """A buffer that holds a copy of ``array``.

        Raises:
            CannotRun: it does not fit the profile, or the device itself cannot allocate it.
        """
        return self.create(BufferSpec.like(name, array), array)

    def share(self, name: str, array: npt.NDArray[Any]) -> SharedBuffer:
        """A buffer that is ``array`` itself (``USE_HOST_PTR``, which runtimes of the CPU do not
        copy); the queue must be idle when the host looks. An array without elements is held as one
        element that nobody reads. Not counted: it is the host's memory.
        """
        held = np.ascontiguousarray(array)
        if held.size == 0:
            held = np.zeros(1, held.dtype)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
        mem = cl.Buffer(self.context, flags, hostbuf=held)
        return SharedBuffer(name, held.shape, held.dtype, mem, held)

    def write(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Overwrite ``buffer`` from its start with ``array`` (converted to the buffer's type)."""
        data = np.ascontiguousarray(array, dtype=buffer.dtype)
        if data.nbytes > buffer.nbytes:
            raise ValueError(f"{data.nbytes} bytes do not fit buffer '{buffer.name}'")
        if data.nbytes:
            cl.enqueue_copy(self.queue, buffer.mem, data)

    def write_bytes(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Overwrite ``buffer`` from its start with the bytes of ``array``, whatever their type."""
        self.write(buffer, np.ascontiguousarray(array).reshape(-1).view(buffer.dtype))

    def read(self, buffer: Buffer) -> npt.NDArray[Any]:
        """The content of ``buffer``, after everything enqueued before has finished."""
        out = np.empty(buffer.shape, buffer.dtype)
        if out.nbytes:
            cl.enqueue_copy(self.queue, out, buffer.mem)
        return out

    def read_into(self, buffer: Buffer, out: npt.NDArray[Any]) -> None:
        """Fill ``out``, contiguous, from the start of ``buffer``, after everything enqueued."""
        if out.nbytes:
            cl.enqueue_copy(self.queue, out, buffer.mem)

    def release(self, *buffers: Buffer) -> None:
        """Free ``buffers`` and take them out of the ledger."""
        self.queue.finish()
        for buffer in buffers:
            self.memory.release(buffer.name)
            buffer.mem.release()

    def _allocate(self, spec: BufferSpec) -> Buffer:
        name, nbytes = spec.name, spec.nbytes
        self.memory.reserve(name, nbytes)
        try:
            mem = cl.Buffer(self.context, cl.mem_flags.READ_WRITE, max(nbytes, 1))
        except (cl.MemoryError, cl.LogicError, cl.RuntimeError) as error:
            self.memory.release(name)
            raise CannotRun(
                f"the executing device cannot allocate the {nbytes:,} bytes of '{name}' ({error})",
                mend="lower --receivers, --probes or --sh-order",
            ) from error
        return Buffer(name, spec.shape, spec.dtype, mem)

    # -- programs ----------------------------------------------------------------------------

    def program(
        self,
        path: str,
        defines: Mapping[str, Define] | None = None,
        instrument: str | None = None,
    ) -> Program:
        """Build ``path`` (beneath ``kernels_cl``) with ``defines`` as macros; cached.

        Args:
            path: of the source.
            defines: its macros.
            instrument: the name of an :class:`Instrument`, whose build it is; None for none.

        Raises:
            GibenchError: the compiler refuses it; the message carries the first line of its log.
        """
        defines = dict(defines or {})
        if instrument is not None:
            defines[find_instrument(instrument).macro] = 1
        key = (path, macro_options(defines))
        if key not in self._programs:
            source = kernel_source(path, self.kernel_root)
            try:
                built = build_program(self.context, source, defines)
            except cl.RuntimeError as error:
                raise GibenchError(f"building {path} with {defines} failed: {error}") from error
            self._programs[key] = Program(ProgramSpec(path, defines), source, built)
        return self._programs[key]

    def built(self, launch: Launch) -> Program:
        """The program of ``launch``.

        Raises:
            GibenchError: the compiler refuses it.
        """
        return self.program(launch.program.path, launch.program.defines)

    # -- launches ----------------------------------------------------------------------------

    def prepare(self, launch: Launch, workgroup_size: int) -> PreparedLaunch:
        """Create the kernel of ``launch`` and set its arguments, once: each setting costs.

        Args:
            launch: as declared.
            workgroup_size: used unless the launch fixes its own.

        Raises:
            CannotRun: the launch would break the profile or the kernel's own limits.
            GibenchError: its program cannot be built, has no such kernel, or the kernel takes other
                arguments.
        """
        program, size = self.built(launch), launch.workgroup_size or workgroup_size
        kernel = program.kernel(launch.kernel)
        # Before the arguments are set: from then on the kernel's own figure includes them.
        if problem := self.launch_problem(kernel, size, launch.local_bytes):
            raise CannotRun(problem)
        set_arguments(launch, program, kernel)
        return PreparedLaunch(launch, kernel, size)

    def enqueue(self, launch: Launch, workgroup_size: int) -> Any:
        """Prepare ``launch`` and enqueue it once; what is enqueued again and again is better
        prepared. Its kernel object is kept for the next launch of the same kernel.

        Args:
            launch: as declared.
            workgroup_size: used unless the launch fixes its own.

        Returns:
            Its event, None where there is nothing to do.

        Raises:
            CannotRun: the launch would break the profile or the kernel's own limits.
            GibenchError: as of :meth:`prepare`.
        """
        program, size = self.built(launch), launch.workgroup_size or workgroup_size
        key = (id(program), launch.kernel, size, launch.local_bytes)
        if key not in self._kernels:
            self._kernels[key] = self.prepare(launch, size).kernel
        kernel = self._kernels[key]
        set_arguments(launch, program, kernel)
        return PreparedLaunch(launch, kernel, size).enqueue(self.queue)

    def counted(
        self, launch: Launch, workgroup_size: int, instrument: str
    ) -> npt.NDArray[np.uint32]:
        """Run ``launch`` once in an instrumented build and return the instrument's counters.

        What the launch writes it writes as ever. The counters are not counted in the ledger: no
        frame needs them.

        Args:
            launch: as declared; its arguments have names.
            workgroup_size: used unless the launch fixes its own.
            instrument: the instrument's name, for instance ``"count_rays"``.

        Raises:
            CannotRun: the launch would break the profile or the kernel's own limits.
            GibenchError: there is no such instrument, or the kernel cannot be instrumented.
        """
        tool = find_instrument(instrument)
        words = np.zeros(tool.words, np.uint32)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        mem = cl.Buffer(self.context, flags, hostbuf=words)
        counters = Buffer(tool.parameter, words.shape, words.dtype, mem)
        self.enqueue(instrumented(launch, tool, counters), workgroup_size)
        found = self.read(counters)
        mem.release()
        return found

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
