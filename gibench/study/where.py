"""The machine that a study's frames are timed on, where that is not this one."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gibench.device.selection import select_cl_device
from gibench.measure.machine.environment import device_record, environment, versions
from gibench.measure.machine.roofs import measure_roofs
from gibench.profiles import DeviceProfile
from gibench.work import Executor, Worker, elsewhere


@dataclass(frozen=True)
class _Asked:
    """Whose limits bind, and the number of the OpenCL device: a unit that is timed."""

    profile: DeviceProfile
    device: int | None
    name: str = "the machine's roofs"
    timed: bool = True


def timed_where(
    executor: Executor | None, profile: DeviceProfile, device: int | None
) -> dict[str, Any] | None:
    """For the record: environment, versions, device and roofs of where ``executor`` has frames
    timed; None where that is this process.

    Raises:
        CannotRun: no worker has its machine to itself.
    """
    if executor is None or not elsewhere(executor) or not hasattr(executor, "timed_on"):
        return None
    (found,) = executor.run(_describe, None, [_Asked(profile, device)])
    return found


def _describe(common: None, asked: _Asked, worker: Worker) -> dict[str, Any]:
    cl_device = select_cl_device(asked.device)
    with worker.alone():
        roofs = measure_roofs(asked.profile, cl_device)
    return {
        "environment": environment(),
        "versions": versions(),
        "device": device_record(cl_device),
        "roofs": {"start": asdict(roofs)},
    }
