"""Which device runs where none is named: a GPU that computes right, else PoCL."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pyopencl as cl

TRIAL_S = 30.0
_RIGHT = "gibench: right"
_SOURCE = """
__kernel void halve_and_add(__global const float *a, __global float *b, const int count)
{
    const int i = get_global_id(0);
    if (i < count)
        b[i] = 0.5f * a[i] + (float)i;
}
"""

Trial = Callable[[int], str | None]


def trial(number: int) -> str | None:
    """Run a small kernel on device ``number`` in a process of its own, within ``TRIAL_S``.

    Returns:
        What went wrong, None where the result is right.
    """
    command = [sys.executable, "-m", "gibench.device.choice", str(number)]
    try:
        ran = subprocess.run(command, capture_output=True, text=True, timeout=TRIAL_S)
    except subprocess.TimeoutExpired:
        return f"no answer within {TRIAL_S:g} s"
    if _RIGHT in ran.stdout.splitlines():
        return None
    if ran.returncode == 1 and ran.stdout.strip():
        return ran.stdout.strip().splitlines()[-1]
    return f"the process of a small kernel ended with {ran.returncode}"


def default_device(devices: Sequence[Any], tried: Trial = trial) -> tuple[Any, str]:
    """The device to run on, and in words why.

    Args:
        devices: as :func:`gibench.device.list_devices` has them, PoCL's first.
        tried: what says of the device of a number why it cannot be used, or None.
    """
    refused = []
    for number, device in enumerate(devices):
        if not device.type & cl.device_type.GPU:
            continue
        problem = tried(number)
        if problem is None:
            return device, "a GPU"
        refused.append(f"{device.name.strip()} is not used ({problem})")
    return devices[0], "; ".join(refused) or "no GPU was found"


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
    from gibench.device.device import list_devices

    try:
        problem = _halved(list_devices()[number])
    except Exception as error:  # whatever a driver may raise
        problem = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    sys.stdout.write(f"{problem or _RIGHT}\n")
    return 1 if problem else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
