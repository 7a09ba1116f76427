"""A declared launch made ready, and enqueued."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyopencl as cl

from gibench.device import Buffer, Device
from gibench.errors import CannotRun
from gibench.techniques.technique import Argument, Launch, LocalMemory


@dataclass(frozen=True)
class PreparedLaunch:
    """A kernel object with its arguments set, ready to be enqueued again and again.

    Attributes:
        kernel: the ``pyopencl.Kernel``, owned by this launch alone.
        count: asks how many work-items (or groups, see ``by_groups``) the next frame takes.
        by_groups: whether ``count`` counts work-groups.
        local: work-items per group.
    """

    kernel: Any = field(repr=False)
    count: Callable[[], int]
    by_groups: bool
    local: int

    @property
    def global_size(self) -> int:
        """Work-items to enqueue, whole groups; 0 when the next frame has nothing to do."""
        count = self.count()
        groups = count if self.by_groups else -(-count // self.local)
        return groups * self.local

    def enqueue(self, queue: Any) -> Any:
        """Enqueue it; returns the event, or None when there is nothing to do."""
        size = self.global_size
        if size == 0:
            return None
        return cl.enqueue_nd_range_kernel(queue, self.kernel, (size,), (self.local,))


def prepare_launch(device: Device, launch: Launch, workgroup_size: int) -> PreparedLaunch:
    """Create the kernel of ``launch`` and set its arguments, once: each setting costs.

    Args:
        device: where it will run.
        launch: as declared.
        workgroup_size: used unless the launch fixes its own.

    Raises:
        CannotRun: the launch would break the profile or the kernel's own limits.
        GibenchError: the program has no such kernel.
    """
    local = launch.workgroup_size or workgroup_size
    kernel = launch.program.kernel(launch.kernel)
    local_bytes = sum(a.nbytes for a in launch.args if isinstance(a, LocalMemory))
    # Before the arguments are set: from then on the kernel's own figure includes them.
    if problem := device.launch_problem(kernel, local, local_bytes):
        raise CannotRun(problem)
    kernel.set_args(*(_raw(argument) for argument in launch.args))
    size = launch.items if launch.items is not None else launch.groups
    assert size is not None
    return PreparedLaunch(kernel, _as_function(size), launch.groups is not None, local)


def _as_function(size: int | Callable[[], int]) -> Callable[[], int]:
    return size if callable(size) else lambda: size


def _raw(argument: Argument) -> Any:
    if isinstance(argument, Buffer):
        return argument.mem
    if isinstance(argument, LocalMemory):
        return cl.LocalMemory(argument.nbytes)
    if isinstance(argument, np.generic):
        return argument
    raise TypeError(f"a kernel argument is a Buffer, LocalMemory or numpy scalar, not {argument!r}")
