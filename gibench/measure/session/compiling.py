"""Kernels compiled for their launches before any frame counts.

A driver may compile a kernel only when it first runs (PoCL does so for every work-group size, and
again for a launch of more than 65 535 work-items in a direction, tens of milliseconds to seconds
each), and a launch that has nothing to do at first comes later. So the first frames are run on a
twin of the technique, which is thrown away: it shares the programs of the device but no buffer, and
what is measured starts untouched. Launches whose number of work-items differs from frame to frame
then run once small and once large, whatever the twin's frames had of them: kernels test their index
against the count that they are given.
"""

from __future__ import annotations

from collections.abc import Sequence

from gibench.device import PreparedLaunch
from gibench.measure.session.enqueue import PreparedPass
from gibench.progress import progress
from gibench.techniques.technique import Technique

FRAMES_MOST = 4
"""Frames of the twin at most: GIBS launches its last kernel in its second."""
LARGE = 1 << 16
"""Work-items from which on PoCL compiles a kernel for a large grid (its
``grid_width_specialization_limit`` is USHRT_MAX)."""


def compile_launches(twin: Technique, prepared: Sequence[PreparedPass]) -> int:
    """Run frames of ``twin`` until each of its launches has run once, at most ``FRAMES_MOST``.

    Args:
        twin: whose state is of no further use.
        prepared: its passes.

    Returns:
        How many launches have not run: nothing was to be done by them.
    """
    queue = twin.device.queue
    launches = [launch for item in prepared for launch in item.launches]
    waiting: dict[int, PreparedLaunch] = dict(enumerate(launches))
    with progress("compiling kernels", len(launches)) as advance:
        for frame in range(FRAMES_MOST):
            twin.begin_frame(frame)
            for number, launch in enumerate(launches):
                ran = launch.enqueue(queue) is not None
                queue.finish()
                if ran and waiting.pop(number, None) is not None:
                    advance(1)
            if not waiting:
                break
    for launch in launches:
        if callable(launch.launch.items):
            for items in (1, LARGE):
                launch.enqueue_items(queue, items)
                queue.finish()
    return len(waiting)
