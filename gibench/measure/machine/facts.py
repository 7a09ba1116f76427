"""What must be the same on all processes that compute parts of one result."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import gibench
from gibench.device.selection import select_cl_device
from gibench.errors import GibenchError
from gibench.measure.machine.environment import device_record, environment, machine_text
from gibench.resources import data
from gibench.work.cluster_worker import Facts

_PACKAGES = ("numpy", "scipy", "pyopencl", "pocl-binary-distribution", "embreex", "xatlas")


def facts_here() -> Facts:
    """Of this process: the code that results depend on, and the kind of machine."""
    code = [("gibench's sources", _sources()), ("Python", platform.python_version())]
    code += [(name, _version(name)) for name in _PACKAGES]
    try:
        device = device_record(select_cl_device(None))
    except GibenchError:
        device = {"platform": "no OpenCL", "driver": ""}
    return Facts(tuple(code), machine_text(environment(), device))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _sources() -> str:
    """SHA-256 of Python and OpenCL sources, its first digits."""
    digest = hashlib.sha256()
    for root, pattern in ((Path(gibench.__file__).parent, "*.py"), (data("kernels_cl"), "*.cl")):
        folder = Path(str(root))
        for file in sorted(folder.rglob(pattern)):
            digest.update(str(file.relative_to(folder)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
