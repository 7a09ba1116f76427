"""Test parameters of which every pair meets; every combination, and more work-group sizes, under
``-m slow``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import pytest
from allpairspy import AllPairs


def pairwise(*values: Sequence[Any], more: Mapping[int, Sequence[Any]] | None = None) -> list[Any]:
    """The product of two or more lists of parameters, for ``parametrize``.

    Any two values of two lists meet in one combination at least that is not marked slow (Kuhn,
    Wallace and Gallo 2004, "Software Fault Interactions and Implications for Software Testing":
    most faults need one value or two). The choice is the same in every run.

    Args:
        values: the lists.
        more: further values of some of them, by number: for the slow combinations alone.
    """
    fast = {tuple(pair) for pair in AllPairs([list(range(len(one))) for one in values])}
    values = tuple([*one, *(more or {}).get(n, ())] for n, one in enumerate(values))
    numbers = [range(len(one)) for one in values]
    return [
        pytest.param(
            *(one[n] for one, n in zip(values, chosen, strict=True)),
            marks=() if chosen in fast else pytest.mark.slow,
        )
        for chosen in product(*numbers)
    ]


def few(sizes: Sequence[int], fast: Sequence[int] = (7, 64)) -> list[Any]:
    """Work-group sizes of which ``fast`` are tried in every run: a kernel is compiled for each. One
    divides no problem, the other is what techniques run with.
    """
    assert set(fast) <= set(sizes)
    return [pytest.param(n, marks=() if n in fast else pytest.mark.slow) for n in sizes]
