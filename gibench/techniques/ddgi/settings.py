"""What a user may set of DDGI, and what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Final

from gibench.errors import BadInput
from gibench.techniques.parts.probe_volume import (
    AUTO,
    Counts,
    Triple,
    parse_counts,
    parse_triple,
)

STORAGES: Final = ("fp32", "fp16")
LINEAR: Final = "linear"
ENCODED: Final = "encoded"
# Gamma by average. Of linear averages it decides the precision alone: a root is cheap, and fp16
# then holds what is up to 4e9.
_GAMMAS: Final = {LINEAR: 2.0, ENCODED: 5.0}
# Of linear averages, frame n from 0 keeps at most n / (n + START_FRAMES): light that goes round is
# found by its power, not by its exponential, until that reaches the hysteresis (after 130 frames).
_START_FRAMES: Final = 4


def _setting(default: Any, meaning: str, unit: str = "") -> Any:
    return field(default=default, metadata={"help": meaning, "unit": unit})


@dataclass(frozen=True)
class DdgiSettings:
    """Every tunable of DDGI; defaults are those of the public SDK (RTXGI-DDGI 1.3.7).

    Raises:
        BadInput: a value makes no sense.
    """

    # -- the volume ----------------------------------------------------------------------------
    probes: int | None = _setting(
        None,
        "most probes in the volume; if unset, 8 for each that the scene says, or where it says "
        "none as many as its surfaces are close, 216 to 2000; finer light for time and memory "
        "(Ekberg 2022: 2000)",
        "probes",
    )
    counts: str = _setting(
        AUTO, "probes along x, y and z, for instance 20x10x10; auto: as 'probes' allows", "probes"
    )
    origin: str = _setting(AUTO, "first probe's place x,y,z; auto: the volume fits the scene", "m")
    spacing: str = _setting(AUTO, "probe distances x,y,z; auto: the volume fits the scene", "m")
    scrolling: bool = _setting(
        False, "the volume stays centred on the camera, moved by whole spacings"
    )
    # -- rays ----------------------------------------------------------------------------------
    rays: int = _setting(
        256, "rays per probe and frame, fixed rays included; less noise for slower tracing", "rays"
    )
    fixed_rays: int = _setting(
        32,
        "of them not rotated and not blended, for relocation and classification; none are cast "
        "where both are off",
        "rays",
    )
    # -- maps ----------------------------------------------------------------------------------
    irradiance_texels: int = _setting(
        6, "side of a probe's irradiance map without its border", "texels"
    )
    distance_texels: int = _setting(
        14, "side of a probe's distance map without its border", "texels"
    )
    storage: str = _setting(
        "fp16", "fp16 or fp32 maps; 16 bits take half the memory and are rounded at random"
    )
    # -- blending ------------------------------------------------------------------------------
    hysteresis: float = _setting(
        0.97,
        "share of a texel that stays from frame to frame; calmer for slower reaction. Linear "
        "averages begin with less, so that light has been round sooner",
    )
    average: str = _setting(
        LINEAR,
        "linear (right on average): of irradiance, over frames, texels and probes; or encoded (the "
        "public SDK: steadier, sooner dark when a light goes out, too dark where few rays bring "
        "most of the light)",
    )
    gamma: float | None = _setting(
        None,
        "irradiance is stored to the power 1/gamma; 2 if unset, 5 (the SDK's) where the average is "
        "of what is stored",
    )
    irradiance_threshold: float = _setting(
        0.25, "fall of a stored value from which hysteresis drops by 0.75; of encoded averages"
    )
    brightness_threshold: float = _setting(
        0.10, "rise of a stored luminance from which a change counts a quarter; of encoded averages"
    )
    distance_exponent: float = _setting(
        50.0, "sharpness of the distance maps: rays weigh by this power of the cosine"
    )
    random_backface_threshold: float = _setting(
        0.1, "share of rotated rays on backs from which a probe's irradiance is not updated"
    )
    # -- relocation and classification ---------------------------------------------------------
    relocation: bool = _setting(True, "move probes out of and away from surfaces")
    classification: bool = _setting(True, "switch off probes inside and far from surfaces")
    fixed_backface_threshold: float = _setting(
        0.25, "share of fixed rays on backs from which a probe counts as inside a surface"
    )
    min_frontface_distance: float = _setting(
        0.25,
        "distance that relocation keeps from surfaces; the SDK's 1 unit is a whole room here",
        "least spacings",
    )
    # -- application ---------------------------------------------------------------------------
    normal_bias: float = _setting(
        0.1,
        "gathering is done this far off the surface; leaks less, detaches corners (the SDK's unit "
        "is the scene's, made for spacings near 1)",
        "least spacings",
    )
    view_bias: float = _setting(0.1, "and this far towards the viewer", "least spacings")
    visibility_floor: float = _setting(0.05, "least weight of a probe the Chebyshev test rejects")
    crush_threshold: float = _setting(0.2, "weights below are squared twice more (w^3 / t^2)")

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise BadInput(f"{item.name} is {value}", mend="give a finite number")
        if self.probes is not None and self.probes < 1:
            raise BadInput(f"a volume of {self.probes} probes", mend="use --probes 1 or more")
        if self.storage not in STORAGES:
            raise BadInput(f"storage is '{self.storage}'", mend=f"use {' or '.join(STORAGES)}")
        if self.rays < 1:
            raise BadInput(f"{self.rays} rays per probe", mend="give 1 or more")
        if self.probes_move and not 1 <= self.fixed_rays < self.rays:
            raise BadInput(
                f"{self.fixed_rays} of {self.rays} rays are fixed",
                mend="keep at least one fixed and one rotated ray, or switch relocation and "
                "classification off",
            )
        for name in ("irradiance_texels", "distance_texels"):
            if not 2 <= getattr(self, name) <= 64:
                raise BadInput(f"{name} is {getattr(self, name)}", mend="give 2 to 64")
        if not 0 <= self.hysteresis < 1:
            raise BadInput(
                f"hysteresis is {self.hysteresis}", mend="give 0 or more and less than 1"
            )
        if self.average not in _GAMMAS:
            raise BadInput(f"average is '{self.average}'", mend=f"use {LINEAR} or {ENCODED}")
        for name, value in (
            ("gamma", self.exponent),
            ("distance_exponent", self.distance_exponent),
        ):
            if value < 1.0:
                raise BadInput(f"{name} is {value}", mend="give 1 or more")
        for name in _NOT_NEGATIVE:
            if getattr(self, name) < 0:
                raise BadInput(f"{name} is {getattr(self, name)}", mend="give 0 or more")
        for name in _SHARES:
            if not 0 <= getattr(self, name) <= 1:
                raise BadInput(f"{name} is {getattr(self, name)}", mend="give 0 to 1")
        counts, origin, spacing = self.given_counts, self.given_origin, self.given_spacing
        if (origin is None) != (spacing is None):
            raise BadInput("origin and spacing go together", mend="give both or neither")
        if origin is not None and counts is None:
            raise BadInput("origin and spacing without counts", mend="give counts=20x10x10, say")
        if spacing is not None and min(spacing) <= 0:
            raise BadInput(f"spacing is {self.spacing}", mend="give three positive lengths")

    @property
    def probes_move(self) -> bool:
        """Whether anything asks for fixed rays: relocation or classification."""
        return self.relocation or self.classification

    @property
    def exponent(self) -> float:
        """Gamma, as set or as the average wants it."""
        return _GAMMAS[self.average] if self.gamma is None else float(self.gamma)

    def kept(self, blended: int) -> float:
        """Share of a texel that stays in a frame after ``blended`` others."""
        if self.average == ENCODED:
            return float(self.hysteresis)
        return min(float(self.hysteresis), blended / (blended + _START_FRAMES))

    @property
    def fixed(self) -> int:
        """Fixed rays that are cast per probe."""
        return self.fixed_rays if self.probes_move else 0

    @property
    def blended(self) -> int:
        """Rotated rays per probe, those that are blended."""
        return self.rays - self.fixed

    @property
    def given_counts(self) -> Counts | None:
        """Probes along x, y and z, or None for automatic."""
        return parse_counts(self.counts)

    @property
    def given_origin(self) -> Triple | None:
        """The first probe's place, m, or None for automatic."""
        return parse_triple("origin", self.origin)

    @property
    def given_spacing(self) -> Triple | None:
        """Distances between probes, m, or None for automatic."""
        return parse_triple("spacing", self.spacing)


_NOT_NEGATIVE = ("irradiance_threshold", "brightness_threshold", "normal_bias", "view_bias",
                 "min_frontface_distance")  # fmt: skip
_SHARES = ("random_backface_threshold", "fixed_backface_threshold", "visibility_floor",
           "crush_threshold")  # fmt: skip
