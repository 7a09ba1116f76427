"""Search along a knob from cheap to dear for the place that comes to a target. No I/O here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

WITHIN = 0.05
"""Of the target: near enough for a search to end."""


def search(
    rungs: int, measure: Callable[[int], float], target: float, *, rising: bool, most: int = 8
) -> dict[int, float]:
    """Bisect for the rung whose figure comes to ``target``.

    Args:
        rungs: how many there are, from cheap to dear.
        measure: the figure of a rung, above 0; inf where it cannot run for being too dear.
        target: of the figure, above 0.
        rising: whether figures grow from rung to rung (a time), or fall (an error).
        most: rungs measured at most.

    Returns:
        The figures of the rungs that were measured: at least one.
    """
    found: dict[int, float] = {}
    low, high = 0, rungs - 1
    while low <= high and len(found) < most:
        middle = (low + high) // 2
        value = found[middle] = measure(middle)
        if off(value, target) <= math.log1p(WITHIN):
            break
        # A rung that cannot run is too dear, whatever the figure.
        if math.isinf(value) or (value > target) == rising:
            high = middle - 1
        else:
            low = middle + 1
    return found


def off(value: float, target: float) -> float:
    """How far a figure is from a target: the logarithm of their ratio, either way."""
    if not 0 < value < math.inf:
        return math.inf
    return abs(math.log(value / target))


def nearest(figures: Mapping[int, float], target: float) -> int:
    """The rung whose figure comes nearest; the lower one of two."""
    return min(sorted(figures), key=lambda rung: off(figures[rung], target))
