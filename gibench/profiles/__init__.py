"""Device profiles: the limits of a device that is modelled, each figure with its source."""

from gibench.profiles.profile import (
    DeviceProfile,
    Figure,
    built_in_profiles,
    load_profile,
    profile_text,
    unlimited_profile,
)

__all__ = [
    "DeviceProfile",
    "Figure",
    "built_in_profiles",
    "load_profile",
    "profile_text",
    "unlimited_profile",
]
