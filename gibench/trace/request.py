"""What is traced, as plain data in a folder: source, arguments, sizes; for another process."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:  # the process that a kernel is traced in needs no OpenCL
    from gibench.device import Define


@dataclass(frozen=True)
class TracedArgument:
    """An argument of a traced kernel.

    Attributes:
        name: the parameter's.
        data: a buffer's content, or a number of the type that the kernel takes; None of local
            memory.
        nbytes: of local memory; 0 of others.
        written: whether the kernel may write it.
    """

    name: str
    data: npt.NDArray[Any] | np.generic | None
    nbytes: int = 0
    written: bool = False

    @property
    def is_buffer(self) -> bool:
        """Whether it is a buffer in global memory."""
        return isinstance(self.data, np.ndarray)


@dataclass(frozen=True)
class TraceRequest:
    """A launch to trace.

    Attributes:
        source: OpenCL C, includes expanded.
        defines: its macros.
        kernel: the kernel's name.
        args: in the kernel's order.
        items: work-items per group.
        groups: number of groups along every dimension, one to three of them.
        label: for messages, ``srp/tuned.cl: probe_update``.
        sides: work-items of a group along every dimension; empty where all lie along the first.
    """

    source: str
    defines: Mapping[str, Define]
    kernel: str
    args: Sequence[TracedArgument]
    items: int
    groups: tuple[int, ...]
    label: str
    sides: tuple[int, ...] = ()

    @property
    def group_size(self) -> tuple[int, int, int]:
        """Work-items of a group along three dimensions."""
        return _three(self.sides or (self.items,))

    @property
    def group_count(self) -> tuple[int, int, int]:
        """Groups along three dimensions."""
        return _three(self.groups)


def _three(counts: Sequence[int]) -> tuple[int, int, int]:
    x, y, z = (*counts, 1, 1)[:3]
    return x, y, z


@dataclass(frozen=True)
class Sampling:
    """How much of a launch is traced.

    Attributes:
        runs: of adjacent groups, spread evenly over the launch.
        length: groups of a run.
        words: 64-bit words of the record, at most: one for every block and access of a work-item.
        seconds: no further group is begun after so many of the processor's, which others that
            compute at the same time do not use up.
        timeout: the process is ended after so many of those.
        whole: run every group, for what the launch leaves in its buffers.
        unroll: unroll loops, as compilers of GPUs do.
    """

    runs: int = 4
    length: int = 4
    words: int = 24 << 20
    seconds: float = 8.0
    timeout: float = 60.0
    whole: bool = False
    unroll: bool = False


def write_request(folder: Path, request: TraceRequest, sampling: Sampling) -> None:
    """Put a request into ``folder``."""
    entries = []
    for number, argument in enumerate(request.args):
        kind = "local" if argument.data is None else "buffer" if argument.is_buffer else "number"
        if argument.data is not None:
            np.save(folder / f"arg{number}.npy", np.atleast_1d(argument.data))
        entries.append(
            {
                "name": argument.name,
                "kind": kind,
                "nbytes": argument.nbytes,
                "written": argument.written,
            }
        )
    record = {
        "source": request.source,
        "defines": dict(request.defines),
        "kernel": request.kernel,
        "args": entries,
        "items": request.items,
        "groups": list(request.groups),
        "label": request.label,
        "sides": list(request.sides),
        "sampling": asdict(sampling),
    }
    (folder / "request.json").write_text(json.dumps(record), encoding="utf-8")


def read_request(folder: Path) -> tuple[TraceRequest, Sampling]:
    """The request in ``folder``."""
    record = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    sampling = Sampling(**record.pop("sampling"))
    args = []
    for number, entry in enumerate(record.pop("args")):
        kind = entry.pop("kind")
        data: Any = None
        if kind != "local":
            data = np.load(folder / f"arg{number}.npy")
            data = data if kind == "buffer" else data[0]
        args.append(TracedArgument(data=data, **entry))
    groups, sides = tuple(record.pop("groups")), tuple(record.pop("sides"))
    return TraceRequest(args=args, groups=groups, sides=sides, **record), sampling
