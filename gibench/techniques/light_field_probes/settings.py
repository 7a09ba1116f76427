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
from gibench.techniques.parts.probe_volume import AUTO

RAYS: Final = "rays"
IRRADIANCE: Final = "irradiance"


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
    visibility_bias: float = setting(
        0.01, "taken off a point's distance before it is compared with the mean: its own surface "
        "does not hide it", "m",
    )  # fmt: skip
    surface_bias: float = setting(
        0.01, "points are looked at this far off their surface, for the same reason", "m"
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
