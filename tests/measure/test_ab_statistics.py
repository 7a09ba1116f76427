"""The verdicts of `gibench ab`, on made-up machines worse than ours and by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gibench.measure.compare.ab import AbOptions
from gibench.measure.compare.lockstep import FRAME, PairTimes
from gibench.measure.compare.paired import (
    LOOKS,
    alarmed,
    centre_interval,
    judge,
    looks,
    sequential,
    verdict_of,
)

FRAMES = AbOptions().frames


def noisy_pair(
    rng: np.random.Generator, slower: dict[str, float], drift: float, modes: float, spread: float
) -> PairTimes:
    """Times of a pair of processes on a machine that drifts, stalls and has two speeds.

    Args:
        slower: by row, the true ratio of new over old.
        drift: the machine's speed wanders by this factor from frame to frame and pair to pair.
        modes: a process is slow by this much with a chance of 30 % (memory layout).
        spread: of the processes' own speed, relative.
    """
    machine = np.exp(np.cumsum(rng.normal(0, drift, FRAMES)) + rng.normal(0, 0.2))
    sides = []
    for _ in range(2):
        own = math.exp(rng.normal(0, spread) + modes * (rng.random() < 0.3))
        times = {}
        for name, ratio in slower.items():
            noise = rng.lognormal(0, 0.05, FRAMES) * (1 + 3 * (rng.random(FRAMES) < 0.05))
            wobble = math.exp(rng.normal(0, spread))  # of this pass in this process
            if rng.random() < 0.02:  # something else ran on this core all along
                wobble *= 1.2
            times[name] = 10 * own * wobble * machine * noise * (ratio if len(sides) else 1.0)
        sides.append(times)
    return PairTimes(*sides)


def alarms(slower: dict[str, float], turns: int, **machine: float) -> float:
    """The share of checks that fail."""
    rng = np.random.default_rng(20)
    found = 0
    for _ in range(turns):
        each = [noisy_pair(rng, slower, **machine).log_ratios() for _ in range(LOOKS[-1])]
        rows = {name: [one[name] for one in each] for name in each[0]}
        found += bool(alarmed(sequential(rows, 0.05)))
    return found / turns


NOISY = {"drift": 0.03, "modes": 0.0, "spread": 0.012}
TWO_SPEEDS = {"drift": 0.03, "modes": 0.02, "spread": 0.008}
AWFUL = {"drift": 0.1, "modes": 0.05, "spread": 0.04}
SIX = [FRAME, "a", "b", "c", "d", "e"]


@pytest.mark.parametrize("machine", [NOISY, TWO_SPEEDS, AWFUL], ids=["noisy", "modes", "awful"])
def test_a_revision_against_itself_raises_no_alarm(machine: dict[str, float]) -> None:
    assert alarms(dict.fromkeys(SIX, 1.0), 200, **machine) <= 0.01


@pytest.mark.parametrize("machine", [NOISY, TWO_SPEEDS], ids=["noisy", "modes"])
def test_one_pass_ten_percent_slower_is_found(machine: dict[str, float]) -> None:
    assert alarms(dict.fromkeys(SIX, 1.0) | {"c": 1.10}, 100, **machine) >= 0.95


@pytest.mark.parametrize("machine", [NOISY, TWO_SPEEDS, AWFUL], ids=["noisy", "modes", "awful"])
def test_a_quarter_slower_is_always_found(machine: dict[str, float]) -> None:
    assert alarms(dict.fromkeys(SIX, 1.0) | {"c": 1.25}, 60, **machine) == 1.0


def test_a_true_ratio_at_the_threshold_rarely_alarms() -> None:
    assert alarms({FRAME: 1.05}, 200, **NOISY) <= len(LOOKS) * 0.005 + 0.01


@pytest.mark.parametrize("n", [9, 12, 17, 24])
@pytest.mark.parametrize("draw", ["normal", "cauchy", "bimodal"])
def test_the_interval_covers_the_centre(n: int, draw: str) -> None:
    rng = np.random.default_rng(n)
    values = {
        "normal": lambda: rng.normal(size=(2000, n)),
        "cauchy": lambda: rng.standard_cauchy((2000, n)),
        "bimodal": lambda: rng.choice([-1.0, 1.0], (2000, n)) + rng.normal(0, 0.3, (2000, n)),
    }[draw]()
    ends = np.array([centre_interval(row) for row in values])
    missed = np.mean((ends[:, 0] > 0) | (ends[:, 1] < 0))
    assert missed <= 0.01 + 3 * math.sqrt(0.01 / 2000)


def test_the_interval_by_hand() -> None:
    assert centre_interval(np.arange(9.0)) == (0.0, 8.0)  # 2 / 2^9 = 0.4 %
    assert centre_interval(np.arange(8.0)) == (-math.inf, math.inf)  # 0.8 % at best
    # P(W <= 5) of 12 values is 10 / 4096, P(W <= 6) is 14 / 4096: the sixth least mean of pairs.
    assert centre_interval(np.arange(12.0)) == (1.5, 9.5)
    assert centre_interval(np.array([])) == (-math.inf, math.inf)
    # Values far out on both sides: three of twenty are left out whatever they are.
    wild = np.r_[-50, -40, -30, np.linspace(-1, 1, 14), 30, 40, 50]
    assert centre_interval(wild) == (-1.0, 1.0)


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.06, 0.2, "slower"),
        (0.04, 0.2, "ambiguous"),
        (-0.04, 0.04, "same"),
        (-0.2, -0.06, "faster"),
        (-0.06, 0.0, "ambiguous"),
        (-math.inf, math.inf, "ambiguous"),
    ],
)
def test_verdicts_by_hand(low: float, high: float, verdict: str) -> None:
    assert verdict_of(low, high, 0.05) == verdict


@given(st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=24))
def test_swapping_sides_swaps_the_verdict(values: list[float]) -> None:
    mirror = {"slower": "faster", "faster": "slower"}
    one, other = judge(values, 0.05), judge([-v for v in values], 0.05)
    assert other.verdict == mirror.get(one.verdict, one.verdict)
    assert other.ratio == pytest.approx(1 / one.ratio)


def test_rows_without_times_stay_undecided() -> None:
    one = judge([math.nan] * 24, 0.05)
    assert (one.verdict, one.replicates) == ("ambiguous", 0)
    rows = {"empty": [math.nan] * 24, FRAME: [0.0] * 24}
    assert sequential(rows, 0.05)[FRAME].replicates == LOOKS[0]  # does not wait for it


def test_the_looks_end_where_told() -> None:
    assert looks(24) == (9, 12, 16, 20, 24)
    assert looks(10) == (9, 10)
    assert looks(5) == (5,)


def test_couples_of_frames_cancel_what_the_machine_does() -> None:
    old = np.array([1.0, 5.0, 2.0, 9.0])
    ratios = PairTimes({"a": old, "b": old * 0}, {"a": old * 1.1, "b": old}).log_ratios()
    assert ratios["a"] == pytest.approx(math.log(1.1))
    assert math.isnan(ratios["b"])
