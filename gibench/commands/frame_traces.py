"""A frame's launches, each looked at by a process of its own with its buffers as it finds them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Generic, TypeVar

from gibench.errors import GibenchError
from gibench.measure.plan.stopping import Patience
from gibench.measure.session.enqueue import PreparedPass
from gibench.measure.session.rest import warm_up
from gibench.measure.session.session import Session
from gibench.trace.launched import request_of
from gibench.trace.request import TraceRequest

LEAST = 32
"""Frames that are run before one is traced where none is asked for."""
_AT_ONCE = 2
"""Launches that are traced side by side, each with a copy of its buffers."""
T = TypeVar("T")


@dataclass(frozen=True)
class TracedLaunch(Generic[T]):
    """A launch of the traced frame.

    Attributes:
        item: its pass.
        kernel: its name; empty where the pass cannot run.
        place: of the launch in its pass.
        found: what was found of it, or why nothing was; None where the pass cannot run.
    """

    item: PreparedPass
    kernel: str
    place: int
    found: T | GibenchError | None


def warmed_up(session: Session) -> int:
    """Run frames until the technique is at rest, as a run does before it measures, ``LEAST`` at
    least; returns the next one's number.

    Args:
        session: prepared, no frame run.
    """
    return warm_up(session, LEAST, Patience()).frames


def trace_frame(
    session: Session,
    frame: int,
    look: Callable[[TraceRequest], T],
    names: Sequence[str] = (),
    begun: int = 0,
) -> list[TracedLaunch[T]]:
    """Run frames up to ``frame`` and look at each of its launches before it runs.

    Args:
        session: prepared, ``begun`` frames run.
        frame: that is looked at.
        look: is given every launch, in another thread; what it raises is kept as its finding.
        names: of kernels to look at (``srp/tuned_probes.cl:probe_update``); none stands for all.
        begun: frames that were run before.
    """
    for number in range(begun, frame):
        session.frame(number)
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        waiting = list(_launched(session, frame, look, names, pool))
        session.device.queue.finish()
    return [
        TracedLaunch(item, kernel, place, None if found is None else found.result())
        for item, kernel, place, found in waiting
    ]


_Waiting = tuple[PreparedPass, str, int, "Future[T | GibenchError] | None"]


def _launched(
    session: Session,
    frame: int,
    look: Callable[[TraceRequest], T],
    names: Sequence[str],
    pool: ThreadPoolExecutor,
) -> Iterator[_Waiting[T]]:
    queue = session.device.queue
    session.technique.begin_frame(frame)
    waiting: list[Future[T | GibenchError]] = []

    def kept(request: TraceRequest) -> T | GibenchError:
        try:
            return look(request)
        except GibenchError as error:
            return error

    for item in session.prepared:
        if item.problem:
            yield item, "", 0, None
        for place, launch in enumerate(item.launches):
            name = f"{launch.launch.program.path}:{launch.launch.kernel}"
            if launch.global_size and (not names or name in names):
                queue.finish()
                request = request_of(session.device, launch)
                while sum(not each.done() for each in waiting) >= _AT_ONCE:
                    wait(waiting, return_when=FIRST_COMPLETED)
                    waiting = [each for each in waiting if not each.done()]
                waiting.append(pool.submit(kept, request))
                yield item, request.kernel, place, waiting[-1]
            launch.enqueue(queue)
