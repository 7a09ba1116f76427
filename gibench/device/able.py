"""What a device must have for anything to run on it, told before a driver tells it its own way."""

from __future__ import annotations

import re
from typing import Any, Final

import pyopencl as cl

from gibench.errors import CannotRun

LEAST_OPENCL: Final = (1, 2)
"""Of it are the kernels' language and what is asked of them (``-cl-kernel-arg-info``)."""


def lacks(cl_device: Any) -> str | None:
    """What a device lacks, in words; None where it has all that is needed.

    Nothing else is asked for: halves are only loaded and stored, which needs no ``cl_khr_fp16``;
    there are no images, no double precision and no second queue; what of local memory, buffers and
    work-groups is too much is found before a launch.
    """
    if not cl_device.available:
        return "it is not available"
    if not cl_device.compiler_available:
        return "it has no compiler"
    found = re.match(r"OpenCL (\d+)\.(\d+)", cl_device.version)
    if found is None or (int(found[1]), int(found[2])) < LEAST_OPENCL:
        return f"it is of {cl_device.version.strip()}, and OpenCL 1.2 is needed"
    if not cl_device.queue_properties & cl.command_queue_properties.PROFILING_ENABLE:
        return "it does not tell how long kernels take (no profiling)"
    return None


def cannot_run(cl_device: Any, problem: str) -> CannotRun:
    """That a device lacks something, as a user is told."""
    return CannotRun(
        f"nothing can run on {cl_device.name.strip()}: {problem}",
        mend="take another: --device N, of those that 'gibench devices' lists",
    )
