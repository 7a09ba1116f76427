"""Does a configuration fit the profile's memory, and how many receivers would?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from gibench.device import Device
from gibench.errors import CannotRun, GibenchError
from gibench.profiles import DeviceProfile
from gibench.scene.model import Scene
from gibench.techniques.job import Job, World
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.registry import TechniqueSpec

FEWEST_RECEIVERS = 64
"""What --fit goes down to."""

RECEIVERS = "--receivers"

_NO_LIMIT = 1 << 62
_MARGIN = 0.97  # receivers come in whole clusters and rows: a little less than in proportion


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
        mend = f"lower {_lower(self.spec)}"
        if has_receivers(self.spec):
            mend = f"no number of receivers fits: {mend}"
        if most:
            mend = f"--receivers {most} may fit (or pass --fit)"
        raise CannotRun(
            f"{self.spec.name} on {self.scene.name} with {receivers:,} receivers asks for at least "
            f"{asked:,} bytes; profile {self.profile.name} has {there:,}",
            mend=mend,
        )


@dataclass(frozen=True)
class Demand:
    """What a technique really allocates when no profile stops it, bytes.

    Attributes:
        total: all buffers together.
        largest: the largest buffer.
        fixed_total: what of ``total`` no number of receivers changes: scene and image.
        fixed_largest: the largest buffer of that part.
    """

    total: int
    largest: int
    fixed_total: int = 0
    fixed_largest: int = 0

    def receivers_that_fit(self, profile: DeviceProfile, receivers: int) -> int:
        """About how many of ``receivers`` would fit, taking the rest in proportion to them.

        0 where the fixed part alone is too much.
        """
        if self.fixed_largest > profile.max_buffer_bytes:
            return 0
        share = min(
            (profile.memory_budget_bytes - self.fixed_total) / (self.total - self.fixed_total),
            profile.max_buffer_bytes / self.largest,
            1.0,
        )
        return max(0, int(receivers * share * _MARGIN))

    def refusal(
        self, spec: TechniqueSpec, scene: Scene, profile: DeviceProfile, receivers: int
    ) -> CannotRun:
        """The error that says the bytes asked, the bytes there, and what would fit."""
        fewer = self.receivers_that_fit(profile, receivers) if has_receivers(spec) else 0
        mend = f"lower {_any_of(spec.memory_options)}"
        if fewer >= FEWEST_RECEIVERS:
            mend = f"about --receivers {fewer} would fit (or pass --fit)"
        return CannotRun(
            f"{spec.name} on {scene.name} with {receivers:,} receivers asks for {self.total:,} "
            f"bytes, {self.largest:,} of them in one buffer; profile {profile.name} has "
            f"{profile.memory_budget_bytes:,} and allows {profile.max_buffer_bytes:,} in one",
            mend=mend,
        )


def has_receivers(spec: TechniqueSpec) -> bool:
    """Whether fewer receivers take less of the device's memory."""
    return RECEIVERS in spec.memory_options


def _lower(spec: TechniqueSpec) -> str:
    return _any_of([option for option in spec.memory_options if option != RECEIVERS])


def _any_of(options: Sequence[str]) -> str:
    """``a, b or c``."""
    return " or ".join(filter(None, (", ".join(options[:-1]), options[-1])))


def measure_demand(spec: TechniqueSpec, device: Device, job: Job, world: World) -> Demand | None:
    """What ``spec`` allocates on ``device`` without the profile's memory limits.

    None where it cannot be told: the executing device itself has too little, or something else
    than memory forbids it.
    """
    limits = device.profile
    lifted = replace(limits, memory_budget_bytes=_NO_LIMIT, max_buffer_bytes=_NO_LIMIT)
    try:
        fixed = _fixed_part(Device(lifted, device.cl_device), job, world)
        free = Device(lifted, device.cl_device)
        spec.create(free, job, world)
    except (GibenchError, MemoryError):
        return None
    ledger = free.memory
    demand = Demand(
        ledger.peak_bytes, max(ledger.allocated.values(), default=0), sum(fixed), max(fixed)
    )
    if demand.total <= limits.memory_budget_bytes and demand.largest <= limits.max_buffer_bytes:
        return None
    return demand


def _fixed_part(device: Device, job: Job, world: World) -> list[int]:
    """Bytes of every buffer that no number of receivers changes."""
    FrameScene.of(device, job.shot, world)
    return list(device.memory.allocated.values())
