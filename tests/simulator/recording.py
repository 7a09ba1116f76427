"""Which kernels of kernels_cl there are, and which of them a process has enqueued.

A kernel is named by the file that defines it and its own name, ``rays/trace.cl:trace_closest``:
variants share kernel names.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pyopencl as cl

from gibench.resources import data

_MARKS = re.compile(
    r'^#line \d+ "(?P<file>[^"]+)"$'
    r"|__kernel\b\s*(?:__attribute__\(\((?:[^()]|\([^()]*\))*\)\)\s*)?void\s+(?P<kernel>\w+)",
    re.MULTILINE,
)


@cache
def kernels_of(source: str) -> dict[str, str]:
    """Kernel name to full name, of a source as ``kernel_source`` expands it."""
    found, file = {}, ""
    for mark in _MARKS.finditer(source):
        file = mark["file"] or file
        if mark["kernel"]:
            found[mark["kernel"]] = f"{file}:{mark['kernel']}"
    return found


def all_kernels() -> set[str]:
    """The full name of every kernel in kernels_cl."""
    root = Path(str(data("kernels_cl")))
    found = set()
    for path in root.rglob("*.cl"):
        name, text = path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")
        here = set(kernels_of(f'#line 1 "{name}"\n{text}').values())
        assert len(here) == len(re.findall(r"^\s*(?:__)?kernel\b", text, re.MULTILINE)), name
        found |= here
    return found


@contextmanager
def recorded_kernels() -> Iterator[set[str]]:
    """The set that the full name of every kernel enqueued in the block is added to."""
    ran: set[str] = set()
    enqueue, call = cl.enqueue_nd_range_kernel, cl.Kernel.__call__

    def record(kernel: Any) -> None:
        names = kernels_of(kernel.get_info(cl.kernel_info.PROGRAM).source)
        ran.add(names[kernel.function_name])

    def enqueueing(queue: Any, kernel: Any, *args: Any, **kwargs: Any) -> Any:
        record(kernel)
        return enqueue(queue, kernel, *args, **kwargs)

    def calling(kernel: Any, *args: Any, **kwargs: Any) -> Any:
        record(kernel)
        return call(kernel, *args, **kwargs)

    cl.enqueue_nd_range_kernel, cl.Kernel.__call__ = enqueueing, calling
    try:
        yield ran
    finally:
        cl.enqueue_nd_range_kernel, cl.Kernel.__call__ = enqueue, call
