"""Steps in a series of times, one figure a run: where something became slower or faster for good.

Candidates come from ``ruptures`` (Truong, Oudre and Vayatis 2020, "Selective review of offline
change point detection methods"): the penalised least-squares segmentation by PELT (Killick,
Fearnhead and Eckley 2012). A candidate is established only if the medians on both sides differ by
more than the noise of the machine explains. That noise is measured between runs, not within one:
times of one run scatter far less than the same code measured an hour later.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

LEAST_RUNS = 4
"""On each side of a step."""
PENALTY = 2.0
"""Of a further segment, in log(runs) times the noise's variance."""
CERTAINTY = 4.0
"""Standard errors that the medians must differ by. On recorded noise it gives what docs/history.md
shows (tests/benchmarks/judge_steps.py)."""
COUNTED = 25
"""Runs of a side that count at most: a machine's speed drifts, and many runs do not average that
out."""
MEDIAN_ERROR = 1.2533
"""Standard error of a median over that of a mean, sqrt(pi / 2), for a normal distribution."""


@dataclass(frozen=True)
class Step:
    """A lasting change of a series.

    Attributes:
        at: index of the first run after it.
        ratio: median after over median before, to the next steps.
        low: lower end of the ratio's interval at :data:`CERTAINTY` standard errors.
        high: its upper end.
    """

    at: int
    ratio: float
    low: float
    high: float

    @property
    def slower(self) -> bool:
        """Whether times became longer."""
        return self.ratio > 1


def run_noise(logs: npt.NDArray[np.float64]) -> float:
    """Standard deviation from run to run of a series of log times, where nothing changed.

    From differences of neighbours (von Neumann 1941), as median absolute deviation, so that steps
    and outliers do not count. 0 for fewer than two runs.
    """
    if len(logs) < 2:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(logs))) / np.sqrt(2))


def find_steps(
    logs: npt.NDArray[np.float64], threshold: float, noise: float | None = None
) -> list[Step]:
    """Established steps of a series, oldest first.

    Args:
        logs: (runs,) natural logarithms of times, oldest first.
        threshold: the least relative change that matters, for instance 0.05.
        noise: known standard deviation of a log time from run to run, where nothing changed; the
            series' own counts where it is larger.
    """
    values = np.asarray(logs, np.float64)
    if len(values) < 2 * LEAST_RUNS:
        return []
    scale = max(noise or 0.0, run_noise(values), 1e-4)
    borders = [0, *_candidates(values, scale), len(values)]
    while len(borders) > 2:
        judged = [_judge(values, borders[i - 1 : i + 2], scale) for i in range(1, len(borders) - 1)]
        weights = [_weight(shift, error, threshold) for shift, error in judged]
        weakest = int(np.argmin(weights))
        if weights[weakest] >= CERTAINTY:
            return [
                _step(at, shift, error)
                for at, (shift, error) in zip(borders[1:-1], judged, strict=True)
            ]
        del borders[weakest + 1]
    return []


def _candidates(values: npt.NDArray[np.float64], scale: float) -> list[int]:
    import ruptures

    # Clipped: one run beside a nightly backup is no reason for two steps.
    shown = np.clip((values - np.median(values)) / scale, -40.0, 40.0)
    shown = _without_spikes(shown)
    search: Any = ruptures.KernelCPD(kernel="linear", min_size=LEAST_RUNS)
    found = search.fit(shown.reshape(-1, 1)).predict(pen=PENALTY * np.log(len(values)))
    return [int(at) for at in found[:-1]]


def _without_spikes(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Values held within 4 noises of the median of the nine around them."""
    from scipy.ndimage import median_filter

    middle = median_filter(values, size=9, mode="nearest")
    return middle + np.clip(values - middle, -4.0, 4.0)


def _judge(
    values: npt.NDArray[np.float64], borders: list[int], scale: float
) -> tuple[float, float]:
    """Shift of the median over the middle border, and its standard error."""
    before, after = values[borders[0] : borders[1]], values[borders[1] : borders[2]]
    shift = float(np.median(after) - np.median(before))
    variances = [_spread(side, scale) ** 2 / min(len(side), COUNTED) for side in (before, after)]
    return shift, MEDIAN_ERROR * float(np.sqrt(sum(variances)))


def _spread(side: npt.NDArray[np.float64], scale: float) -> float:
    return max(scale, 1.4826 * float(np.median(np.abs(side - np.median(side)))))


def _weight(shift: float, error: float, threshold: float) -> float:
    """How many standard errors a shift is away from none; 0 where it is too small to matter."""
    return abs(shift) / error if abs(shift) >= np.log1p(threshold) else 0.0


def _step(at: int, shift: float, error: float) -> Step:
    low, high = np.exp(shift - CERTAINTY * error), np.exp(shift + CERTAINTY * error)
    return Step(at, float(np.exp(shift)), float(low), float(high))
