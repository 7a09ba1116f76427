"""What is not known: a machine's figures and what a model leaves out, as quasi-random points.

Each unknown is an interval; a point of a scrambled Sobol set (Sobol 1967; Owen 1998) gives each of
them a place in its own: half of the places lie below the nominal value, half above, evenly on a
logarithmic scale. The first point is all nominal values.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Doubles
from gibench.profiles import MACHINE_FIGURES, Interval, Machine

POINTS = 128
"""Points of a set; ranges are their 5th to 95th percentile."""
_GRID = frozenset(("l1_bytes", "l2_bytes", "line_bytes", "sector_bytes"))
"""Figures that take their three values alone: caches are simulated for each."""
_WHOLE = frozenset(("units", "waves", "groups"))

MODEL: Mapping[str, Interval] = {
    "instructions": Interval(
        *(0.6, 1.0, 1.6),
        "estimate: what the target's compiler makes of LLVM's instructions, by table charges.py",
    ),
    "registers": Interval(
        *(24, 40, 96), "estimate: registers of a work-item; the target's compiler is not at hand"
    ),
    "unroll": Interval(
        *(0.08, 0.25, 1.0),
        "estimate: of loads that follow but do not need each other, the share that waits: "
        "compilers unroll loops of unknown length by about four",
    ),
    "together": Interval(
        *(1.0, 1.7, 3.0), "estimate: independent instructions of a wave that are under way at once"
    ),
    "warm": Interval(
        *(0.02, 0.2, 0.9),
        "estimate: of what a launch touches first, the share that others left in L2, if it fits",
    ),
    "throughput": Interval(
        *(0.85, 1.05, 1.3),
        "estimate: what launches of a kernel share; what the model overlaps does so in part",
    ),
    "latency": Interval(
        *(0.5, 1.0, 2.0), "our trial: latency-bound slopes 2 and more times off: estimate"
    ),
}
"""What the model does not know of any device."""
OWN = Interval(
    *(0.67, 1.0, 2.0),
    "published models of the kind are 17 to 29 % off on average (GROPHECY 2011; Konstantinidis "
    "and Cotronis 2017; our trial): 1.5 times at the ends; further up, as a compiler may spill "
    "registers or outgrow the instruction cache, which cannot be seen: estimate",
)
"""What sets a launch apart beyond the model, another configuration of the same kernel too."""
_SAMPLING = "sampling"


@dataclass(frozen=True)
class Points:
    """Values of every unknown at every point (p,).

    Attributes:
        figures: by name.
        places: where in its interval each lies, 0 to 1, by name; of those that vary.
    """

    figures: Mapping[str, Doubles]
    places: Mapping[str, Doubles]


def machine_points(machine: Machine, count: int = POINTS) -> Points:
    """The machine's figures at ``count`` points, the same for all that is projected on it."""
    intervals = {name: getattr(machine, name) for name in MACHINE_FIGURES}
    return _points(intervals, "machine", count)


def kernel_points(label: str, identity: str, count: int = POINTS) -> Points:
    """What the model does not know of a launch, at ``count`` points.

    Args:
        label: of the kernel: launches of one kernel share what is not known of it, so that it
            cancels where they are compared.
        identity: of the launch, for what it shares with no other.
        count: of the points.
    """
    from scipy.stats import norm  # slow to load

    shared = _points(MODEL, label, count)
    drawn = Interval(0.0, 0.5, 1.0, "the trace's own sampling error")
    own = _points({"own": OWN, _SAMPLING: drawn}, f"{label} {identity}", count)
    # Standard normal places of the sampling error.
    errors = norm.ppf(np.clip(own.places[_SAMPLING], 1e-3, 1 - 1e-3))
    values = {**shared.figures, "own": own.figures["own"], _SAMPLING: errors}
    return Points(values, {**shared.places, **own.places})


def _points(intervals: Mapping[str, Interval], seed: str, count: int) -> Points:
    from scipy.stats import qmc  # slow to load

    number = int.from_bytes(hashlib.sha256(seed.encode()).digest()[:4], "little")
    engine = qmc.Sobol(len(intervals), scramble=True, rng=np.random.default_rng(number))
    table = engine.random(count)
    table[0] = 0.5
    values, places = {}, {}
    for column, (name, interval) in enumerate(intervals.items()):
        place = table[:, column]
        values[name] = _values(name, interval, place)
        if interval.low < interval.high:
            places[name] = place
    return Points(values, places)


def _values(name: str, interval: Interval, place: Doubles) -> Doubles:
    if name in _GRID:
        third = np.minimum((place * 3).astype(int), 2)
        three = np.array([interval.low, interval.nominal, interval.high])
        taken: Doubles = three[third]
        return taken
    if interval.low == interval.high or interval.low <= 0:
        return np.full(len(place), interval.nominal)
    below = np.log(interval.low) + 2 * place * np.log(interval.nominal / interval.low)
    above = np.log(interval.nominal) + (2 * place - 1) * np.log(interval.high / interval.nominal)
    found: Doubles = np.exp(np.where(place < 0.5, below, above))
    found[place == 0.5] = interval.nominal
    return np.rint(found) if name in _WHOLE else found
