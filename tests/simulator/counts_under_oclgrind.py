"""Run one frame of a technique pass by pass; meant for ``oclgrind --inst-counts``.

Prints ``PASS name`` before each pass's launches of the last frame and, after that frame, ``WORK
name`` and the work that the pass declares.

Usage: python counts_under_oclgrind.py CACHE_DIR FRAMES WIDTH HEIGHT CASE (a JSON object of Case's
fields; width and height of the image in pixels)
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from cases import Case
from run_case import behind_the_camera, created, suit_simulator

from gibench.measure.session.enqueue import enqueue_frame


def main(cache: Path, frames: int, width: int, height: int, case: Case) -> None:
    """Bake, create, run all frames but one, then that one pass by pass."""
    suit_simulator(case.width, case.layout)
    made, prepared = created(case, cache, width, height)
    for frame in range(frames - 1):
        shown = prepared if frame == 0 else behind_the_camera(case, prepared)
        enqueue_frame(made, shown, frame)
    made.begin_frame(frames - 1)
    for item in prepared:
        print("PASS", item.name, flush=True)
        for launch in item.launches:
            launch.enqueue(made.device.queue)
            made.device.queue.finish()
    print("END", flush=True)
    for item in prepared:
        work = item.counted(case.size) if item.counted else item.work
        print("WORK", item.name, json.dumps(asdict(work)), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *(int(n) for n in sys.argv[2:5]), Case(**json.loads(sys.argv[5])))
