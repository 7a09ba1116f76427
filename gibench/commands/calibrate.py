"""``gibench calibrate``, and :func:`gibench.commands.calibrate.calibrate`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import pandas as pd

from gibench.device.selection import select_cl_device
from gibench.measure.machine import calibration
from gibench.profiles import DeviceProfile, load_profile
from gibench.profiles.written import profile_toml


@dataclass(frozen=True)
class Calibration:
    """What a device's own microbenchmarks say of its profile.

    Attributes:
        profile: with the measured figures.
        figures: a row for each measured figure: figure, low, nominal, high, before (how many times
            from low to high it was), now.
        toml: the text of the profile's file.
    """

    profile: DeviceProfile
    figures: pd.DataFrame
    toml: str


def calibrate(
    profile: str, device: int | None = None, tell: Callable[[str], None] = lambda _: None
) -> Calibration:
    """Measure a profile's machine part on the device itself, as ``gibench calibrate`` does.

    Args:
        profile: built-in profile, or a TOML file, of the device.
        device: number of the OpenCL device, as ``gibench devices`` lists them.
        tell: is given a line before each figure is measured.

    Raises:
        BadInput: no such profile or device, or the profile is not this device's.
        CannotRun: there is no OpenCL device.
    """
    before = load_profile(profile)
    cl_device = select_cl_device(device)
    found = calibration.calibrate(before, cl_device, tell)
    name = f"{before.name}-calibrated"
    title = f"{before.title}, calibrated on {cl_device.name.strip()}"
    after = replace(calibration.calibrated(before, found), name=name, title=title)
    rows = [
        {
            "figure": figure,
            "low": interval.low,
            "nominal": interval.nominal,
            "high": interval.high,
            "before": getattr(before.machine, figure).spread,
            "now": interval.spread,
        }
        for figure, interval in found.items()
    ]
    return Calibration(after, pd.DataFrame(rows), profile_toml(after))
