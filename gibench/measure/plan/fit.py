"""Does a configuration fit the profile's memory, and how many receivers would?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gibench.device import BufferSpec, Device, largest, total_bytes
from gibench.errors import BadInput, CannotRun
from gibench.profiles import DeviceProfile
from gibench.rays.bvh import build_bvh
from gibench.scene.model import Scene
from gibench.techniques.job import Job, Known, World
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.registry import TechniqueSpec

FEWEST_RECEIVERS = 64
"""What --fit goes down to."""

RECEIVERS = "--receivers"

_MARGIN = 0.97  # receivers come in whole clusters and rows: a little less than in proportion


@dataclass(frozen=True)
class Footprint:
    """What a technique will take of a device's memory at least, told before baking.

    Attributes:
        spec: the technique.
        known: the job and its scene.
    """

    spec: TechniqueSpec
    known: Known

    @property
    def profile(self) -> DeviceProfile:
        """Whose budget binds."""
        return self.known.job.profile

    def floor(self, receivers: int) -> int:
        """Bytes it takes at least with ``receivers``."""
        return total_bytes(self._least(receivers))

    def _least(self, receivers: int) -> list[BufferSpec]:
        return self.spec.buffers(replace(self.known, receivers=receivers))

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
        least = self._least(receivers)
        asked, there = total_bytes(least), self.profile.memory_budget_bytes
        # Of receivers on the device --fit leaves out what a single buffer has no room for.
        if asked <= there and (has_receivers(self.spec) or _within(least, self.profile)):
            return
        most = self.most_receivers(receivers)
        mend = f"lower {_lower(self.spec)}" + _that_fit(self.spec, self.known)
        if has_receivers(self.spec):
            mend = f"no number of receivers fits: {mend}"
        if most and has_receivers(self.spec):
            mend = f"--receivers {most} may fit (or pass --fit)"
        raise CannotRun(
            f"{self.spec.name} on {self.known.scene.name} with {receivers:,} receivers asks for "
            f"at least {asked:,} bytes{_in_one(least, self.profile)}; profile "
            f"{self.profile.name} has {there:,}",
            mend=mend,
        )


@dataclass(frozen=True)
class Demand:
    """What a technique allocates where no profile stops it, bytes.

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


def _within(buffers: Sequence[BufferSpec], profile: DeviceProfile) -> bool:
    """Whether a profile has room for ``buffers``, all together and each."""
    return (
        total_bytes(buffers) <= profile.memory_budget_bytes
        and largest(buffers) <= profile.max_buffer_bytes
    )


def _in_one(buffers: Sequence[BufferSpec], profile: DeviceProfile) -> str:
    """What the largest buffer asks for, where that is more than one may have."""
    most = largest(buffers)
    if most <= profile.max_buffer_bytes:
        return ""
    return f", {most:,} of them in one buffer, which may have {profile.max_buffer_bytes:,}"


def _that_fit(spec: TechniqueSpec, known: Known) -> str:
    """Values of the technique's own whole-numbered memory options each of which would fit alone, by
    all that the technique expects to hold; empty where there is none.
    """
    prefix = f"--set {spec.name}."
    names = [o.removeprefix(prefix) for o in spec.memory_options if o.startswith(prefix)]
    if not names:
        return ""
    now, known = known.job.settings, replace(known, bvh=build_bvh(known.scene.corners))
    found = [
        f"{name}={most}"
        for name in names
        if type(getattr(now, name)) is int
        and (most := _most_that_fits(spec, known, name, getattr(now, name)))
    ]
    if not found:
        return ""
    each = ", each alone" if len(found) > 1 else ""
    return f"; {spec.name}.{f', {spec.name}.'.join(found)} would fit{each}"


def _most_that_fits(spec: TechniqueSpec, known: Known, name: str, now: int) -> int:
    """The largest value below ``now`` of a setting with which all that is expected fits; 0 if none
    does. What is refused is too small.
    """
    most, low, high = 0, 0, now
    while high - low > 1:
        middle = (low + high) // 2
        held = _expected(spec, known, name, middle)
        if held is not None and not _within(held, known.job.profile):
            high = middle
            continue
        low = middle
        most = 0 if held is None else middle
    return most


def _expected(spec: TechniqueSpec, known: Known, name: str, value: int) -> list[BufferSpec] | None:
    """What is expected with another value of a setting; None where that is refused."""
    try:
        settings = replace(known.job.settings, **{name: value})
        spec.check(known.scene, settings)
    except BadInput:
        return None
    return spec.expects(replace(known, job=replace(known.job, settings=settings)))


def has_receivers(spec: TechniqueSpec) -> bool:
    """Whether fewer receivers take less of the device's memory."""
    return RECEIVERS in spec.memory_options


def _lower(spec: TechniqueSpec) -> str:
    return _any_of([option for option in spec.memory_options if option != RECEIVERS])


def _any_of(options: Sequence[str]) -> str:
    """``a, b or c``."""
    return " or ".join(filter(None, (", ".join(options[:-1]), options[-1])))


def demand_of(spec: TechniqueSpec, job: Job, world: World, device: Device) -> Demand | None:
    """What ``spec`` allocates for ``job`` in ``world``; None where that is within the profile's
    limits.

    Args:
        spec: the technique.
        job: what is asked.
        world: what is seen.
        device: that executes.
    """
    known = Known.all_of(job, world, build_bvh(world.scene.corners), device)
    declared = spec.buffers(known)
    scene = {buffer.name for buffer in FrameScene.declared(known)}
    fixed = [buffer for buffer in declared if buffer.name in scene]
    demand = Demand(total_bytes(declared), largest(declared), total_bytes(fixed), largest(fixed))
    limits = job.profile
    if demand.total <= limits.memory_budget_bytes and demand.largest <= limits.max_buffer_bytes:
        return None
    return demand
