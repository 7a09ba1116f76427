"""What a run was measured on: for ``run.json``. Nothing personal: no user, host or outside path."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import gibench
from gibench.device import vector_width

_PACKAGES = (
    *("numpy", "pandas", "scipy", "pyopencl", "pocl-binary-distribution", "embreex", "xatlas"),
    *("trimesh", "pillow", "rich", "typer"),
)
_VARIABLES = re.compile(r"^(POCL_|PYOPENCL_|OCL_|OMP_NUM_THREADS$)")
_PATH = re.compile(r"(?<![\w.~])~?/(?:[^\s/:;,'\"]+/)+([^\s/:;,'\"]+)")


def environment() -> dict[str, Any]:
    """The machine and the software, but for the OpenCL device."""
    import psutil

    return {
        "cpu": cpu_name(),
        "cores": psutil.cpu_count(logical=False),
        "threads": psutil.cpu_count(logical=True),
        "usable_threads": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else None,
        "governor": _governor(),
        "memory_bytes": int(psutil.virtual_memory().total),
        "os": _os_name(),
        "kernel": f"{platform.system()} {platform.release()}",
        "machine": platform.machine(),
        "python": platform.python_version(),
        "variables": {
            name: without_paths(value)
            for name, value in sorted(os.environ.items())
            if _VARIABLES.match(name)
        },
    }


def versions() -> dict[str, Any]:
    """Versions of gibench and of what it stands on; the git revision in a checkout."""
    found: dict[str, Any] = {"gibench": gibench.__version__}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found | {"git": _git()}


def device_record(cl_device: Any) -> dict[str, Any]:
    """The executing OpenCL device, its platform and driver."""
    return {
        "name": cl_device.name.strip(),
        "platform": cl_device.platform.name.strip(),
        "platform_version": cl_device.platform.version.strip(),
        "driver": cl_device.driver_version.strip(),
        "compute_units": int(cl_device.max_compute_units),
        "max_workgroup_size": int(cl_device.max_work_group_size),
        "local_memory_bytes": int(cl_device.local_mem_size),
        "global_memory_bytes": int(cl_device.global_mem_size),
        "vector_width_float": vector_width(cl_device),
    }


def machine_text(environment: Mapping[str, Any], device: Mapping[str, Any]) -> str:
    """The kind of a machine in words, from a record's environment and device: times of different
    kinds are not compared.
    """
    threads = environment.get("usable_threads") or environment.get("threads")
    memory = round((environment.get("memory_bytes") or 0) / 2**30)
    runtime = f"{device.get('platform')} {device.get('driver')}"
    return f"{environment.get('cpu')}, {threads} threads, {memory} GiB, {runtime}"


def cpu_name() -> str:
    """The processor's name as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def without_paths(text: str) -> str:
    """``text`` with every path cut to its last part, for what is written into a run's folder."""
    return _PATH.sub(r"\1", text)


def _governor() -> str | None:
    path = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return None


def _os_name() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return sys.platform


def _git() -> dict[str, Any] | None:
    """Revision and dirtiness of the checkout gibench runs from; None for an installed wheel."""
    root = Path(gibench.__file__).parent.parent
    if not (root / ".git").exists():
        return None

    def git(*arguments: str) -> str:
        run = subprocess.run(
            ["git", "-C", str(root), *arguments],
            capture_output=True,
            text=True,
            check=True,
            timeout=10,
        )
        return run.stdout.strip()

    try:
        return {"revision": git("rev-parse", "HEAD"), "dirty": bool(git("status", "--porcelain"))}
    except (OSError, subprocess.SubprocessError):
        return None
