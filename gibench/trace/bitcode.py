"""The LLVM bitcode that PoCL makes of a program."""

from __future__ import annotations

import re
from functools import cache as once
from pathlib import Path
from typing import Any

from gibench.errors import BadInput, CannotRun
from gibench.trace.request import TraceRequest

_NAME = b"/program.bc"
_MAGIC = b"BC\xc0\xde"
"""LLVM, "LLVM Bitcode File Format", "LLVM IR Magic Number"."""


def built_here(request: TraceRequest) -> bytes | None:
    """The bitcode of a request's program, by the PoCL of this process, which builds in a fifth of
    the time that a new process takes to load the compiler, and has most programs in its cache.

    None where there is no PoCL, the program does not build, or PoCL packs its binaries otherwise:
    :func:`bitcode_of` knows why.
    """
    import pyopencl as cl

    from gibench.device import build_program

    try:
        context = _context()
        if context is None:
            return None
        built = build_program(context, request.source, request.defines)
        return _packed(built.get_info(cl.program_info.BINARIES)[0])
    except (cl.Error, CannotRun):
        return None


def bitcode_of(request: TraceRequest, cache: Path) -> bytes:
    """The same by a process that was started for it.

    Args:
        request: what is traced.
        cache: PoCL's cache folder, empty; this process was started with it.

    Raises:
        BadInput: PoCL's compiler refuses the program.
        CannotRun: there is no PoCL here.
    """
    import pyopencl as cl

    from gibench.device import build_program

    context = _context()
    if context is None:
        raise CannotRun("tracing needs PoCL", mend="pip install 'pyopencl[pocl]'")
    try:
        build_program(context, request.source, request.defines)
    except cl.Error as error:
        lines = [line.strip() for line in str(error).split("\n")]
        told = next((line for line in lines if line.startswith("error:")), lines[0])
        told = re.sub(r"\S*tempfile_\w+\.cl:", "line ", told.removeprefix("error: "))
        raise BadInput(f"does not build: {told}", where=request.label) from error
    found = list(cache.rglob("program.bc"))
    if not found:
        raise CannotRun("PoCL left no bitcode in its cache", where=request.label)
    return found[0].read_bytes()


@once
def _context() -> Any:
    """A context of the first device, if that is PoCL's: it holds what the compiler has loaded."""
    import pyopencl as cl

    from gibench.device import list_devices

    device = list_devices()[0]
    return cl.Context([device]) if "Portable" in device.platform.name else None


def _packed(binary: bytes) -> bytes | None:
    """The bitcode among the files of PoCL's binary: each is a name, its length and its content."""
    begin = binary.find(_NAME) + len(_NAME)
    length = int.from_bytes(binary[begin : begin + 4], "little")
    found = binary[begin + 4 : begin + 4 + length]
    return found if found.startswith(_MAGIC) and len(found) == length else None
