"""A straight line through points, with the interval of its slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Line:
    """An ordinary least squares fit.

    Attributes:
        slope: of the line.
        low: lower end of the slope's 95 % interval (Student's t, n - 2 degrees of freedom).
        high: its upper end.
        intercept: at 0.
        r2: share of the variance the line explains.
    """

    slope: float
    low: float
    high: float
    intercept: float
    r2: float


def fit_line(x: Sequence[float], y: Sequence[float], confidence: float = 0.95) -> Line | None:
    """The line through (x, y); None from fewer than three points or at one place only."""
    from scipy.stats import linregress, t  # slow to load

    if len(x) < 3 or np.ptp(x) == 0:
        return None
    fit = linregress(x, y)
    half = float(t.ppf(0.5 + confidence / 2, len(x) - 2)) * float(fit.stderr)
    slope = float(fit.slope)
    return Line(slope, slope - half, slope + half, float(fit.intercept), float(fit.rvalue) ** 2)
