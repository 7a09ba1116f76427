"""From a technique's passes to enqueued kernels and the times of one frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import pyopencl as cl

from gibench.device import Device, PreparedLaunch
from gibench.errors import CannotRun, GibenchError
from gibench.techniques.parts.frame_passes import frame_passes
from gibench.techniques.technique import GI, Pass, Stage, Technique, Work

Status = Literal["ok", "skipped", "failed"]


@dataclass(frozen=True)
class PreparedPass:
    """A pass that is ready to be enqueued, or the reason why it cannot be.

    Attributes:
        name: the pass's name.
        work: the least it must do per frame.
        launches: what is enqueued, in order; empty unless ``status`` is ``ok``.
        problem: why it cannot run, one line; None when it can.
        stage: what of the frame it belongs to.
        counted: tells its work after the last frame, where that is not known ahead.
        status: ``ok``; ``skipped`` where the profile or the device forbids it; ``failed`` where
            its program cannot be built or the driver refuses an argument.
    """

    name: str
    work: Work
    launches: tuple[PreparedLaunch, ...]
    problem: str | None = None
    status: Status = "ok"
    counted: Callable[[int], Work] | None = None
    stage: Stage = GI


@dataclass(frozen=True)
class FrameTimes:
    """The times of one frame, ms.

    Attributes:
        pass_ms: for every pass that ran: the sum over its launches of event end minus start.
        wall_ms: from before ``begin_frame`` until the queue is empty again, by the host's clock.
        gap_ms: what of it no kernel accounts for: uploads, launch overhead, idling.
        cpu_ms: what this process ran meanwhile, on all cores together.
    """

    pass_ms: dict[str, float]
    wall_ms: float
    gap_ms: float
    cpu_ms: float = 0.0


def prepare_passes(
    technique: Technique, workgroup_size: int, sizes: Mapping[str, int] | None = None
) -> list[PreparedPass]:
    """Build every pass of ``technique``: kernels created and their arguments set once.

    A pass that cannot run is returned with its reason and the others go on.

    Args:
        technique: set up on its device.
        workgroup_size: work-items per group.
        sizes: by pass, where they are others.
    """
    sizes = sizes or {}
    return [
        prepare_pass(technique.device, item, sizes.get(item.name, workgroup_size))
        for item in frame_passes(technique)
    ]


def prepare_pass(device: Device, item: Pass, workgroup_size: int) -> PreparedPass:
    """Build one pass (see :func:`prepare_passes`)."""
    try:
        launches = tuple(device.prepare(one, workgroup_size) for one in item.launches())
    except CannotRun as error:
        return PreparedPass(item.name, item.work, (), str(error), "skipped", stage=item.stage)
    except (GibenchError, cl.Error) as error:
        problem = " ".join(str(error).split())
        return PreparedPass(item.name, item.work, (), problem, "failed", stage=item.stage)
    return PreparedPass(item.name, item.work, launches, counted=item.counted, stage=item.stage)


def enqueue_frame(technique: Technique, prepared: Sequence[PreparedPass], frame: int) -> FrameTimes:
    """Run one frame and return its times. Passes that are not ``ok`` are left out."""
    queue = technique.device.queue
    queue.finish()
    ran = time.process_time_ns()
    begin = time.perf_counter_ns()
    technique.begin_frame(frame)
    events = [(item.name, launch.enqueue(queue)) for item in prepared for launch in item.launches]
    queue.finish()
    wall_ms = (time.perf_counter_ns() - begin) * 1e-6
    cpu_ms = (time.process_time_ns() - ran) * 1e-6
    pass_ms = {item.name: 0.0 for item in prepared if item.status == "ok"}
    for name, event in events:
        if event is not None:
            pass_ms[name] += (event.profile.end - event.profile.start) * 1e-6
    return FrameTimes(pass_ms, wall_ms, wall_ms - sum(pass_ms.values()), cpu_ms)
