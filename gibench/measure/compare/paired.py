"""Verdicts on paired process replicates. No input or output here.

Each pair of processes gives one log ratio (new over old) per row; a row is the frame or a pass. The
verdict rests on an exact confidence interval of their centre that asks for no normal distribution,
only that log ratios spread evenly to both sides of it, which they do here: which process of a pair
is the new one is the only difference between them, and their noise is exchangeable. It is what two
such intervals, each at half the error, have in common:

- by Wilcoxon's signed ranks (Hodges and Lehmann, Annals of Mathematical Statistics 1963): nearly as
  sharp as Student's t on quiet machines;
- by order statistics, the sign test turned round (Le Boudec, "Performance Evaluation of Computer
  and Communication Systems", 2010, theorem 2.1): untouched by pairs in which something else took
  one process's core all along, of which a busy machine has one in five.

The interval is held against a least effect that matters, the threshold:

- *slower*: the whole interval lies beyond the threshold,
- *faster*: the whole interval lies beyond it on the other side,
- *same*: the whole interval lies within the threshold on both sides (equivalence: Schuirmann 1987),
- *ambiguous*: none of these; more replicates may tell.

So a kernel against itself raises an alarm only if nearly every pair of processes shows it slower by
more than the threshold. Replicates are added in a few looks until all rows are decided; each look
is at the full confidence, so that with a true ratio exactly at the threshold the chance of an alarm
is at most the number of looks times ``1 - CONFIDENCE`` over two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

Verdict = Literal["faster", "same", "slower", "ambiguous"]

CONFIDENCE = 0.99
LOOKS = (9, 12, 16, 20, 24)
"""Pairs after which a verdict is sought; 9 is the fewest that reach 99.5 % (2 / 2^9 = 0.4 %)."""


@dataclass(frozen=True)
class Judged:
    """The ratio of one row and what it means.

    Attributes:
        ratio: new over old, the centre of all replicates.
        low: lower end of its confidence interval; 0 where too few replicates give none.
        high: upper end; infinity where too few replicates give none.
        replicates: it rests on.
    """

    ratio: float
    low: float
    high: float
    verdict: Verdict
    replicates: int


def centre(values: npt.NDArray[np.floating]) -> float:
    """The Hodges-Lehmann estimate of ``values`` (n,): the median of the means of all pairs."""
    return float(np.median(_walsh(values)))


def centre_interval(
    values: npt.NDArray[np.floating], confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """What the signed-rank and the sign interval of the centre have in common, each at half the
    error; infinite where there are too few values."""
    each = 1 - (1 - confidence) / 2
    lows, highs = zip(
        _ends(_walsh(values), _skipped_means(len(values), each)),
        _ends(values, _skipped_values(len(values), each)),
        strict=True,
    )
    return max(lows), min(highs)


def _ends(values: npt.NDArray[np.floating], skip: int | None) -> tuple[float, float]:
    """The least and the largest value once ``skip`` of them are left out at each end."""
    if skip is None:
        return -math.inf, math.inf
    ordered = np.sort(values)
    return float(ordered[skip]), float(ordered[len(ordered) - 1 - skip])


def _walsh(values: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """The means of all pairs of values, each value with itself too."""
    i, j = np.triu_indices(len(values))
    out: npt.NDArray[np.float64] = (values[i] + values[j]) / 2
    return out


@lru_cache
def _skipped_means(n: int, confidence: float) -> int | None:
    """How many means of pairs lie outside each end of the interval; None: too few values.

    The largest k with P(W <= k) <= (1 - confidence) / 2, where W is the signed-rank sum of n
    values, whose distribution is counted out.
    """
    ways = np.zeros(n * (n + 1) // 2 + 1)
    ways[0] = 1.0
    for rank in range(1, n + 1):
        shifted = ways.copy()
        shifted[rank:] += ways[: len(ways) - rank]
        ways = shifted
    within = int(np.count_nonzero(np.cumsum(ways) / 2.0**n <= (1 - confidence) / 2))
    return within - 1 if within else None


@lru_cache
def _skipped_values(n: int, confidence: float) -> int | None:
    """How many values lie outside each end of the sign interval; None: too few values.

    The largest k with P(Binomial(n, 1/2) <= k) <= (1 - confidence) / 2.
    """
    from scipy.stats import binom  # slow to load

    chance = binom.cdf(np.arange(n // 2 + 1), n, 0.5)
    within = int(np.count_nonzero(chance <= (1 - confidence) / 2))
    return within - 1 if within else None


def verdict_of(low: float, high: float, threshold: float) -> Verdict:
    """What an interval of the log ratio means.

    Args:
        low: lower end of the interval of log(new / old).
        high: its upper end.
        threshold: the least relative change that matters, for instance 0.05.
    """
    limit = math.log1p(threshold)
    if low > limit:
        return "slower"
    if high < -limit:
        return "faster"
    if low > -limit and high < limit:
        return "same"
    return "ambiguous"


def judge(log_ratios: npt.NDArray[np.floating] | Sequence[float], threshold: float) -> Judged:
    """The verdict on one row; values that are not finite are left out."""
    values = np.asarray(log_ratios, np.float64)
    values = values[np.isfinite(values)]
    if not len(values):
        return Judged(math.nan, 0.0, math.inf, "ambiguous", 0)
    low, high = centre_interval(values)
    return Judged(
        ratio=math.exp(centre(values)),
        low=math.exp(low),
        high=math.exp(high),
        verdict=verdict_of(low, high, threshold),
        replicates=len(values),
    )


def judge_rows(rows: Mapping[str, Sequence[float]], threshold: float) -> dict[str, Judged]:
    """The verdict on every row: its log ratios, one per pair of processes."""
    return {name: judge(values, threshold) for name, values in rows.items()}


def undecided(judged: Mapping[str, Judged]) -> list[str]:
    """The rows that more replicates may decide."""
    return [name for name, one in judged.items() if one.verdict == "ambiguous" and one.ratio > 0]


def alarmed(judged: Mapping[str, Judged]) -> list[str]:
    """The rows established to be slower beyond the threshold: what makes a check fail."""
    return [name for name, one in judged.items() if one.verdict == "slower"]


def looks(most: int) -> tuple[int, ...]:
    """The numbers of pairs after which a verdict is sought when at most ``most`` are run."""
    return (*(look for look in LOOKS if look < most), most)


def sequential(
    rows: Mapping[str, Sequence[float]], threshold: float, most: int = LOOKS[-1]
) -> dict[str, Judged]:
    """The verdict of a check that takes these replicates one by one and stops as ``ab`` does."""
    judged: dict[str, Judged] = {}
    for look in looks(most):
        judged = judge_rows({name: values[:look] for name, values in rows.items()}, threshold)
        if not undecided(judged):
            break
    return judged
