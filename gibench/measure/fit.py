"""Does a configuration fit the profile's memory, and how many receivers would?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gibench.errors import CannotRun
from gibench.profiles import DeviceProfile
from gibench.scene.model import Scene
from gibench.techniques.registry import TechniqueSpec


@dataclass(frozen=True)
class Footprint:
    """What a technique will take of a device's memory at least, told before baking."""

    spec: TechniqueSpec
    scene: Scene
    settings: Any
    width: int
    height: int
    profile: DeviceProfile

    def floor(self, receivers: int) -> int:
        """Bytes it takes at least with ``receivers``."""
        return self.spec.memory_floor(self.scene, receivers, self.settings, self.width, self.height)

    def fits(self, receivers: int) -> bool:
        """Whether the floor is within the budget."""
        return self.floor(receivers) <= self.profile.memory_budget_bytes

    def most_receivers(self, at_most: int) -> int:
        """The largest number of receivers up to ``at_most`` whose floor fits; 0 if none does."""
        if self.fits(at_most):
            return at_most
        if at_most < 1 or not self.fits(1):
            return 0
        low, high = 1, at_most  # low fits, high does not
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.fits(middle) else (low, middle)
        return low

    def check(self, receivers: int) -> None:
        """Refuse what cannot fit.

        Raises:
            CannotRun: says the bytes asked, the bytes there, and the settings that would fit.
        """
        asked = self.floor(receivers)
        there = self.profile.memory_budget_bytes
        if asked <= there:
            return
        most = self.most_receivers(receivers)
        mend = f"--receivers {most} would fit, or pass --fit" if most else "no receiver count fits"
        if not most:
            mend = "no number of receivers fits: lower --probes, --sh-order or --resolution"
        raise CannotRun(
            f"{self.spec.name} on {self.scene.name} with {receivers:,} receivers asks for at least "
            f"{asked:,} bytes; profile {self.profile.name} has {there:,}",
            mend=mend,
        )
