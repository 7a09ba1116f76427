"""What of a launch one unit of a device holds at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gibench.profiles import DeviceProfile, Machine
from gibench.trace.facts import LaunchFacts

WAVES, GROUPS, LOCAL = "waves", "groups", "local memory"


@dataclass(frozen=True)
class Held:
    """Groups that a unit holds at once. What registers allow is not seen in a trace.

    Attributes:
        groups: at least one.
        waves: of them.
        of_waves: that the unit has room for.
        held_by: which room ends first.
        fit_local: groups that its local memory has room for; infinite where they use none.
    """

    groups: int
    waves: int
    of_waves: int
    held_by: str
    fit_local: float

    @property
    def share(self) -> float:
        """Of the unit's room for waves, how much is taken; at most 1."""
        return min(self.waves / self.of_waves, 1.0)


def waves_of(facts: LaunchFacts, profile: DeviceProfile) -> int:
    """Waves of a group at the profile's SIMD width."""
    return -(-facts.items // profile.simd_width)


def held(facts: LaunchFacts, profile: DeviceProfile, end: str = "nominal") -> Held | None:
    """What one unit holds of a launch; None where the profile has no machine part.

    Args:
        facts: of the launch.
        profile: of the device.
        end: of the intervals of its figures: ``low``, ``nominal``, ``high``.
    """
    machine: Machine | None = profile.machine
    if machine is None:
        return None
    of_waves, of_groups, local = (
        int(getattr(each, end)) for each in (machine.waves, machine.groups, machine.local_bytes)
    )
    waves = waves_of(facts, profile)
    fit_local = local // facts.local_bytes if facts.local_bytes else math.inf
    room = {WAVES: of_waves // waves, GROUPS: of_groups, LOCAL: fit_local}
    held_by = min(room, key=lambda name: room[name])
    groups = max(int(room[held_by]), 1)
    return Held(groups, groups * waves, of_waves, held_by, fit_local)
