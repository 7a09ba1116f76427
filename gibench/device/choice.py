"""Which device runs where none is named: a GPU that computes right, else PoCL."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

import pyopencl as cl

from gibench.device.able import lacks
from gibench.errors import CannotRun

TRIAL_S = 30.0
RIGHT = "gibench: right"
"""What :mod:`gibench.device.try_device` prints of a device that computes right."""

Trial = Callable[[int], str | None]


def trial(number: int) -> str | None:
    """Run a small kernel on device ``number`` in a process of its own, within ``TRIAL_S``.

    Returns:
        What went wrong, None where the result is right.
    """
    command = [sys.executable, "-m", "gibench.device.try_device", str(number)]
    try:
        ran = subprocess.run(command, capture_output=True, text=True, timeout=TRIAL_S)
    except subprocess.TimeoutExpired:
        return f"no answer within {TRIAL_S:g} s"
    if RIGHT in ran.stdout.splitlines():
        return None
    if ran.returncode == 1 and ran.stdout.strip():
        return ran.stdout.strip().splitlines()[-1]
    return f"the process of a small kernel ended with {ran.returncode}"


def default_device(devices: Sequence[Any], tried: Trial = trial) -> tuple[Any, str]:
    """The device to run on, and in words why.

    Args:
        devices: as :func:`gibench.device.list_devices` has them, PoCL's first.
        tried: what says of the device of a number why it cannot be used, or None.

    Raises:
        CannotRun: no GPU computes right, and there is neither PoCL nor a CPU to fall back on.
    """
    refused, others = [], []
    for number, device in enumerate(devices):
        if not device.type & cl.device_type.GPU:
            if device.type & cl.device_type.CPU or "Portable" in device.platform.name:
                others.append(device)
            continue
        problem = lacks(device) or tried(number)
        if problem is None:
            return device, "a GPU"
        refused.append(f"{device.name.strip()} is not used ({problem})")
    why = "; ".join(refused) or "no GPU was found"
    if not others:
        raise CannotRun(
            f"no device to run on: {why}",
            mend="install PoCL, which runs on any CPU (pip install 'pyopencl[pocl]'), or take one "
            "all the same with --device N",
        )
    return others[0], why
