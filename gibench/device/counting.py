"""The rays of a launch, counted by an instrumented build of its kernel."""

from __future__ import annotations

from typing import NamedTuple

from gibench.device.device import Device
from gibench.device.launch import Launch
from gibench.device.program import COUNT_RAYS


class RayCounts(NamedTuple):
    """Rays that a launch traced through the scene.

    Attributes:
        closest: those that look for the closest hit.
        occluded: those that look for any hit: shadow rays.
    """

    closest: int
    occluded: int


def count_rays(device: Device, launch: Launch, workgroup_size: int) -> RayCounts:
    """Run ``launch`` once more and count its rays; it writes what it always writes.

    Raises:
        CannotRun: the launch would break the profile or the kernel's own limits.
        GibenchError: its kernel traces no rays.
    """
    closest, occluded = device.counted(launch, workgroup_size, COUNT_RAYS.name)
    return RayCounts(int(closest), int(occluded))
