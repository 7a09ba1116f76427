"""Which probes are relit in a frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Ints


@dataclass
class Schedule:
    """Probes take turns; those far from the camera less often.

    A probe that was never lit comes first; after that the one whose turn is most overdue: its
    frames since it was lit, divided by ``slower`` where it is far.

    Attributes:
        positions: (n, 3) of the probes, m.
        numbers: (n,) of them.
        each_frame: how many are relit in a frame.
        far: distance from the camera beyond which a probe is far, m.
        slower: how many times less often it is relit then.
    """

    positions: Doubles = field(repr=False)
    numbers: Ints = field(repr=False)
    each_frame: int
    far: float
    slower: float
    _age: Doubles = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._age = np.full(len(self.numbers), np.inf)

    @property
    def oldest(self) -> float:
        """Frames since the probe that has waited longest was lit, its own frame counted; infinite
        as long as one never was, 0 where there are none.
        """
        return float(self._age.max(initial=0.0))

    def next(self, camera: tuple[float, float, float]) -> tuple[Ints, npt.NDArray[np.bool_]]:
        """The probes (k,) of the next frame, seen from ``camera``, and which of them are lit for
        the first time.
        """
        distance = np.linalg.norm(self.positions - np.asarray(camera), axis=1)
        overdue = self._age / np.where(distance > self.far, self.slower, 1.0)
        chosen = np.sort(np.argsort(-overdue, kind="stable")[: self.each_frame])
        fresh = np.isinf(self._age[chosen])
        self._age += 1.0
        self._age[chosen] = 1.0
        return self.numbers[chosen], fresh
