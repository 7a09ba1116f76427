"""Which probes are updated in a frame."""

from __future__ import annotations

from typing import Final, Literal, get_args

import numpy as np

from gibench.arrays import Doubles, Floats, Ints, Vec3
from gibench.device import BufferSpec, Device

ProbeUpdate = Literal["all", "half", "quarter", "nearest"]
PROBE_UPDATES: tuple[ProbeUpdate, ...] = get_args(ProbeUpdate)

STEPS: Final[dict[str, int]] = {"all": 1, "half": 2, "quarter": 4, "nearest": 4}
"""One of so many probes is updated in a frame."""


class ProbeTurns:
    """Which probes are updated in a frame: all, every 2nd or 4th in turn, or a quarter, those near
    the camera more often (Bennett 2019, chapter 7, suggests both).

    ``nearest`` takes the probes whose turn is most overdue: frames since the last one, over one
    plus their distance from the camera in radii of support. A probe that was never updated comes
    first.

    Args:
        device: where the kernels read them.
        positions: (p, 3) of the probes, m.
        radius: support radius of the probes, m.
        update: which of these.
    """

    def __init__(
        self, device: Device, positions: Floats, radius: float, update: ProbeUpdate
    ) -> None:
        self.device, self.probes, self.update = device, len(positions), update
        self.step = STEPS[update]
        self._positions, self._radius = positions.astype(np.float64), radius
        self._age: Doubles = np.full(self.probes, np.inf)
        self.chosen: Ints = np.zeros(0, np.int32)
        self.state = device.create(ProbeTurns.buffer(self.probes))
        self._tell(np.arange(0, self.probes, self.step, dtype=np.int32))

    @staticmethod
    def buffer(probes: int) -> BufferSpec:
        """How many probes are updated in a frame, and these."""
        return BufferSpec.of("updated_probes", 1 + probes, np.int32)

    def begin_frame(self, frame: int, camera: Vec3) -> None:
        """Choose the probes of ``frame``, seen from ``camera``."""
        if self.update == "nearest":
            self._tell(self._most_overdue(camera))
        elif self.step > 1:
            self._tell(np.arange(frame % self.step, self.probes, self.step, dtype=np.int32))

    def count(self) -> int:
        """Number of probes updated in this frame."""
        return len(self.chosen)

    def _most_overdue(self, camera: Vec3) -> Ints:
        distance = np.linalg.norm(self._positions - np.asarray(camera), axis=1)
        overdue = self._age / (1.0 + distance / self._radius)
        # Of those that were never updated the nearest.
        order = np.lexsort((distance, -overdue))
        chosen = np.sort(order[: -(-self.probes // self.step)])
        self._age += 1.0
        self._age[chosen] = 1.0
        return chosen.astype(np.int32)

    def _tell(self, chosen: Ints) -> None:
        self.chosen = chosen
        told = np.zeros(1 + self.probes, np.int32)
        told[0], told[1 : 1 + len(chosen)] = len(chosen), chosen
        self.device.write(self.state, told)
