"""``gibench conform``, and :func:`gibench.commands.conform.conform`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.commands.bounds import within_bounds
from gibench.conform.cases import cases, kernels
from gibench.conform.judge import NO_ORACLE, judge_cases, judge_kernels
from gibench.device import list_devices
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput, CheckFailed, GibenchError
from gibench.measure.machine.environment import device_record, environment, versions
from gibench.resources import data


@dataclass(frozen=True)
class Conformance:
    """What was found on a device.

    Attributes:
        kernels: a row for each kernel: kernel, status, sizes, off, why.
        record: the same as plain data, with the device, its driver and the versions.
        error: which kernels are wrong, or None.
    """

    kernels: pd.DataFrame = field(repr=False)
    record: dict[str, Any] = field(repr=False)
    error: GibenchError | None


@within_bounds
def conform(
    device: int | None = None,
    seed: int = 0,
    time_limit: float = 120.0,
    kernel_tree: str | Path | None = None,
) -> Conformance:
    """Compare every kernel with its oracle, as ``gibench conform`` does; its help says more.

    Raises:
        BadInput: there is no such device or kernel tree.
        CannotRun: there is no OpenCL device.
    """
    cl_device = select_cl_device(device)
    root = None if kernel_tree is None else Path(kernel_tree).resolve()
    if root is not None and not root.is_dir():
        raise BadInput("no such folder", where=root, mend="give a folder like kernels_cl")
    number = list_devices().index(cl_device)
    all_cases = cases()
    there = kernels(data("kernels_cl") if root is None else root)
    found = judge_cases(all_cases, number, seed, time_limit, root)
    judged = judge_kernels(there, all_cases, found)
    rows = [
        {
            "kernel": kernel,
            "status": one.status,
            "sizes": " ".join(map(str, one.sizes)),
            "off": None if one.status == NO_ORACLE or not one.sizes else one.off,
            "why": one.why,
        }
        for kernel, one in judged.items()
    ]
    record = {
        "schema_version": 1,
        "kind": "conform",
        "seed": seed,
        "device": device_record(cl_device),
        "environment": environment(),
        "versions": versions(),
        "kernels": [
            {**row, "sizes": list(judged[str(row["kernel"])].sizes), "off": _number(row["off"])}
            for row in rows
        ],
    }
    failed = [kernel for kernel, one in judged.items() if one.failed]
    return Conformance(pd.DataFrame(rows), record, _verdict(failed))


def _number(value: Any) -> float | str | None:
    """JSON has no infinity."""
    return str(value) if value == float("inf") else value


def _verdict(failed: list[str]) -> GibenchError | None:
    if not failed:
        return None
    more = f" and {len(failed) - 5} more" if len(failed) > 5 else ""
    told = "1 kernel is" if len(failed) == 1 else f"{len(failed)} kernels are"
    return CheckFailed(f"{told} not right: {', '.join(failed[:5])}{more}")
