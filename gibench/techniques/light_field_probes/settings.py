"""What a user may set of light field probes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gibench.errors import BadInput
from gibench.techniques.parts.captured_probes.settings import (
    ANY,
    CapturedProbeSettings,
    setting,
    texel_sharpness,
)


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

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("distance_sharpness", "visibility_bias", "surface_bias"):
            value = getattr(self, name)
            if value is not None and value < 0:
                raise BadInput(f"{name} is {value}", mend="give 0 or more")

    @property
    def filter_sharpness(self) -> float:
        """The exponent of the distances' filter."""
        if self.distance_sharpness is None:
            return texel_sharpness(self.map_texels)
        return self.distance_sharpness
