"""Device profiles: the limits of a device that is modelled, each figure with its source."""

from gibench.profiles.machine import MACHINE_FIGURES, Interval, Machine
from gibench.profiles.profile import (
    DeviceProfile,
    Figure,
    built_in_profiles,
    load_profile,
    profile_text,
    read_profile,
    unlimited_profile,
)

__all__ = [
    "MACHINE_FIGURES",
    "DeviceProfile",
    "Figure",
    "Interval",
    "Machine",
    "built_in_profiles",
    "load_profile",
    "profile_text",
    "read_profile",
    "unlimited_profile",
]
