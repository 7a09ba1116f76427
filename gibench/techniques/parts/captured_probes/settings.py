"""What a user may set of captured probes, whatever their technique."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Final

from gibench.errors import BadInput
from gibench.scene.model import Scene
from gibench.techniques.parts.octahedral_maps import STORED
from gibench.techniques.parts.probe_volume import (
    AUTO,
    Volume,
    fit_counts,
    fit_volume,
    given_volume,
    parse_counts,
    parse_triple,
)

ANY: Final = "any"
"""Bounces without an end."""
STATIC: Final = "static"
MOST_STEPS: Final = 8
"""Of roughness; maps of 128 texels are down to the least side at the fifth."""
RELIT: Final = "relit"


def setting(default: Any, meaning: str, unit: str = "") -> Any:
    """A field of a settings dataclass."""
    return field(default=default, metadata={"help": meaning, "unit": unit})


@dataclass(frozen=True)
class CapturedProbeSettings:
    """Every tunable of captured probes.

    Attributes:
        published_bounces: what ``bounces=auto`` stands for where probes are lit once.
        visibility: whether probes keep distances and points are tested against them.

    Raises:
        BadInput: a value makes no sense.
    """

    published_bounces: ClassVar[str] = ANY
    visibility: ClassVar[bool] = False

    # -- the volume ----------------------------------------------------------------------------
    probes: int = setting(
        16, "most probes in the volume; finer light for time and memory", "probes"
    )
    counts: str = setting(
        AUTO, "probes along x, y and z, for instance 4x2x2; auto: as 'probes' allows", "probes"
    )
    origin: str = setting(AUTO, "first probe's place x,y,z; auto: the volume fits the scene", "m")
    spacing: str = setting(AUTO, "probe distances x,y,z; auto: the volume fits the scene", "m")
    # -- capture and maps ----------------------------------------------------------------------
    capture_texels: int = setting(
        256, "side of a face of the cube that is captured around a probe", "texels"
    )
    map_texels: int = setting(
        128,
        "side of a probe's octahedral maps without their border: sharper for time and memory",
        "texels",
    )
    sharpness: float | None = setting(
        None,
        "a captured texel counts for a map's texel by this power of the cosine between them; "
        "unset: half as much at the texel's edge as in its middle, 7230 for 128 texels",
    )
    backface_threshold: float = setting(
        0.25,
        "share of captured texels that show backs from which a probe lies inside a surface and "
        "counts for nothing; 1: all probes count, as published",
    )
    gloss_steps: int = setting(
        0,
        "maps of radiance per probe, each prefiltered for a step of roughness from a mirror to the "
        "roughest, for what surfaces of less than full roughness or of metal mirror; 0: surfaces "
        "are diffuse, as in the published frame",
        "maps",
    )
    storage: str = setting("fp16", "fp16 or fp32 maps; 16 bits take half the memory")
    # -- light ---------------------------------------------------------------------------------
    update: str = setting(
        RELIT,
        "relit: a share of the probes is lit anew in every frame and follows lights that move; "
        "static: lit once when baked, as published",
    )
    bounces: str = setting(
        AUTO,
        "of indirect light: a number, 'any', or auto, which is as published where lit once and any "
        "where relit",
        "bounces",
    )
    relit_share: float = setting(
        1 / 16, "share of the probes that is relit in a frame: follows sooner for a slower frame"
    )
    far_from: float = setting(
        0.5, "a probe farther from the camera than this is relit less often", "volume diagonals"
    )
    far_slower: float = setting(4.0, "how many times less often")

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise BadInput(f"{item.name} is {value}", mend="give a finite number")
        if self.probes < 1:
            raise BadInput(f"a volume of {self.probes} probes", mend="use --probes 1 or more")
        if self.capture_texels < 2:
            raise BadInput(f"capture_texels is {self.capture_texels}", mend="give 2 or more")
        if self.map_texels < 2 or self.map_texels % 2:
            raise BadInput(
                f"map_texels is {self.map_texels}", mend="give an even number of 2 or more"
            )
        if self.sharpness is not None and self.sharpness < 0:
            raise BadInput(f"sharpness is {self.sharpness}", mend="give 0 or more")
        if not 0 <= self.backface_threshold <= 1:
            raise BadInput(f"backface_threshold is {self.backface_threshold}", mend="give 0 to 1")
        if self.storage not in STORED:
            raise BadInput(f"storage is '{self.storage}'", mend=f"use {' or '.join(STORED)}")
        if self.gloss_steps < 0 or self.gloss_steps == 1 or self.gloss_steps > MOST_STEPS:
            raise BadInput(
                f"gloss_steps is {self.gloss_steps}", mend=f"give 0, or 2 to {MOST_STEPS}"
            )
        if self.update not in (RELIT, STATIC):
            raise BadInput(f"update is '{self.update}'", mend=f"use {RELIT} or {STATIC}")
        if not 0 < self.relit_share <= 1:
            raise BadInput(f"relit_share is {self.relit_share}", mend="give more than 0, at most 1")
        if self.far_from < 0:
            raise BadInput(f"far_from is {self.far_from}", mend="give 0 or more")
        if self.far_slower < 1:
            raise BadInput(f"far_slower is {self.far_slower}", mend="give 1 or more")
        self._check_bounces()
        self._check_volume()

    def _check_bounces(self) -> None:
        if self.bounces in (AUTO, ANY):
            return
        if not self.bounces.isdecimal() or int(self.bounces) < 1:
            raise BadInput(f"bounces is '{self.bounces}'", mend="give 1 or more, any or auto")
        if self.relit and int(self.bounces) > 1:
            raise BadInput(
                f"probes that are relit cannot stop at {self.bounces} bounces",
                mend="give bounces=1 or bounces=any, or update=static",
            )

    def _check_volume(self) -> None:
        counts = parse_counts(self.counts)
        origin = parse_triple("origin", self.origin)
        spacing = parse_triple("spacing", self.spacing)
        if (origin is None) != (spacing is None):
            raise BadInput("origin and spacing go together", mend="give both or neither")
        if origin is not None and counts is None:
            raise BadInput("origin and spacing without counts", mend="give counts=4x2x2, say")
        if spacing is not None and min(spacing) <= 0:
            raise BadInput(f"spacing is {self.spacing}", mend="give three positive lengths")

    @property
    def relit(self) -> bool:
        """Whether probes are lit anew while frames run."""
        return self.update == RELIT

    @property
    def bounce_count(self) -> int | None:
        """Bounces of indirect light; None for any number."""
        asked = self.bounces
        if asked == AUTO:
            asked = ANY if self.relit else self.published_bounces
        return None if asked == ANY else int(asked)

    @property
    def texels(self) -> int:
        """Texels of a map without its border."""
        return self.map_texels**2

    @property
    def map_sharpness(self) -> float:
        """The exponent of the captured texels' weights."""
        return texel_sharpness(self.map_texels) if self.sharpness is None else self.sharpness

    def volume(self, scene: Scene) -> Volume:
        """Where the probes are.

        Raises:
            BadInput: the volume misses the scene.
        """
        counts = parse_counts(self.counts)
        origin = parse_triple("origin", self.origin)
        spacing = parse_triple("spacing", self.spacing)
        if counts is not None and origin is not None and spacing is not None:
            return given_volume(scene, counts, origin, spacing)
        low, high = scene.bounds
        return fit_volume(low, high, counts or fit_counts(low, high, self.probes))

    def relit_probes(self, probes: int) -> int:
        """Of so many probes those that are relit in a frame."""
        return math.ceil(self.relit_share * probes)


def texel_sharpness(side: int) -> float:
    """The power of the cosine that halves within half a texel's width of a map of ``side`` texels.

    A texel of the mean solid angle 4 pi / side^2, taken for a square, has the half width
    h = sqrt(pi) / side; cos^n(h) = 1 / 2 for n = 2 ln 2 / h^2, nearly.
    """
    return 2 * math.log(2) * side**2 / math.pi
