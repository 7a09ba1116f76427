"""Launches of single kernels and passes in tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gibench.device import Access, Argument, Buffer, Launch, Program
from gibench.measure.session.enqueue import prepare_pass
from gibench.techniques.parts.frame_passes import frame_passes
from gibench.techniques.technique import Technique


def launch_of(program: Program, kernel: str, values: Sequence[Any], **sizes: Any) -> Launch:
    """The launch of ``kernel`` with ``values`` in its order, by the names that it gives them."""
    parameters = program.parameters(kernel, program.kernel(kernel))
    args = []
    for value, parameter in zip(values, parameters, strict=True):
        access = Access.READ if parameter.constant else Access.UPDATE
        args.append(Argument(parameter.name, value, access if isinstance(value, Buffer) else None))
    return Launch(program.spec, kernel, args, **sizes)


def run_pass(technique: Technique, name: str, size: int) -> None:
    """One pass alone, ``size`` work-items per group; the programs of the others are not built."""
    (declared,) = [item for item in frame_passes(technique) if item.name == name]
    prepared = prepare_pass(technique.device, declared, size)
    assert prepared.status == "ok", prepared.problem
    for launch in prepared.launches:
        launch.enqueue(technique.device.queue)
