"""A launch of the project's as something to trace."""

from __future__ import annotations

from gibench.device import Access, Buffer, Device, LocalMemory, PreparedLaunch
from gibench.trace.request import TracedArgument, TraceRequest


def request_of(device: Device, prepared: PreparedLaunch) -> TraceRequest:
    """The request for a launch as it would run now: reads its buffers from the device.

    Raises:
        GibenchError: its program cannot be built.
    """
    launch = prepared.launch
    program = device.built(launch)
    args = []
    for argument in launch.args:
        value, written = argument.value, argument.access in (Access.WRITE, Access.UPDATE)
        if isinstance(value, Buffer):
            args.append(TracedArgument(argument.name, device.read(value), 0, written))
        elif isinstance(value, LocalMemory):
            args.append(TracedArgument(argument.name, None, value.nbytes))
        else:
            args.append(TracedArgument(argument.name, value))
    first, *rows = prepared.global_sizes
    groups = (first // prepared.local, *rows)
    label = f"{launch.program.path}: {launch.kernel}"
    return TraceRequest(
        program.source, launch.program.defines, launch.kernel, args, prepared.local, groups, label
    )
