"""Which of several settings nothing else beats in everything."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def pareto_front(costs: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Which rows of ``costs`` (n, k), each to be small, are not beaten.

    A row is beaten by one that is nowhere larger and somewhere smaller. Rows with NaN are never on
    the front and beat nothing; equal rows stand or fall together.
    """
    costs = np.asarray(costs, np.float64)
    whole = np.isfinite(costs).all(axis=1)
    front = whole.copy()
    for i in np.flatnonzero(whole):
        others = costs[whole]
        beaten = (others <= costs[i]).all(axis=1) & (others < costs[i]).any(axis=1)
        front[i] = not beaten.any()
    return np.asarray(front, np.bool_)
