"""One process that runs one configuration with one kernel tree, a frame whenever it is told to.

Started as ``python -m gibench.measure.compare.replicate``: the configuration comes as one line of
JSON on standard input (:func:`request`), then commands, one a line: ``warm N`` runs frame N and
tells whether it is at rest, ``frame N`` runs frame N, and ``keep FILE`` writes what was computed;
every answer is one line of JSON. The end of input ends it. The parent
(:mod:`gibench.measure.compare.lockstep`) lets two such processes take turns.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from gibench.errors import BadInput, GibenchError

if TYPE_CHECKING:
    from gibench.techniques.job import Job


@dataclass(frozen=True)
class Place:
    """Where a job is run.

    Attributes:
        cache_dir: what is baked is found there.
        kernel_root: folder of the kernel tree; None for the installed one.
        device: number of the OpenCL device; None for the default
            (:func:`gibench.device.selection.select_cl_device`).
    """

    cache_dir: str
    kernel_root: str | None = None
    device: int | None = None


def request(job: Job, place: Place) -> str:
    """``job`` at ``place`` as one line of JSON, which a fresh process is started with, in whatever
    folder: what they name of files is absolute.
    """
    root = None if place.kernel_root is None else str(Path(place.kernel_root).absolute())
    there = replace(place, cache_dir=str(Path(place.cache_dir).absolute()), kernel_root=root)
    return json.dumps({"job": job.anywhere().record(), "place": asdict(there)})


def serve(job: Job, place: Place, commands: TextIO, answers: TextIO) -> None:
    """Set ``job`` up, say so, and answer commands until their end.

    Raises:
        GibenchError: it cannot be set up; a pass of it cannot run.
    """
    import numpy as np

    from gibench.device.selection import select_cl_device
    from gibench.measure.session.rest import RestWatch
    from gibench.measure.session.session import Session
    from gibench.measure.session.shared import Shared

    root = Path(place.kernel_root) if place.kernel_root else None
    shared = Shared(Path(place.cache_dir), job.seed)
    session = Session.open(job, shared, select_cl_device(place.device), kernel_root=root)
    session.prepare(whole=True)
    session.compile()
    rest = RestWatch.over(session)
    _answer(answers, {"ready": [item.name for item in session.prepared]})
    for line in commands:
        command, _, argument = line.strip().partition(" ")
        if command == "warm":
            rest.ran(session.frame(int(argument)).wall_ms)
            told = {"waits": rest.waits, "spent_ms": rest.spent_ms, "warning": rest.warning()}
            _answer(answers, told)
        elif command == "frame":
            times = session.frame(int(argument))
            _answer(answers, {"wall_ms": times.wall_ms, "pass_ms": times.pass_ms})
        elif command == "keep":
            irradiance = session.technique.indirect_irradiance()
            outputs: dict[str, Any] = {"indirect irradiance": irradiance}
            outputs |= {f"image {title}": image for title, image in session.images().items()}
            np.savez(argument, **outputs)
            _answer(answers, {"kept": argument})
        else:
            raise BadInput(f"no command '{command}'")


def _answer(answers: TextIO, content: Mapping[str, Any]) -> None:
    answers.write(json.dumps(content) + "\n")
    answers.flush()


def main() -> int:
    """Serve standard input; what compilers print must not mix with the answers."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    try:
        from gibench.techniques.registry import job_of

        asked = json.loads(sys.stdin.readline())
        serve(job_of(asked["job"]), Place(**asked["place"]), sys.stdin, answers)
    except GibenchError as error:
        _answer(answers, {"error": str(error), "exit_code": error.exit_code})
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        _answer(answers, {"error": f"{type(error).__name__}: {error}", "exit_code": 1})
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
