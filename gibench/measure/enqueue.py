"""From a technique's passes to enqueued kernels and the times of one frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pyopencl as cl

from gibench.device import Buffer, Device
from gibench.errors import CannotRun, GibenchError
from gibench.techniques.technique import Argument, Launch, LocalMemory, Pass, Technique, Work

Status = Literal["ok", "skipped", "failed"]


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


@dataclass(frozen=True)
class PreparedPass:
    """A pass that is ready to be enqueued, or the reason why it cannot be.

    Attributes:
        name: the pass's name.
        work: the least it must do per frame.
        launches: what is enqueued, in order; empty unless ``status`` is ``ok``.
        problem: why it cannot run, one line; None when it can.
        status: ``ok``; ``skipped`` where the profile or the device forbids it; ``failed`` where
            its program cannot be built or its arguments are refused.
    """

    name: str
    work: Work
    launches: tuple[PreparedLaunch, ...]
    problem: str | None = None
    status: Status = "ok"


@dataclass(frozen=True)
class FrameTimes:
    """The times of one frame, ms.

    Attributes:
        pass_ms: for every pass that ran: the sum over its launches of event end minus start.
        wall_ms: from before ``begin_frame`` until the queue is empty again, by the host's clock.
        gap_ms: what of it no kernel accounts for: uploads, launch overhead, idling.
    """

    pass_ms: dict[str, float]
    wall_ms: float
    gap_ms: float


def prepare_passes(technique: Technique, workgroup_size: int) -> list[PreparedPass]:
    """Build every pass of ``technique``: kernels created and their arguments set once.

    A pass that cannot run is returned with its reason and the others go on.
    """
    return [prepare_pass(technique.device, item, workgroup_size) for item in technique.passes()]


def prepare_pass(device: Device, item: Pass, workgroup_size: int) -> PreparedPass:
    """Build one pass (see :func:`prepare_passes`)."""
    try:
        launches = tuple(_prepare(device, one, workgroup_size) for one in item.launches())
    except CannotRun as error:
        return PreparedPass(item.name, item.work, (), str(error), "skipped")
    except (GibenchError, cl.Error) as error:
        return PreparedPass(item.name, item.work, (), " ".join(str(error).split()), "failed")
    return PreparedPass(item.name, item.work, launches)


def enqueue_frame(technique: Technique, prepared: Sequence[PreparedPass], frame: int) -> FrameTimes:
    """Run one frame and return its times. Passes that are not ``ok`` are left out."""
    queue = technique.device.queue
    queue.finish()
    begin = time.perf_counter_ns()
    technique.begin_frame(frame)
    events = [(item.name, _enqueue(queue, launch)) for item in prepared for launch in item.launches]
    queue.finish()
    wall_ms = (time.perf_counter_ns() - begin) * 1e-6
    pass_ms = {item.name: 0.0 for item in prepared if item.status == "ok"}
    for name, event in events:
        if event is not None:
            pass_ms[name] += (event.profile.end - event.profile.start) * 1e-6
    return FrameTimes(pass_ms, wall_ms, wall_ms - sum(pass_ms.values()))


def _enqueue(queue: Any, launch: PreparedLaunch) -> Any:
    size = launch.global_size
    if size == 0:
        return None
    return cl.enqueue_nd_range_kernel(queue, launch.kernel, (size,), (launch.local,))


def _prepare(device: Device, launch: Launch, workgroup_size: int) -> PreparedLaunch:
    local = launch.workgroup_size or workgroup_size
    kernel = launch.program.kernel(launch.kernel)
    kernel.set_args(*(_raw(argument) for argument in launch.args))
    local_bytes = sum(a.nbytes for a in launch.args if isinstance(a, LocalMemory))
    if problem := device.launch_problem(kernel, local, local_bytes):
        raise CannotRun(problem)
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
