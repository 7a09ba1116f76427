"""A declared launch: program, kernel, arguments by name with access, sizes; and made ready.

Declared, a launch is data: nothing is built and no device is named. :meth:`Device.prepare` builds
it, compares the arguments' names with the kernel's own parameters, and sets them once;
:meth:`Device.enqueue` runs it. Nothing else in gibench enqueues a kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np
import pyopencl as cl

from gibench.device.buffers import Buffer
from gibench.device.program import Instrument, Parameter, Program, ProgramSpec
from gibench.errors import GibenchError

Scalar = np.generic


@dataclass(frozen=True)
class LocalMemory:
    """A ``__local`` pointer argument of ``nbytes``."""

    nbytes: int


Value = Buffer | LocalMemory | Scalar


class Access(Enum):
    """What a kernel does with a buffer."""

    READ = "reads"
    WRITE = "writes"
    UPDATE = "updates"


@dataclass(frozen=True)
class Argument:
    """An argument of a launch.

    Attributes:
        name: the parameter's name in the kernel's source.
        value: what is passed.
        access: what the kernel does with a buffer; None of anything else.
    """

    name: str
    value: Value
    access: Access | None = None


def reads(name: str, buffer: Buffer) -> Argument:
    """A buffer that the kernel only reads: ``__global const`` in its source."""
    return Argument(name, buffer, Access.READ)


def writes(name: str, buffer: Buffer) -> Argument:
    """A buffer that the kernel writes without reading what was there before."""
    return Argument(name, buffer, Access.WRITE)


def updates(name: str, buffer: Buffer) -> Argument:
    """A buffer that the kernel reads and writes, or writes in part."""
    return Argument(name, buffer, Access.UPDATE)


def scalar(name: str, value: Scalar) -> Argument:
    """A number, of the type that the kernel takes."""
    return Argument(name, value)


def integer(name: str, value: int) -> Argument:
    """An ``int``."""
    return Argument(name, np.int32(value))


def unsigned(name: str, value: int) -> Argument:
    """A ``uint``."""
    return Argument(name, np.uint32(value))


def local(name: str, nbytes: int) -> Argument:
    """Local memory of ``nbytes``."""
    return Argument(name, LocalMemory(nbytes))


Size = int | tuple[int, int]


@dataclass
class Launch:
    """One kernel launch.

    Exactly one of ``items`` (work-items, rounded up to whole groups: kernels test their index
    against the count they are given) and ``groups`` (work-groups) is set; either may be a function
    that is asked before every frame. Both may be a pair: work-groups have one row then, the second
    number counts rows.

    Attributes:
        program: what it is built from.
        kernel: the kernel's name in it.
        args: arguments in the kernel's order.
        items: number of work-items.
        groups: number of work-groups.
        workgroup_size: another size than the configuration's, where the algorithm fixes it.
    """

    program: ProgramSpec
    kernel: str
    args: Sequence[Argument]
    items: Size | Callable[[], Size] | None = None
    groups: Size | Callable[[], Size] | None = None
    workgroup_size: int | None = None

    def __post_init__(self) -> None:
        if (self.items is None) == (self.groups is None):
            raise ValueError(f"{self.kernel}: give either items or groups")

    @property
    def local_bytes(self) -> int:
        """Local memory passed as arguments."""
        return sum(a.value.nbytes for a in self.args if isinstance(a.value, LocalMemory))

    def buffers(self, *access: Access) -> Iterator[Buffer]:
        """The buffers that it has one of these kinds of access to."""
        for argument in self.args:
            if argument.access in access:
                assert isinstance(argument.value, Buffer)
                yield argument.value


def argument_problem(launch: Launch, parameters: Sequence[Parameter]) -> str | None:
    """Why the arguments of ``launch`` are not those that its kernel takes, or None.

    Names are compared in order, so that the launch is right where a driver tells no names, too.
    """
    where = f"{launch.program.path}: {launch.kernel}"
    names = [argument.name for argument in launch.args]
    for place, (given, parameter) in enumerate(zip(names, parameters, strict=False), 1):
        if given != parameter.name:
            return f"{where} takes '{parameter.name}' as argument {place}, not '{given}'"
    if len(names) < len(parameters):
        missing = parameters[len(names)].name
        return (
            f"{where} takes {len(parameters)} arguments, not {len(names)}: '{missing}' is missing"
        )
    if len(names) > len(parameters):
        return f"{where} takes {len(parameters)} arguments, not {len(names)}"
    for argument, parameter in zip(launch.args, parameters, strict=True):
        if problem := _mismatch(argument, parameter):
            return f"{where}: '{parameter.name}' {problem}"
    return None


def _mismatch(argument: Argument, parameter: Parameter) -> str | None:
    """How an argument differs from the parameter of the same name, or None."""
    value = argument.value
    if isinstance(value, LocalMemory):
        return None if parameter.is_local else "is not local memory"
    if isinstance(value, Buffer):
        if not parameter.is_pointer or parameter.is_local:
            return f"is {parameter.type_name}, not a buffer"
        if argument.access is Access.READ and not parameter.constant:
            return "is declared as read, but the kernel may write it"
        if argument.access in (Access.WRITE, Access.UPDATE) and parameter.constant:
            return "is declared as written, but the kernel can only read it"
        return None
    if parameter.is_pointer:
        return f"is {parameter.type_name}, not a number"
    if (parameter.type_name in ("float", "double", "half")) != isinstance(value, np.floating):
        return f"is {parameter.type_name}, not {value.dtype}"
    return None


def raw_value(value: Value) -> Any:
    """What ``pyopencl`` takes for ``value``."""
    if isinstance(value, Buffer):
        return value.mem
    if isinstance(value, LocalMemory):
        return cl.LocalMemory(value.nbytes)
    if isinstance(value, np.generic):
        return value
    raise TypeError(f"a kernel argument is a Buffer, LocalMemory or numpy scalar, not {value!r}")


@dataclass(frozen=True)
class PreparedLaunch:
    """A kernel object with its arguments set, ready to be enqueued again and again.

    Attributes:
        launch: what was declared: program, kernel, arguments, sizes.
        kernel: the ``pyopencl.Kernel``.
        local: work-items per group.
    """

    launch: Launch
    kernel: Any = field(repr=False)
    local: int

    @property
    def global_sizes(self) -> tuple[int, ...]:
        """Work-items to enqueue along each dimension, whole groups; a 0 where the next frame has
        nothing to do.
        """
        groups = self.launch.groups
        size = self.launch.items if groups is None else groups
        assert size is not None
        size = size() if callable(size) else size
        first, *rows = size if isinstance(size, tuple) else (size,)
        if groups is None:
            first = -(-first // self.local)
        return (first * self.local, *rows)

    @property
    def global_size(self) -> int:
        """All work-items to enqueue; 0 when the next frame has nothing to do."""
        return int(np.prod(self.global_sizes, dtype=np.int64))

    def enqueue(self, queue: Any) -> Any:
        """Enqueue it; returns the event, or None when there is nothing to do."""
        sizes = self.global_sizes
        if 0 in sizes:
            return None
        return self._enqueue(queue, sizes)

    def enqueue_items(self, queue: Any, items: int) -> Any:
        """Enqueue ``items`` work-items along the first dimension, whole groups, instead of what the
        next frame has: for a kernel that tests its index against a count. Returns the event.
        """
        whole = -(-items // self.local) * self.local
        return self._enqueue(queue, (whole, *(max(n, 1) for n in self.global_sizes[1:])))

    def _enqueue(self, queue: Any, sizes: tuple[int, ...]) -> Any:
        groups = (self.local, *(1 for _ in sizes[1:]))
        return cl.enqueue_nd_range_kernel(queue, self.kernel, sizes, groups)


def set_arguments(launch: Launch, program: Program, kernel: Any) -> None:
    """Set the arguments of ``launch`` on ``kernel`` once they are found to be those it takes.

    Raises:
        GibenchError: they are not.
    """
    parameters = program.parameters(launch.kernel, kernel)
    if parameters is not None and (problem := argument_problem(launch, parameters)):
        raise GibenchError(problem)
    kernel.set_args(*(raw_value(argument.value) for argument in launch.args))


def instrumented(launch: Launch, instrument: Instrument, counters: Buffer) -> Launch:
    """``launch`` in the build of ``instrument``, which writes into ``counters``.

    Raises:
        GibenchError: the kernel has no parameter that the instrument's stands behind.
    """
    names = [argument.name for argument in launch.args]
    if instrument.after not in names:
        raise GibenchError(
            f"{launch.program.path}: {launch.kernel} has no '{instrument.after}': "
            f"{instrument.name} has nothing to count"
        )
    behind = names.index(instrument.after) + 1
    program = replace(launch.program, defines={**launch.program.defines, instrument.macro: 1})
    args = (*launch.args[:behind], updates(instrument.parameter, counters), *launch.args[behind:])
    return replace(launch, program=program, args=args)
