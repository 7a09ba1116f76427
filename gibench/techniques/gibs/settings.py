"""What can be set of GIBS, and what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

from gibench.errors import BadInput

UNIFORM: Final = "uniform"
PERSPECTIVE: Final = "perspective"
MULTI_SCALE: Final = "multi-scale"
FLOORED: Final = "floored"
AUTO: Final = "auto"
BY_CAMERA: Final = "camera"
BY_RAYS: Final = "rays"


def _setting(default: Any, meaning: str, unit: str = "") -> Any:
    return field(default=default, metadata={"help": meaning, "unit": unit})


@dataclass(frozen=True)
class GibsSettings:
    """Every tunable of GIBS; defaults are Ekberg's (2022) where he gives one.

    Raises:
        BadInput: a value makes no sense.
    """

    surfels: int = _setting(
        50_000, "room for surfels; about 50 000 cover Sponza (Ekberg 2022, 5.1)", "surfels"
    )
    ray_budget: int = _setting(200_000, "most rays in a frame; more converge sooner", "rays")
    rays_per_surfel: float = _setting(
        1.0, "rays a surfel gets on average, within the budget", "rays"
    )
    radius_share: float = _setting(
        0.03, "a surfel's radius on screen; smaller is finer and dearer", "image heights"
    )
    smallest_radius: float = _setting(
        0.002, "least radius of a surfel near the camera", "scene diagonals"
    )
    grid: str = _setting(UNIFORM, "uniform (Ekberg 2022) or perspective (Brinck et al. 2021)")
    grid_cells: int = _setting(
        24, "cells along the longest side, or across the view; more make shorter lists", "cells"
    )
    entries_per_surfel: int = _setting(
        20, "room in the grid's lists per surfel (tuned; published takes 27)", "cells"
    )
    normal_stretch: float = _setting(
        4.0, "how much further a step off the surfel's plane counts; more leaks less"
    )
    estimator: str = _setting(
        FLOORED,
        "floored (right on average), or multi-scale (Ekberg 2022; steadier, but too dark where "
        "few rays bring most of the light)",
    )
    depth_moments: bool = _setting(True, "depth test against leaks; costs memory and time")
    ray_guiding: bool = _setting(False, "more rays where light came from; costs memory")
    placement: str = _setting(
        AUTO,
        "camera: on what it sees (Ekberg 2022); rays: also where surfels' rays hit a bare surface, "
        "as long as recycling has no cause; auto: rays, and camera as published",
    )
    placement_threshold: float = _setting(1.0, "place where coverage is less")
    bare_threshold: float = _setting(
        0.1, "a surface that rays hit is bare where coverage is less; more fills sooner, dearer"
    )
    bare_chance: float = _setting(
        1.0, "chance that a cell of the grid places on a bare surface that rays hit in it"
    )
    placement_chance: float = _setting(0.08, "chance that a tile places; more overlap, sooner full")
    recycle_chance: float = _setting(0.05, "chance per frame that recycling looks at a surfel")
    recycle_unseen_frames: int = _setting(
        300, "frames out of sight after which age speaks fully for recycling", "frames"
    )
    recycle_distance: float = _setting(
        1.0, "distance at which it speaks fully for recycling", "scene diagonals"
    )
    recycle_pressure_from: float = _setting(0.7, "share of IDs taken from which recycling begins")
    recycle_coverage: float = _setting(6.0, "coverage beyond which a surfel is one too many")

    def __post_init__(self) -> None:
        for name in ("surfels", "ray_budget", "grid_cells", "entries_per_surfel"):
            self._require(name, getattr(self, name) >= 1, "at least 1")
        for name in (
            "rays_per_surfel",
            "radius_share",
            "smallest_radius",
            "placement_threshold",
            "bare_threshold",
            "recycle_unseen_frames",
            "recycle_distance",
            "recycle_coverage",
        ):
            self._require(name, getattr(self, name) > 0, "greater than 0")
        self._require("normal_stretch", self.normal_stretch >= 1, "at least 1")
        self._require("grid_cells", self.grid_cells <= 512, "at most 512")
        self._require("grid_cells", self.grid_cells >= 2, "at least 2")
        self._require("surfels", self.surfels <= 2**22, "at most 4194304")
        for name in ("placement_chance", "bare_chance", "recycle_chance"):
            self._require(name, 0 <= getattr(self, name) <= 1, "from 0 to 1")
        self._require(
            "recycle_pressure_from", 0 <= self.recycle_pressure_from < 1, "from 0 to below 1"
        )
        self._require(
            "grid", self.grid in (UNIFORM, PERSPECTIVE), f"'{UNIFORM}' or '{PERSPECTIVE}'"
        )
        self._require(
            "estimator",
            self.estimator in (FLOORED, MULTI_SCALE),
            f"'{FLOORED}' or '{MULTI_SCALE}'",
        )
        self._require(
            "placement",
            self.placement in (AUTO, BY_CAMERA, BY_RAYS),
            f"'{AUTO}', '{BY_CAMERA}' or '{BY_RAYS}'",
        )
        if self.grid == PERSPECTIVE:
            # 64 across are 2 million cells.
            self._require("grid_cells", self.grid_cells <= 64, "at most 64 in a perspective grid")

    def by_rays(self, published: bool) -> bool:
        """Whether surfels are placed where rays hit bare surface, too."""
        return self.placement == BY_RAYS or (self.placement == AUTO and not published)

    def _require(self, name: str, holds: bool, what: str) -> None:
        value = getattr(self, name)
        if not holds or (isinstance(value, float) and not math.isfinite(value)):
            raise BadInput(f"{name} = {value} must be {what}", where=f"setting gibs.{name}")
