"""What a user may set of surfel caches."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

from gibench.errors import BadInput
from gibench.techniques.parts.probe_volume import AUTO, Counts, parse_counts
from gibench.techniques.surfel_cache.bake.hierarchy import EXACT, HIERARCHIES, MOST_EXACT

STORED, RUNTIME = "stored", "runtime"
PROJECTIONS: Final = (STORED, RUNTIME)
BANDS: Final = (2, 3, 4)
MOST_LINKS: Final = 4096
MOST_EXPONENT: Final = 1024.0


def _setting(default: Any, meaning: str, unit: str = "", **more: Any) -> Any:
    return field(default=default, metadata={"help": meaning, "unit": unit, **more})


@dataclass(frozen=True)
class SurfelCacheSettings:
    """Settings of surfel caches; the defaults are Jendersie et al. 2016's moderate ones (table 2).

    Raises:
        BadInput: a value makes no sense.
    """

    surfels: int = _setting(
        32768, "samples of the scene's light; finer light close to caches for time", "surfels"
    )
    links: int = _setting(
        128, "senders that light a cache; steadier light for time and memory", "links"
    )
    sh_bands: int = _setting(
        3, "bands of spherical harmonics in a cache, 2 to 4: 2 are smooth, 4 are for gloss"
    )
    projection: str = _setting(
        STORED,
        "stored: links hold coefficients; runtime: a direction and a solid angle, projected in the "
        "frame, for less memory and a little accuracy",
    )
    caches: int = _setting(
        10_000, "caches that the light map aims for; sharper light for time and memory", "caches"
    )
    grid: str = _setting(
        AUTO,
        "caches along x, y and z of the grid that lights what moves, for instance 16x8x8; auto: as "
        "many as a tenth of 'caches' allows",
        "caches",
    )
    leave_out: bool = _setting(
        True, "leave out caches inside geometry; off: they darken what lies beside them"
    )
    hierarchy: str = _setting(
        "clustering",
        "clustering (agglomerative by a neighbour graph), exact (by all pairs, up to "
        f"{MOST_EXACT} surfels) or kd-tree (baked sooner, more light bleeds)",
    )
    relaxation: int = _setting(
        10, "times that surfels are pushed apart; more even light for baking time", "steps"
    )
    exponent: float = _setting(
        0.0, "of a glossy lobe besides the diffuse one, of 'gloss'; 0 for none, 20 is slight gloss"
    )
    gloss: float = _setting(0.2, "share of light that the glossy lobe reflects, where there is one")
    bounces: bool = _setting(
        True, "feed the caches' light of the last frame back, for many bounces; off: one"
    )

    def __post_init__(self) -> None:
        if self.links < 1:
            raise BadInput(f"{self.links} links per cache", mend="give 1 or more")
        if self.links > MOST_LINKS:
            raise BadInput(f"{self.links} links per cache", mend=f"give {MOST_LINKS} or fewer")
        if self.surfels < 1:
            raise BadInput(f"{self.surfels} surfels", mend="give 1 or more")
        if self.links > self.surfels:
            raise BadInput(
                f"{self.links} links per cache, but {self.surfels} surfels",
                mend="give as many surfels as links or more",
            )
        if self.sh_bands not in BANDS:
            raise BadInput(f"sh_bands is {self.sh_bands}", mend="use 2, 3 or 4")
        if self.projection not in PROJECTIONS:
            raise BadInput(
                f"projection is '{self.projection}'", mend=f"use {' or '.join(PROJECTIONS)}"
            )
        if self.caches < 1:
            raise BadInput(f"{self.caches} caches on the map", mend="give 1 or more")
        parse_grid(self.grid)
        if self.hierarchy not in HIERARCHIES:
            raise BadInput(f"hierarchy is '{self.hierarchy}'", mend=f"use {', '.join(HIERARCHIES)}")
        if self.hierarchy == EXACT and self.surfels > MOST_EXACT:
            raise BadInput(
                f"hierarchy is exact with {self.surfels} surfels",
                mend=f"use clustering, or {MOST_EXACT} surfels or fewer",
            )
        if self.relaxation < 0:
            raise BadInput(f"relaxation is {self.relaxation}", mend="give 0 or more")
        if not (math.isfinite(self.exponent) and 0 <= self.exponent <= MOST_EXPONENT):
            raise BadInput(f"exponent is {self.exponent}", mend=f"give 0 to {MOST_EXPONENT:g}")
        if not 0 <= self.gloss <= 1:
            raise BadInput(f"gloss is {self.gloss}", mend="give 0 to 1")

    @property
    def coefficients(self) -> int:
        """Of a cache, per channel."""
        return self.sh_bands**2


def parse_grid(text: str) -> Counts | None:
    """Caches along x, y and z, ``16x8x8``; None for automatic.

    Raises:
        BadInput: it is not that, or there are none.
    """
    try:
        return parse_counts(text)
    except BadInput:
        raise BadInput(
            f"grid is '{text}'", mend="give three whole numbers of 1 or more: 16x8x8"
        ) from None
