"""Which probes a receiver uses, and by what weight."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.techniques.srp.bake.data import ProbeSet


class Nearby(NamedTuple):
    """The nearby probes of m receivers as pairs, receiver by receiver.

    Attributes:
        start: (m + 1,) int32: receiver i has the pairs start[i] to start[i + 1].
        receiver: (q,) int32 receiver of each pair, counted from 0 within the m.
        probe: (q,) int32 probe of each pair, ascending within a receiver.
        weight: (q,) float32 w_i(x).
    """

    start: Ints
    receiver: Ints
    probe: Ints
    weight: Floats

    def part(self, receivers: slice) -> Nearby:
        """Those of some of the receivers, one after another."""
        begin, end = self.start[receivers.start], self.start[receivers.stop]
        return Nearby(
            self.start[receivers.start : receivers.stop + 1] - begin,
            self.receiver[begin:end] - np.int32(receivers.start),
            self.probe[begin:end],
            self.weight[begin:end],
        )


def spatial_weight(t: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """w(t) = 2 t^3 - 3 t^2 + 1 within the unit interval, else 0 (Bennett 2019, eq. 4.4)."""
    t = np.asarray(t, np.float64)
    return np.where(t <= 1.0, np.maximum((2.0 * t - 3.0) * t * t + 1.0, 0.0), 0.0)


def nearby(positions: Floats, probes: ProbeSet) -> Nearby:
    """The probes of positive weight at receiver ``positions`` (m, 3); the sky is one of any."""
    between = positions.astype(np.float64)[:, None] - probes.positions.astype(np.float64)[None]
    weight = spatial_weight(np.linalg.norm(between, axis=2) / probes.radius).astype(np.float32)
    if probes.sky:
        weight[:, -1] = 1.0
    receiver, probe = np.nonzero(weight)
    start = np.searchsorted(receiver, np.arange(len(positions) + 1))
    return Nearby(
        start.astype(np.int32),
        receiver.astype(np.int32),
        probe.astype(np.int32),
        weight[receiver, probe],
    )
