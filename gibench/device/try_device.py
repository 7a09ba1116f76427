"""A small kernel on one device, in a process of its own, which is all that a fault can end."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pyopencl as cl

from gibench.device.choice import RIGHT
from gibench.device.selection import list_devices

_SOURCE = """
__kernel void halve_and_add(__global const float *a, __global float *b, const int count)
{
    const int i = get_global_id(0);
    if (i < count)
        b[i] = 0.5f * a[i] + (float)i;
}
"""


def _halved(device: Any) -> str | None:
    """Why a small kernel's result on ``device`` is not right."""
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    count = 1000
    a = np.random.default_rng(0).random(count, np.float32)
    flags = cl.mem_flags
    given = cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=a)
    taken = cl.Buffer(context, flags.WRITE_ONLY, a.nbytes)
    kernel = cl.Kernel(cl.Program(context, _SOURCE).build(), "halve_and_add")
    kernel.set_args(given, taken, np.int32(count))
    cl.enqueue_nd_range_kernel(queue, kernel, (1024,), (64,))  # its own check, not a launch
    b = np.empty_like(a)
    cl.enqueue_copy(queue, b, taken)
    queue.finish()
    right = np.allclose(b, 0.5 * a.astype(np.float64) + np.arange(count), rtol=1e-6)
    return None if right else "a small kernel's result is wrong"


def main(number: int) -> int:
    """Try device ``number`` here; prints what is wrong, or that all is right."""
    try:
        problem = _halved(list_devices()[number])
    except Exception as error:  # whatever a driver may raise
        problem = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    sys.stdout.write(f"{problem or RIGHT}\n")
    return 1 if problem else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
