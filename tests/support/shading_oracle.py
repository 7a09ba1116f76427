"""The float64 oracle of shading, which travels with the package, and a device for tests."""

from __future__ import annotations

from dataclasses import replace

from gibench.device import Device, Layout
from gibench.profiles import load_profile
from gibench.techniques.parts.conformance.shading import (
    Lit,
    View,
    bilinear,
    direct_irradiance,
    light_gain,
    pixel_directions,
    quantised,
    render,
)

__all__ = [
    "Lit",
    "View",
    "bilinear",
    "direct_irradiance",
    "light_gain",
    "open_device",
    "pixel_directions",
    "quantised",
    "render",
]


def open_device(
    simd_width: int = 1, local_memory: int = 16384, layout: Layout | None = None
) -> Device:
    """A device whose profile allows any work-group size up to 512."""
    profile = replace(
        load_profile("vega56"),
        simd_width=simd_width,
        max_workgroup_size=512,
        local_memory_bytes=local_memory,
    )
    return Device(profile, layout=layout)
