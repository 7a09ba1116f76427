"""Run cases of the simulator's (tests/simulator) and keep the first launch of every kernel: what it
was given, and what its buffers held afterwards.

Usage: python launch_capture.py OUT_DIR CACHE_DIR KERNEL,... CASE... (KERNEL is ``file:name`` as
recording.py has it, or ``all``; a case is a JSON object of Case's fields). Folders in OUT_DIR are
requests of gibench.trace with ``after<n>.npy`` beside; made for the device that the tests run on.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "simulator"))

import run_case
from cases import Case
from recording import kernels_of

from gibench.device import Access, Buffer, LocalMemory, PreparedLaunch, kernel_source
from gibench.trace.request import Sampling, TracedArgument, TraceRequest, write_request


def capture(out: Path, wanted: set[str]) -> None:
    """Keep launches from now on."""
    enqueue = PreparedLaunch.enqueue
    taken: set[str] = set()

    def read(queue: Any, buffer: Buffer) -> np.ndarray:
        data = np.empty(buffer.shape, buffer.dtype)
        if data.nbytes:
            cl.enqueue_copy(queue, data, buffer.mem)
        return data

    def kept(self: PreparedLaunch, queue: Any) -> Any:
        launch, sizes = self.launch, self.global_sizes
        program = launch.program
        name = kernels_of(source := kernel_source(program.path))[launch.kernel]
        if name in taken or 0 in sizes or not ({name, "all"} & wanted):
            return enqueue(self, queue)
        taken.add(name)
        args = []
        for argument in launch.args:
            value = argument.value
            if isinstance(value, Buffer):
                written = argument.access in (Access.WRITE, Access.UPDATE)
                args.append(TracedArgument(argument.name, read(queue, value), 0, written))
            elif isinstance(value, LocalMemory):
                args.append(TracedArgument(argument.name, None, value.nbytes))
            else:
                args.append(TracedArgument(argument.name, value))
        groups = (sizes[0] // self.local, sizes[1] if len(sizes) > 1 else 1)
        request = TraceRequest(
            *(source, program.defines, launch.kernel, args),
            *(self.local, groups, name),
        )
        event = enqueue(self, queue)
        folder = out / str(len(taken))
        folder.mkdir()
        write_request(folder, request, Sampling())
        for number, argument in enumerate(launch.args):
            if args[number].written:
                np.save(folder / f"after{number}.npy", read(queue, argument.value))
        return event

    PreparedLaunch.enqueue = kept  # type: ignore[method-assign]


def main(out: Path, cache: Path, wanted: set[str], cases: list[Case]) -> None:
    """Run ``cases``, each kernel kept once."""
    capture(out, wanted)
    for case in cases:
        run_case.suit_simulator(case.width, case.layout)
        getattr(run_case, case.what)(case, cache)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(
        *(Path(arguments[0]), Path(arguments[1]), set(arguments[2].split(","))),
        [Case(**json.loads(text)) for text in arguments[3:]],
    )
