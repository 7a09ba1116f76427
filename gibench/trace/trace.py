"""Tracing a launch in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Longs
from gibench.errors import BadInput, CannotRun, CheckFailed, GibenchError
from gibench.trace.bitcode import built_here
from gibench.trace.dependence import Chains
from gibench.trace.extra import require_extra
from gibench.trace.instrument import Tables
from gibench.trace.request import Sampling, TraceRequest, write_request
from gibench.trace.worker import BITCODE, CACHE

_WALL = 20
"""Times the processor's seconds that the clock may show: a process that sleeps is ended, too."""
CONSTANT_CACHE = 8 << 10
"""Bytes of a unit's cache of constant memory (NVIDIA, "CUDA C++ Programming Guide", "Technical
Specifications per Compute Capability"); larger arrays are charged as global memory.
"""


@dataclass(frozen=True)
class Ranges:
    """Where buffers and local memory lie (n of them).

    Attributes:
        names: of arguments, local arrays and constant ones.
        start: address (n,).
        end: address behind it (n,).
        is_local: whether it is local memory (n,).
        is_constant: whether a constant cache serves it (n,).
        is_given: whether it is an argument's, and so lies among other buffers (n,).
    """

    names: tuple[str, ...]
    start: Longs
    end: Longs
    is_local: npt.NDArray[np.bool_]
    is_constant: npt.NDArray[np.bool_]
    is_given: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Trace:
    """Everything that whole sampled work-groups of a launch did.

    Attributes:
        request: what was traced, without its buffers' content.
        tables: of the kernel's blocks and accesses.
        chains: which of its loads wait for which.
        ranges: where its buffers lie.
        words: the record (see :mod:`gibench.trace.instrument`).
        ends: where every work-item's words end (groups * items,).
        groups: the traced groups (n,).
        run: the run of adjacent groups that each belongs to (n,).
        outputs: content of the buffers that the kernel may write, by argument, after a whole
            launch; empty otherwise.
    """

    request: TraceRequest
    tables: Tables
    chains: Chains
    ranges: Ranges
    words: Longs
    ends: Longs
    groups: Longs
    run: Longs
    outputs: Mapping[str, npt.NDArray[Any]]

    @property
    def total_groups(self) -> int:
        """Groups of the launch."""
        return int(np.prod(self.request.groups))

    @property
    def local_bytes(self) -> int:
        """Local memory of a group."""
        return int((self.ranges.end - self.ranges.start)[self.ranges.is_local].sum())


def trace_launch(request: TraceRequest, sampling: Sampling | None = None) -> Trace:
    """Trace a launch.

    Raises:
        BadInput: its program does not build, or has no such kernel.
        CannotRun: the extra or PoCL is missing, or it is too large to trace.
        CheckFailed: the kernel faulted, or did not end in time.
    """
    require_extra()
    sampling = sampling or Sampling()
    if int(np.prod(request.groups)) == 0:
        raise CannotRun("it has nothing to do in this frame", where=request.label)
    with tempfile.TemporaryDirectory(prefix="gibench-trace-") as name:
        folder = Path(name)
        (folder / CACHE).mkdir()
        write_request(folder, request, sampling)
        bitcode = built_here(request)
        if bitcode is not None:
            (folder / BITCODE).write_bytes(bitcode)
        _run(folder, request, sampling)
        return _read(folder, request, sampling)


def _run(folder: Path, request: TraceRequest, sampling: Sampling) -> None:
    environment = {**os.environ, "POCL_CACHE_DIR": str(folder / CACHE), "PYOPENCL_NO_CACHE": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    command = [sys.executable, "-m", "gibench.trace.worker", str(folder)]
    try:
        done = subprocess.run(
            command,
            env=environment,
            timeout=_WALL * sampling.timeout,
            capture_output=True,
            text=True,
            errors="replace",
        )
    except subprocess.TimeoutExpired as error:
        raise _endless(folder, request, sampling) from error
    refused = folder / "refused.json"
    if refused.is_file():
        raise _refusal(json.loads(refused.read_text(encoding="utf-8")))
    if done.returncode == -signal.SIGXCPU:
        raise _endless(folder, request, sampling)
    if done.returncode < 0:
        number = -done.returncode
        known = {each.value: each.name for each in signal.Signals}
        kind = known.get(number, f"signal {number}")
        raise CheckFailed(
            f"the kernel faulted ({kind}){_in_group(folder)}: it may touch memory outside its "
            "buffers",
            where=request.label,
        )
    if done.returncode or not (folder / "done.json").is_file():
        lines = done.stderr.strip().split("\n")
        raise GibenchError(f"the tracing process failed: {lines[-1]}", where=request.label)


def _endless(folder: Path, request: TraceRequest, sampling: Sampling) -> CheckFailed:
    return CheckFailed(
        f"did not end within {sampling.timeout:g} s{_in_group(folder)}", where=request.label
    )


def _in_group(folder: Path) -> str:
    told = folder / "group"
    return f" in work-group {told.read_text(encoding='utf-8')}" if told.is_file() else ""


def _refusal(told: Mapping[str, Any]) -> GibenchError:
    kinds = {1: GibenchError, BadInput.exit_code: BadInput, CannotRun.exit_code: CannotRun}
    return kinds[told["code"]](told["what"], where=told["where"], mend=told["mend"])


def _read(folder: Path, request: TraceRequest, sampling: Sampling) -> Trace:
    told = json.loads((folder / "done.json").read_text(encoding="utf-8"))
    if told["too_large"] and not sampling.whole:
        raise CannotRun(
            f"too large to trace: one work-group has more than {sampling.words:,} blocks and "
            "accesses",
            where=request.label,
            mend="trace it at fewer rays, probes or receivers, or smaller work-groups",
        )
    arrays = {
        name: np.load(folder / f"{name}.npy")
        for name in ("words", "ends", "groups", "run", "range_start", "range_end")
    }
    ranges = _ranges(told, request, arrays.pop("range_start"), arrays.pop("range_end"))
    outputs = {}
    for number, argument in enumerate(request.args):
        file = folder / f"out{number}.npy"
        if file.is_file() and isinstance(argument.data, np.ndarray):
            data = argument.data
            outputs[argument.name] = np.load(file).view(data.dtype).reshape(data.shape)
    return Trace(
        request=request,
        tables=Tables(**np.load(folder / "tables.npz")),
        chains=Chains(**np.load(folder / "chains.npz")),
        ranges=ranges,
        outputs=outputs,
        **arrays,
    )


def _ranges(told: Mapping[str, Any], request: TraceRequest, start: Longs, end: Longs) -> Ranges:
    names, constants = tuple(told["names"]), set(told["constants"])
    own = {name for name, _ in told["locals"]}
    given = {argument.name: argument for argument in request.args}
    local = [n in own or (n in given and given[n].data is None) for n in names]
    fits = end - start <= CONSTANT_CACHE
    return Ranges(
        names=names,
        start=start,
        end=end,
        is_local=np.array(local, bool),
        is_constant=np.array([name in constants for name in names], bool) & fits,
        is_given=np.array([name in given for name in names], bool),
    )
