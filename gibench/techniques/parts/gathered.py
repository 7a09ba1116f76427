"""A technique's light at the receivers, for those whose frames need no receivers on the device."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.device import Device, Launch
from gibench.scene.lightmap import Receivers
from gibench.techniques.technique import FloatArray


def gathered_at(
    receivers: Receivers,
    device: Device,
    launch: Callable[..., Launch],
    workgroup_size: int,
    more: Mapping[str, npt.NDArray[Any]] | None = None,
) -> FloatArray:
    """What ``launch`` computes at the receivers, (n, 3); they are on the device only meanwhile.

    Args:
        receivers: where.
        device: runs it.
        launch: of buffers of ``more``, positions (n, 3), normals (n, 3) and the result (n, 3).
        workgroup_size: of the launch.
        more: what else is uploaded for it, by name.

    Raises:
        CannotRun: they do not fit beside the technique.
    """
    held = []
    arrays = {
        **(more or {}),
        "gathered_position": receivers.position,
        "gathered_normal": receivers.normal,
        "gathered_irradiance": np.zeros((len(receivers), 3), np.float32),
    }
    try:
        for name, array in arrays.items():
            held.append(device.upload(name, array))
        device.enqueue(launch(*held), workgroup_size)
        found: FloatArray = device.read(held[-1])
        return found
    finally:
        device.release(*held)
