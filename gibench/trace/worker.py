"""The process that a kernel is traced in: ``python -m gibench.trace.worker FOLDER``."""

from __future__ import annotations

import json
import math
import resource
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from gibench.errors import GibenchError
from gibench.trace.bitcode import bitcode_of
from gibench.trace.execute import Machine, record
from gibench.trace.instrument import Instrumented, TooLarge, instrument
from gibench.trace.lower import lower
from gibench.trace.request import read_request

CACHE = "pocl"
"""Folder of PoCL's cache beneath the request's."""
BITCODE = "program.bc"
"""The program's bitcode, beside the request where it is known."""


def trace(folder: Path) -> None:
    """Trace the request in ``folder`` and put what it did beside it.

    Raises:
        GibenchError: it cannot be traced.
    """
    request, sampling = read_request(folder)
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(sampling.timeout), most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    known = folder / BITCODE
    bitcode = known.read_bytes() if known.is_file() else bitcode_of(request, folder / CACHE)
    instrumented = _instrumented(bitcode, request.kernel, sampling.unroll)
    machine = Machine(instrumented, request, sampling.words)
    progress = folder / "group"
    found = record(machine, request, sampling, lambda group: _tell(progress, group))
    np.savez(folder / "tables.npz", **asdict(instrumented.tables))
    np.savez(folder / "chains.npz", **instrumented.chains._asdict())
    arrays = {name: value for name, value in asdict(found).items() if isinstance(value, np.ndarray)}
    for name, value in arrays.items():
        np.save(folder / f"{name}.npy", value)
    place = 0
    for number, argument in enumerate(request.args):
        if argument.is_buffer or argument.data is None:
            if argument.written and sampling.whole:
                np.save(folder / f"out{number}.npy", machine.arena.view(place))
            place += 1
    told = {"too_large": found.too_large, "names": machine.names,
            "locals": [list(each) for each in instrumented.locals],
            "constants": machine.constants}  # fmt: skip
    (folder / "done.json").write_text(json.dumps(told), encoding="utf-8")


def _instrumented(bitcode: bytes, kernel: str, unroll: bool) -> Instrumented:
    """The kernel, its loops unrolled if that is asked for and its blocks stay small enough."""
    try:
        return instrument(lower(bitcode, kernel, unroll), kernel)
    except TooLarge:
        return instrument(lower(bitcode, kernel), kernel)


def _tell(path: Path, group: int) -> None:
    path.write_text(str(group), encoding="utf-8")


def main(folder: Path) -> None:
    """Trace, or leave the reason why not."""
    try:
        trace(folder)
    except GibenchError as error:
        told = {"what": error.what, "where": error.where, "mend": error.mend,
                "code": error.exit_code}  # fmt: skip
        (folder / "refused.json").write_text(json.dumps(told), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
