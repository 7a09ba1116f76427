"""A technique run until its indirect light stands still, lights and objects standing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.errors import CannotRun
from gibench.measure.plan.grid import job_label
from gibench.measure.session.rest import RestWatch
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.measure.statistics.summary import Summary, summarize
from gibench.progress import progress
from gibench.scene.lightmap import Lightmap
from gibench.study.watched import Observed
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique
from gibench.techniques.technique import GI
from gibench.work import Worker

FIRST_CHECK = 16
"""Frames after which the indirect light is looked at first, and then whenever they double; a
camera's flight comes before them."""


@dataclass(frozen=True)
class SettleOptions:
    """When a technique counts as settled.

    Attributes:
        frames: run at most.
        tolerance: settled when the mean irradiance moved by no more than this share, and all
            receivers together (root mean square) by no more than ``jitter`` of the mean, while the
            frames doubled.
        jitter: see there; what a technique's own noise may do.
        timed: the times of this many last frames count.
        seconds: of frames at most, wall time; None for no limit.
    """

    frames: int = 512
    tolerance: float = 0.005
    jitter: float = 0.25
    timed: int = 30
    seconds: float | None = None


@dataclass
class Settled:
    """What became of a configuration.

    Attributes:
        job: what was run.
        counts: probes, surfels, as the technique has them.
        memory_bytes: the most that was allocated at once.
        lightmap: the receivers.
        irradiance: (n, 3) of the last frame, W/m2.
        covered: (n,) receivers the technique has anything to say of; the others it calls black.
        frames: run in all.
        settled: whether it stood still at the end.
        change: of the mean irradiance in the last doubling of frames, as a share.
        times: wall times of the last frames.
        gi_ms: median of what the passes of stage ``gi`` took together in those.
        bake_seconds: wall time that baking took, now or when it was stored.
        observed: what further frames showed, where they were asked for.
        rest: whether it is at rest, in words; empty where the technique does not tell.
        unrested: the same where it is not, though it may be.
        frames_to_rest: after so many it was, if it was.
        ms_to_rest: that those took.
    """

    job: Job
    counts: dict[str, int]
    memory_bytes: int
    lightmap: Lightmap = field(repr=False)
    irradiance: Doubles = field(repr=False)
    covered: npt.NDArray[np.bool_] = field(repr=False)
    frames: int
    settled: bool
    change: float
    times: Summary
    gi_ms: float = float("nan")
    bake_seconds: float = 0.0
    observed: Observed = field(default_factory=Observed)
    rest: str = ""
    unrested: str = ""
    frames_to_rest: int | None = None
    ms_to_rest: float | None = None


def settle(
    job: Job,
    options: SettleOptions,
    shared: Shared,
    cl_device: Any,
    worker: Worker,
    among: str = "",
    then: Callable[[Session, int], Observed] | None = None,
) -> Settled:
    """Run ``job`` until it is settled and, if it tells, at rest, or has run all its frames, which
    are timed.

    Args:
        job: what to run.
        options: when to stop.
        shared: scenes whose lights stand still.
        cl_device: where to run.
        worker: who runs it.
        among: what it is among others, for the progress bar, as in "3 of 18".
        then: what looks at further frames of the settled session, given the next one's number.

    Raises:
        CannotRun: the profile, device or budget forbids it or one of its passes.
        GibenchError: a pass failed, or the irradiance is not finite.
    """
    refuse_motion(job.shot)
    with Session.open(job, shared, cl_device) as session:
        session.prepare(whole=True)
        session.compile()
        title = f"settling {job_label(job, session.world.scene.name)}"
        title += f" ({among})" if among else ""
        with worker.alone(), progress(title, options.frames) as advance:
            frames, times, gi = 0, list[float](), list[float]()
            of_gi = [item.name for item in session.prepared if item.stage == GI]
            watch = _Watch(options, _next=job.shot.flight.frames + FIRST_CHECK)
            rest = RestWatch.over(session)
            while frames < options.frames:
                taken = session.frame(frames)
                times.append(taken.wall_ms)
                gi.append(sum(taken.pass_ms[name] for name in of_gi))
                frames += 1
                advance(1)
                rest.ran(times[-1])
                still = watch.asks(frames) and watch.stands_still(session.irradiance())
                if still and not rest.waits:
                    break
                if options.seconds is not None and sum(times) > 1e3 * options.seconds:
                    watch.stands_still(session.irradiance())
                    break
        begin = min(3, len(times) - 1)
        warm = times[begin:][-options.timed :]
        settled = Settled(
            job=job,
            counts=session.counts(),
            memory_bytes=session.memory_bytes,
            lightmap=session.world.lightmap,
            irradiance=session.irradiance(),
            covered=session.covered(),
            frames=frames,
            settled=watch.settled,
            change=watch.change,
            times=summarize(warm),
            gi_ms=float(np.median(gi[begin:][-options.timed :])),
            bake_seconds=shared.bake_seconds(
                find_technique(job.technique),
                job.settings,
                session.world.scene,
                session.world.lightmap,
            ),
            rest=rest.in_words(),
            unrested=rest.warning(),
            frames_to_rest=rest.frames_to_rest,
            ms_to_rest=rest.ms_to_rest,
        )
        if then is not None:
            with worker.alone():
                settled.observed = then(session, frames)
        return settled


def settled_remark(*, settled: bool, frames: int, change: float, unrested: str) -> str:
    """What a reader must know of light that was run for ``frames``, and moved by the share
    ``change`` (NaN: too few to tell) while they doubled; empty where it stood still, at rest.
    """
    moved = ""
    if not settled:
        moved = f"not settled after {frames} frames"
        moved += (
            ", too few to tell"
            if np.isnan(change)
            else f": the mean irradiance still moved by {100 * change:+.2g} % while they doubled"
        )
    return "; ".join(filter(None, (moved, unrested)))


def refuse_motion(shot: Shot) -> None:
    """Refuse objects that move on: nothing settles, and there is no truth to settle on.

    Raises:
        CannotRun: they do, and are not held where they are in one frame.
    """
    if shot.motion.moves and shot.motion.held is None:
        raise CannotRun(
            "light settles, and has a path-traced truth, only where all objects rest",
            where="--motion",
            mend="leave it out, or measure times with gibench run --motion",
        )


@dataclass
class _Watch:
    """Compares the irradiance whenever the frames have doubled."""

    options: SettleOptions
    settled: bool = False
    change: float = float("nan")
    _next: int = FIRST_CHECK
    _before: Doubles | None = None

    def asks(self, frames: int) -> bool:
        """Whether the irradiance is to be looked at now."""
        return frames in (self._next, self.options.frames)

    def stands_still(self, now: Doubles) -> bool:
        """Take ``now`` (n, 3) and tell whether it is settled."""
        before, self._before = self._before, now
        self._next *= 2
        if before is None:
            return False
        mean = float(np.abs(now).mean())
        if mean == 0:
            self.change, self.settled = 0.0, not before.any()
            return self.settled
        self.change = float((now - before).mean()) / mean
        off = float(np.sqrt(((now - before) ** 2).mean())) / mean
        self.settled = abs(self.change) <= self.options.tolerance and off <= self.options.jitter
        return self.settled
