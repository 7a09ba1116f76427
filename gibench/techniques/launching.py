"""A declared launch made ready."""

from __future__ import annotations

from gibench.device import Device, Launch, PreparedLaunch

__all__ = ["PreparedLaunch", "prepare_launch"]


def prepare_launch(device: Device, launch: Launch, workgroup_size: int) -> PreparedLaunch:
    """:meth:`Device.prepare`."""
    return device.prepare(launch, workgroup_size)
