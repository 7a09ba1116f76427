"""What a user may set of light field probes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

from gibench.errors import BadInput
from gibench.techniques.parts.captured_probes.settings import (
    ANY,
    CapturedProbeSettings,
    setting,
    texel_sharpness,
)
from gibench.techniques.parts.probe_volume import AUTO, Volume

RAYS: Final = "rays"
IRRADIANCE: Final = "irradiance"
_BIAS: Final = 0.01
"""m, in a scene of a room's size; our choice."""
_LEAST_BIAS, _MOST_BIAS = 1 / 1000, 1 / 30
"""Of the least distance between probes, so that neither a scene of millimetres lies within it nor
one of kilometres knows nothing of it."""


@dataclass(frozen=True)
class LightFieldProbeSettings(CapturedProbeSettings):
    """What the visibility test adds.

    Raises:
        BadInput: a value makes no sense.
    """

    published_bounces: ClassVar[str] = ANY
    visibility: ClassVar[bool] = True

    distance_sharpness: float | None = setting(
        None,
        "distances are averaged by this power of the cosine: softer edges of visibility, more "
        "leaks for less of it; unset: as 'sharpness' where that is unset",
    )
    visibility_bias: float | None = setting(
        None,
        "taken off a point's distance before it is compared with the mean: its own surface does "
        "not hide it; unset: 0.01 m, at least a thousandth and at most a thirtieth of the least "
        "distance between probes",
        "m",
    )
    surface_bias: float | None = setting(
        None,
        "points are looked at this far off their surface, for the same reason; unset: as "
        "'visibility_bias' where that is unset",
        "m",
    )
    gather: str = setting(
        AUTO,
        "what lights the bounces after the first: rays, drawn at random and read from the maps "
        "that see where they end; irradiance, what the probes hold for a place; auto: rays where "
        "lit once, as published, irradiance where relit",
    )
    gather_rays: int = setting(
        1, "rays of a texel and bounce: less noise for a longer bake", "rays"
    )
    denoise: int = setting(
        2, "radius of the cross-bilateral filter that smooths what they find; 0: none", "texels"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("distance_sharpness", "visibility_bias", "surface_bias"):
            value = getattr(self, name)
            if value is not None and value < 0:
                raise BadInput(f"{name} is {value}", mend="give 0 or more")
        if self.gather not in (AUTO, RAYS, IRRADIANCE):
            raise BadInput(f"gather is '{self.gather}'", mend=f"use {RAYS}, {IRRADIANCE} or {AUTO}")
        if self.relit and self.gather == RAYS:
            raise BadInput(
                "probes that are relit gather from irradiance",
                mend="give gather=irradiance, or update=static",
            )
        if self.gather_rays < 1:
            raise BadInput(f"gather_rays is {self.gather_rays}", mend="give 1 or more")
        if self.denoise < 0 or self.denoise > self.map_texels:
            raise BadInput(
                f"denoise is {self.denoise}", mend=f"give 0 to {self.map_texels}, a map's side"
            )

    def surface_bias_in(self, volume: Volume) -> float:
        """How far off their surface points are looked at among probes of ``volume``, m."""
        return _fitting(volume) if self.surface_bias is None else self.surface_bias

    def visibility_bias_in(self, volume: Volume) -> float:
        """What is taken off a point's distance to probes of ``volume``, m."""
        return _fitting(volume) if self.visibility_bias is None else self.visibility_bias

    @property
    def bounce_rays(self) -> int:
        """Rays that further bounces are gathered by; 0: from irradiance."""
        return 0 if self.relit or self.gather == IRRADIANCE else self.gather_rays

    @property
    def filter_sharpness(self) -> float:
        """The exponent of the distances' filter."""
        if self.distance_sharpness is None:
            return texel_sharpness(self.map_texels)
        return self.distance_sharpness


def _fitting(volume: Volume) -> float:
    nearest = min(volume.spacing)
    return min(max(_BIAS, _LEAST_BIAS * nearest), _MOST_BIAS * nearest)
