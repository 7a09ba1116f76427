"""What a frame loop holds: the run, what becomes of it, configurations set up on devices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gibench.errors import GibenchError
from gibench.measure.plan.stopping import Plan
from gibench.measure.runfolder.axes import Axis
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.runfolder.results import OK, JobResult
from gibench.measure.session.beside import ConstantWork
from gibench.measure.session.cold import CacheFlush
from gibench.measure.session.interrupts import Interrupts
from gibench.measure.session.rest import RestWatch
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared

TakeImages = Callable[[JobResult, dict[str, Any]], None]


@dataclass
class RunOutcome:
    """What became of a run.

    Attributes:
        results: one per configuration, in order.
        interrupted: whether Ctrl-C ended it early.
        samples: stored, over all configurations.
        write_error: why samples could not be stored any more, which ended it early.
    """

    results: list[JobResult]
    interrupted: bool = False
    samples: int = 0
    write_error: GibenchError | None = None

    @property
    def first_error(self) -> BaseException | None:
        """The first thing that went wrong, if anything did."""
        return next((r.error for r in self.results if r.error is not None), None)

    @property
    def ended(self) -> bool:
        """Whether nothing further is to be run."""
        return self.interrupted or self.write_error is not None


@dataclass
class Live:
    """A configuration that is set up on its device.

    Attributes:
        rest: tells when it is at rest.
        warming_ms: wall times of its warm-up frames.
        walls_ms: wall times of the frames that count.
        rows: samples not stored yet.
        waited: frames after which it was no longer waited for, and the scene's clock began.
        pictured: whether its images were taken.
        beside: timed after each of its frames, where they differ; made with the first.
    """

    result: JobResult
    session: Session
    rest: RestWatch
    beside: ConstantWork | None = None
    warming_ms: list[float] = field(default_factory=list)
    walls_ms: list[float] = field(default_factory=list)
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    waited: int | None = None
    pictured: bool = False

    @property
    def runs(self) -> bool:
        """Whether it has any pass to run."""
        return any(p.status == OK for p in self.session.prepared)

    @property
    def ran(self) -> int:
        """Frames run, and the number of the next one."""
        return len(self.warming_ms) + len(self.walls_ms)

    def wait(self, plan: Plan) -> None:
        """Hold the scene's clock as long as it is waited for until it rests, and begin it then."""
        if self.waited is not None:
            return
        self.waited = plan.waited(self.warming_ms, self.rest.waited)
        if self.waited is None:
            self.session.world.clock.hold()
        else:
            self.session.world.clock.begin(self.ran)


@dataclass
class Loop:
    """What all configurations of a run have in common."""

    plan: Plan
    fit: bool
    axes: Sequence[Axis]
    shared: Shared
    cl_device: Any
    folder: RunFolder
    outcome: RunOutcome
    take_images: TakeImages | None
    flush: CacheFlush | None
    rng: np.random.Generator
    interrupts: Interrupts
