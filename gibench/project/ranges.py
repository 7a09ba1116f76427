"""Ranges of times, what they hang on, and which of two is faster."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Doubles
from gibench.profiles import Machine
from gibench.project.model import LATENCY, LAUNCH, Times

RANGE, ORDER, UNKNOWN = "range", "order of magnitude", "cannot tell"
SURE, LIKELY = "sure", "likely"
PERCENTILES = (5.0, 95.0)
PAIR_PERCENTILES = (2.5, 97.5)
"""Between which a ratio must not be 1 where it is called sure."""
SHOWN_WIDTH = 3.0
"""Ranges that are wider show no point in them."""
_RANGE_WIDTH, _ORDER_WIDTH = 4.0, 10.0
_UNKNOWN_LATENCY = 2.0
"""A latency that is an estimate and is not known within this is unknown."""
_LIKELY_SHARE = 0.8


@dataclass(frozen=True)
class Range:
    """How long something takes, ms.

    Attributes:
        low: 5 % of the points lie below.
        nominal: at the nominal point.
        high: 5 % lie above.
        bound_by: what takes longest at the nominal point.
        driven_by: the unknown that the time hangs on most.
        verdict: ``range``, ``order of magnitude`` or ``cannot tell``.
        reason: why nothing can be told; empty otherwise.
    """

    low: float
    nominal: float
    high: float
    bound_by: str
    driven_by: str
    verdict: str
    reason: str = ""

    @property
    def width(self) -> float:
        """The highest over the lowest."""
        return self.high / self.low

    @property
    def shown(self) -> float | None:
        """The nominal time where the range is narrow enough for it to be shown."""
        return self.nominal if self.width <= SHOWN_WIDTH else None


@dataclass(frozen=True)
class Total:
    """Times of one or more launches at every point (p,), ms, with their launch costs.

    Attributes:
        times: of all together.
        bound_by: what takes most of it at the nominal point.
        places: of the unknowns, by name.
        unseen: what the model does not see of most of it; empty where it sees what matters.
    """

    times: Doubles
    bound_by: str
    places: Mapping[str, Doubles]
    unseen: str = ""


def together(launches: Sequence[Times]) -> Total:
    """Launches one behind another, each waiting for the last."""
    times = np.sum([each.total + each.launch for each in launches], axis=0)
    shares: dict[str, float] = {LAUNCH: float(sum(each.launch[0] for each in launches))}
    places: dict[str, Doubles] = {}
    for each in launches:
        shares[each.bound_by] = shares.get(each.bound_by, 0.0) + float(each.total[0])
        places |= each.places
    blind = [each for each in launches if each.unseen]
    mostly = sum(float(each.total[0]) for each in blind) > float(times[0]) / 2
    bound_by = max(shares, key=lambda name: shares[name])
    return Total(times, bound_by, places, blind[0].unseen if mostly else "")


def range_of(total: Total, machine: Machine) -> Range:
    """The range of a total on a machine."""
    low, high = (float(x) for x in np.percentile(total.times, PERCENTILES))
    nominal = float(np.clip(total.times[0], low, high))
    reason = _reason(total, machine)
    width = high / low
    verdict = RANGE if width <= _RANGE_WIDTH else ORDER if width <= _ORDER_WIDTH else UNKNOWN
    if reason:
        verdict = UNKNOWN
    elif verdict == UNKNOWN:
        reason = f"over {_ORDER_WIDTH:g} times from low to high"
    return Range(low, nominal, high, total.bound_by, driven_by(total), verdict, reason)


def _reason(total: Total, machine: Machine) -> str:
    if total.unseen or total.bound_by != LATENCY:
        return total.unseen
    for name in ("l2_latency_clocks", "dram_latency_ns"):
        each = getattr(machine, name)
        if each.estimated and each.spread > _UNKNOWN_LATENCY:
            return f"latency rules, and {name} is unknown"
    return ""


def driven_by(total: Total) -> str:
    """The unknown whose place goes with the times most closely, by rank correlation."""
    from scipy.stats import spearmanr  # slow to load

    best, found = 0.0, ""
    for name, place in total.places.items():
        if np.ptp(total.times) == 0:
            break
        correlation = abs(float(spearmanr(place, total.times).statistic))
        if correlation > best:
            best, found = correlation, name
    return found


@dataclass(frozen=True)
class Ratio:
    """One thing's time over another's on the same machine.

    Attributes:
        low: 2.5 % of the points lie below.
        nominal: at the nominal point.
        high: 2.5 % lie above.
        verdict: ``sure``, ``likely`` or ``cannot tell`` which is faster.
    """

    low: float
    nominal: float
    high: float
    verdict: str


def ratio(one: Total, other: Total) -> Ratio:
    """How much longer ``one`` takes than ``other``; unknowns that both share cancel."""
    found = one.times / other.times
    low, high = (float(x) for x in np.percentile(found, PAIR_PERCENTILES))
    above = float(np.mean(found > 1))
    verdict = UNKNOWN
    if low > 1 or high < 1:
        verdict = SURE
    elif max(above, 1 - above) >= _LIKELY_SHARE:
        verdict = LIKELY
    return Ratio(low, float(found[0]), high, verdict)
