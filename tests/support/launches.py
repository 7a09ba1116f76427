"""Launches of single kernels in tests: arguments in order, their names taken from the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gibench.device import Access, Argument, Buffer, Launch, Program


def launch_of(program: Program, kernel: str, values: Sequence[Any], **sizes: Any) -> Launch:
    """The launch of ``kernel`` with ``values`` in the kernel's order."""
    parameters = program.parameters(kernel, program.kernel(kernel))
    args = []
    for value, parameter in zip(values, parameters, strict=True):
        access = Access.READ if parameter.constant else Access.UPDATE
        args.append(Argument(parameter.name, value, access if isinstance(value, Buffer) else None))
    return Launch(program.spec, kernel, args, **sizes)
