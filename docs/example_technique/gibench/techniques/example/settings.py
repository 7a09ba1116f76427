"""What a user may set of the example."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gibench.errors import BadInput
from gibench.techniques.parts.probe_volume import Counts, parse_counts


@dataclass(frozen=True)
class ExampleSettings:
    """Each field is an axis: ``--set example.reach=1 --set example.reach=2``.

    Raises:
        BadInput: a value makes no sense.
    """

    reach: float = field(
        default=1.0,
        metadata={"help": "a ray that meets nothing nearer counts as open", "unit": "m"},
    )
    rays: int = field(
        default=256, metadata={"help": "rays a probe; more for a longer bake", "unit": "rays"}
    )
    counts: str = field(
        default="4x4x4", metadata={"help": "probes along x, y and z", "unit": "probes"}
    )
    ambient: float = field(
        default=0.1, metadata={"help": "light that comes from where it is open", "unit": "W/m2/sr"}
    )

    def __post_init__(self) -> None:
        for name in ("reach", "ambient"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise BadInput(f"{name} is {value}", mend="give a finite number above 0")
        if self.rays < 1:
            raise BadInput(f"{self.rays} rays a probe", mend="give 1 or more")
        _ = self.grid

    @property
    def grid(self) -> Counts:
        """Probes along x, y and z."""
        counts = parse_counts(self.counts)
        if counts is None:
            raise BadInput(f"counts is '{self.counts}'", mend="give three numbers: 4x4x4")
        return counts
