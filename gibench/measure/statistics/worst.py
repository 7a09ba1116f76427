"""The worst of frames whose work differs, and whether the machine itself could have made them so.

No I/O here. Two things are known beside a frame's time by the host's clock:

- ``own``: what it kept the device busy itself, which does not grow while others hold it up (on a
  CPU the process's own time on all cores, elsewhere the kernels' time by the device's clock),
- ``beside``: the time of constant work after it, a quarter of a frame long. Whatever of it takes
  longer, the machine did, in ways that ``own`` does not show: clocks that fall, memory that is
  shared, a virtual machine that is not told that it waits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gibench.measure.statistics.summary import NAN

BESIDE_PER_FRAME = 4
"""Pieces of constant work as long as a frame."""
FEWEST = 30
"""Frames, with what is known beside them, without which nothing bad is told."""
HOLDS_SHARE = 0.99
"""Share of the frames that must be within the budget for it to hold: the worst 1 % are left out."""
STUTTER = 2.0
"""A frame that takes at least twice as long as its neighbour stutters: at a display's fixed rate it
is shown one time late (a definition of ours)."""
CLEAR = 3.0
"""What is bad must be at least so many times what the machine did to constant work: that is a
sample a quarter as long as the frames, which may have missed the worst."""

HOLDS, MISSES, CANNOT_TELL = "holds", "misses", "cannot tell"
STEADY, STUTTERS = "steady", "stutters"

Times = Sequence[float] | npt.NDArray[np.floating]


@dataclass(frozen=True)
class Worst:
    """The worst of a series of frames.

    Attributes:
        within_budget: share of the frames that take at most the budget.
        longest_ms: the longest frame.
        stutter: largest ratio of a frame to its neighbour, the longer over the shorter.
        machine_longest: the longest of constant work over its median; nan where none was timed.
        machine_stutter: largest ratio of neighbours of constant work.
        budget: ``holds``, ``misses`` or ``cannot tell``.
        pace: ``steady``, ``stutters`` or ``cannot tell``.
    """

    within_budget: float
    longest_ms: float
    stutter: float
    machine_longest: float
    machine_stutter: float
    budget: str
    pace: str


def worst_frames(times_ms: Times, own_ms: Times, beside_ms: Times, budget_ms: float) -> Worst:
    """The worst of ``times_ms``, in the order they were taken.

    The machine only ever adds to a frame. So what is good holds whatever the machine did: a budget
    that ``HOLDS_SHARE`` of the frames keep, neighbours whose ratio is under ``STUTTER``. What is
    bad is told where it is as bad without what held frames up (:func:`relieved`) and ``CLEAR`` of
    what the machine did to constant work.

    Args:
        times_ms: of frames by the host's clock.
        own_ms: what each kept the device busy itself; empty where that is not known.
        beside_ms: of the constant work after each; empty where none was timed.
        budget_ms: of a frame.
    """
    times = np.asarray(times_ms, np.float64)
    own, beside = np.asarray(own_ms, np.float64), np.asarray(beside_ms, np.float64)
    longest, stutter = _machine(beside)
    if not times.size:
        return Worst(NAN, NAN, NAN, longest, stutter, CANNOT_TELL, CANNOT_TELL)
    ratio = largest_ratio(times)
    within = float(np.mean(times <= budget_ms))
    enough = len(times) == len(own) and np.isfinite(longest)
    without = relieved(times, own) if enough else times
    budget = pace = CANNOT_TELL
    if within >= HOLDS_SHARE:
        budget = HOLDS
    elif enough and np.mean(without <= budget_ms * (1 + CLEAR * (longest - 1))) < HOLDS_SHARE:
        budget = MISSES
    if ratio < STUTTER:
        pace = STEADY
    elif enough and largest_ratio(without) >= max(STUTTER, 1 + CLEAR * (stutter - 1)):
        pace = STUTTERS
    return Worst(within, float(times.max()), ratio, longest, stutter, budget, pace)


def relieved(
    times: npt.NDArray[np.float64], own: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Times (n,) without what held frames up: a frame's own time, at the least ratio of the two in
    the series, that of the frame which was held up least.
    """
    least = float((times / np.maximum(own, 1e-9)).min())
    out: npt.NDArray[np.float64] = least * own
    return out


def largest_ratio(times: npt.NDArray[np.float64], apart: int = 1) -> float:
    """Of two times ``apart`` places apart, the longer over the shorter, at most; 1 where there is
    one alone.
    """
    if len(times) <= apart:
        return 1.0
    ratios = times[apart:] / times[:-apart]
    return float(np.maximum(ratios, 1 / ratios).max())


def _machine(beside: npt.NDArray[np.float64]) -> tuple[float, float]:
    """The longest of constant work as long as a frame over its median, and the largest ratio of
    neighbours; nan where there is too little of it.
    """
    if len(beside) < FEWEST:
        return NAN, NAN
    lengths = np.convolve(beside, np.ones(BESIDE_PER_FRAME), "valid")
    longest = float(lengths.max() / np.median(lengths))
    return longest, largest_ratio(lengths, BESIDE_PER_FRAME)
