"""Test parameters of which every pair meets; every combination under ``-m slow``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import pytest
from allpairspy import AllPairs


def pairwise(*values: Sequence[Any]) -> list[Any]:
    """The product of three or more lists of parameters, for ``parametrize``.

    Any two values of two lists meet in one combination at least that is not marked slow (Kuhn,
    Wallace and Gallo 2004, "Software Fault Interactions and Implications for Software Testing":
    most faults need one value or two). The choice is the same in every run.
    """
    numbers = [list(range(len(one))) for one in values]
    fast = {tuple(pair) for pair in AllPairs(numbers)}
    return [
        pytest.param(
            *(one[n] for one, n in zip(values, chosen, strict=True)),
            marks=() if chosen in fast else pytest.mark.slow,
        )
        for chosen in product(*numbers)
    ]
