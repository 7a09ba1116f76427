"""What is wrong with samples: outliers, drift, two speeds. Said, never mended. No I/O here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Times = npt.NDArray[np.floating]

OUTLIER_FENCE = 3.0
"""Tukey's outer fences: 3 interquartile ranges beyond the quartiles ("Exploratory Data Analysis",
1977)."""
DRIFT_SHARE, DRIFT_CHANCE = 0.05, 0.001
TWO_SPEEDS_EXPLAINED = 0.85
"""Share of the variance that a split into two groups must explain; a normal distribution reaches
2 / pi = 0.64, a uniform one 0.75."""
TWO_SPEEDS_APART, TWO_SPEEDS_SHARE = 0.10, 0.15
FEWEST = 12
"""Fewer samples than this are not judged."""


@dataclass(frozen=True)
class Health:
    """What a series of times suffers from.

    Attributes:
        outliers: how many times lie beyond Tukey's outer fences; they are kept.
        drift: last third's median over the first third's minus one, where times keep rising or
            falling by more than 5 % (Mann-Kendall trend test, Mann 1945, p < 0.001); else None.
        two_speeds: the lower and the upper group's median, ms, where times fall into two groups
            (Otsu 1979) at least 10 % apart with 15 % of the times each; else None.
    """

    outliers: int
    drift: float | None
    two_speeds: tuple[float, float] | None

    def in_words(self) -> list[str]:
        """What a reader must know."""
        found = []
        if self.drift is not None:
            found.append(f"drifted by {100 * self.drift:+.0f} % from its first to its last third")
        if self.two_speeds is not None:
            low, high = self.two_speeds
            found.append(f"ran at two speeds, about {low:.3g} ms and {high:.3g} ms")
        return found


def health(times_ms: Times) -> Health:
    """The health of times in the order they were taken, ms."""
    times = np.asarray(times_ms, np.float64)
    if len(times) < FEWEST:
        return Health(0, None, None)
    return Health(int(outliers(times).sum()), _drift(times), _two_speeds(times))


def outliers(times_ms: Times) -> npt.NDArray[np.bool_]:
    """Which times (n,) lie beyond Tukey's outer fences."""
    times = np.asarray(times_ms, np.float64)
    low, high = np.percentile(times, [25, 75])
    reach = OUTLIER_FENCE * (high - low)
    out: npt.NDArray[np.bool_] = (times < low - reach) | (times > high + reach)
    return out


def _drift(times: npt.NDArray[np.float64]) -> float | None:
    from scipy.stats import kendalltau  # slow to load

    third = len(times) // 3
    first = float(np.median(times[:third]))
    if first <= 0:  # a pass that does nothing in most frames
        return None
    change = float(np.median(times[-third:])) / first - 1
    if abs(change) <= DRIFT_SHARE:
        return None
    chance = kendalltau(np.arange(len(times)), times).pvalue
    return change if chance < DRIFT_CHANCE else None


def _two_speeds(times: npt.NDArray[np.float64]) -> tuple[float, float] | None:
    """Otsu's threshold on the times without outliers."""
    kept = np.sort(times[~outliers(times)])
    n = len(kept)
    total = float(kept.var())
    if n < FEWEST or total <= 0:
        return None
    k = np.arange(1, n)
    sums = np.cumsum(kept)[:-1]
    low, high = sums / k, (kept.sum() - sums) / (n - k)
    explained = k / n * (1 - k / n) * (high - low) ** 2 / total
    best = int(np.argmax(explained))
    groups = kept[: best + 1], kept[best + 1 :]
    slow, fast = float(np.median(groups[1])), float(np.median(groups[0]))
    few = min(len(group) for group in groups) < TWO_SPEEDS_SHARE * n
    if explained[best] < TWO_SPEEDS_EXPLAINED or few or slow / fast - 1 < TWO_SPEEDS_APART:
        return None
    return fast, slow
