"""The OpenCL devices of this machine, and the one that is asked for."""

from __future__ import annotations

import logging
import os
from functools import cache
from typing import Any

import pyopencl as cl

from gibench.device.able import cannot_run, lacks
from gibench.device.choice import default_device
from gibench.device.pocl import name_processor
from gibench.device.pocl_cache import cache_folder, check_folder
from gibench.errors import BadInput, CannotRun

_LOG = logging.getLogger(__name__)


def list_devices() -> list[Any]:
    """Every OpenCL device of every platform, PoCL's first.

    Raises:
        CannotRun: there is no OpenCL platform at all.
    """
    try:
        platforms = cl.get_platforms()
    except cl.LogicError as error:
        raise CannotRun(
            "no OpenCL platform was found",
            mend="install one: pip install 'pyopencl[pocl]' brings PoCL, which runs on any CPU",
        ) from error
    devices = []
    for platform in sorted(platforms, key=lambda p: "Portable" not in p.name):
        found = _devices_of(platform)
        if not found and "Portable" in platform.name:
            check_folder(cache_folder())  # without which PoCL has no device
        devices += found
    if not devices:
        raise CannotRun(
            "the OpenCL platforms found offer no device",
            mend="install one: pip install 'pyopencl[pocl]' brings PoCL, which runs on any CPU",
        )
    for device in devices:
        _name_once(device)
    return devices


def _devices_of(platform: Any) -> list[Any]:
    """The platform's devices; of one that cannot load, none, and a warning names it."""
    try:
        return list(platform.get_devices())
    except cl.Error as error:
        if "DEVICE_NOT_FOUND" not in str(error):
            _LOG.warning("OpenCL platform '%s' skipped: %s", platform.name.strip(), error)
        return []


@cache
def _name_once(cl_device: Any) -> None:
    """A process looks at a device once: it takes 10 ms and more."""
    name_processor(cl_device)


def select_cl_device(index: int | None) -> Any:
    """The device number ``index`` of :func:`list_devices`; for None the one that pyopencl's
    variable PYOPENCL_CTX names, else a GPU that computes right, else PoCL or another CPU. Which one
    and why is logged (``gibench.device``, at level INFO), unless it is one CPU alone.

    Raises:
        BadInput: there is no such number, or the variable names no device, or several.
        CannotRun: nothing can run on it (:func:`gibench.device.able.lacks`), or there is none to
            fall back on.
    """
    chosen = _selected(index)
    if problem := lacks(chosen):
        raise cannot_run(chosen, problem)
    return chosen


def _selected(index: int | None) -> Any:
    devices = list_devices()
    asked = os.environ.get("PYOPENCL_CTX")
    if index is None:
        chosen, why = _default(tuple(devices)) if asked is None else (_by_variable(asked), "")
        # Of one CPU alone there is nothing to say: every table names it.
        if len(devices) > 1 or not chosen.type & cl.device_type.CPU:
            _LOG.info(
                "on %s (%s): %s; --device N takes another, 'gibench devices' lists them",
                chosen.name.strip(),
                chosen.platform.name.strip(),
                why or f"PYOPENCL_CTX={asked}",
            )
        return chosen
    if not 0 <= index < len(devices):
        raise BadInput(
            f"no OpenCL device number {index}",
            mend=f"'gibench devices' lists the {len(devices)} there are, counted from 0",
        )
    if asked is not None and _by_variable(asked) != devices[index]:
        _LOG.warning("PYOPENCL_CTX=%s not followed: --device %d is given", asked, index)
    return devices[index]


@cache
def _default(devices: tuple[Any, ...]) -> tuple[Any, str]:
    """A process tries its devices once."""
    return default_device(devices)


def first_device() -> Any:
    """The device that PYOPENCL_CTX names, else the first of :func:`list_devices`, PoCL's.

    Raises:
        BadInput: the variable names no device, or several.
    """
    asked = os.environ.get("PYOPENCL_CTX")
    return list_devices()[0] if asked is None else _by_variable(asked)


def _by_variable(asked: str) -> Any:
    """The device that pyopencl takes PYOPENCL_CTX for."""
    mend = "write PLATFORM:DEVICE, numbers or parts of names, or use --device N"
    try:
        chosen = cl.choose_devices(interactive=False, answers=asked.split(":"))
    except (RuntimeError, LookupError, ValueError, cl.Error) as error:
        raise BadInput(
            f"it names no device ({error})", where=f"PYOPENCL_CTX={asked}", mend=mend
        ) from error
    if len(chosen) != 1:
        raise BadInput(f"it names {len(chosen)} devices", where=f"PYOPENCL_CTX={asked}", mend=mend)
    return chosen[0]
