"""What a user may set of irradiance probes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gibench.techniques.parts.captured_probes.settings import CapturedProbeSettings


@dataclass(frozen=True)
class IrradianceProbeSettings(CapturedProbeSettings):
    """Nothing of their own: what is captured is directly lit, one bounce, unless told otherwise."""

    published_bounces: ClassVar[str] = "1"
    visibility: ClassVar[bool] = False
