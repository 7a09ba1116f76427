"""Numbers that commands are given from Python, held to the bounds of the command line's options."""

from __future__ import annotations

import inspect
import math
import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from numbers import Real
from typing import Any, ParamSpec, TypeVar

from gibench.errors import BadInput

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Bound:
    """What an option's number must be; of an option that takes several, each of them.

    Attributes:
        least: the smallest.
        most: the largest.
        whole: whether it must be a whole number.
    """

    least: float = -math.inf
    most: float = math.inf
    whole: bool = True


BOUNDS = {
    **dict.fromkeys(("probes", "receivers", "frames", "flight_frames", "replicates"), Bound(1)),
    **dict.fromkeys(("warmup", "warmup_frames", "rest_frames", "device", "light_frame"), Bound(0)),
    **dict.fromkeys(("bounces", "reference_seed"), Bound(0)),
    "seed": Bound(0, 2**32 - 1),
    **dict.fromkeys(("warmup_seconds", "settle_seconds"), Bound(0, whole=False)),
    **dict.fromkeys(("seconds", "time_limit"), Bound(1, whole=False)),
    # How far these go, the commands and techniques say.
    **dict.fromkeys(("sh_order", "reference_paths"), Bound()),
    **dict.fromkeys(("budget_ms", "gi_budget_ms", "target_error", "target"), Bound(whole=False)),
}
"""By the parameter's name, which means the same wherever it is."""
_SEVERAL = ("sh_order", "probes", "receivers")


def within_bounds(command: Callable[P, R]) -> Callable[P, R]:
    """``command``, given numbers within ``BOUNDS`` as Python's own ``int`` and ``float``.

    Raises:
        BadInput: (the command) a number is out of range, not whole, or none.
    """
    signature = inspect.signature(command)

    @wraps(command)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        given = signature.bind(*args, **kwargs)
        for name in BOUNDS.keys() & given.arguments.keys():
            given.arguments[name] = _checked(name, given.arguments[name])
        return command(*given.args, **given.kwargs)

    return checked


def _checked(name: str, value: Any) -> Any:
    if value is None:
        return None
    if name in _SEVERAL and isinstance(value, Iterable) and not isinstance(value, str | bytes):
        return tuple(_number(name, each) for each in value)
    return _number(name, value)


def _number(name: str, value: Any) -> int | float:
    bound, option = BOUNDS[name], f"--{name.replace('_', '-')}"
    kind = "a whole number" if bound.whole else "a number"
    wrong = BadInput(f"{option} {value!r} is not {kind}", mend=_range(bound, kind))
    if isinstance(value, bool):
        raise wrong
    number: int | float
    try:
        if bound.whole:
            number = operator.index(value)
        elif isinstance(value, Real):
            number = value if isinstance(value, int) else float(value)
        else:
            raise wrong
    except TypeError:
        raise wrong from None
    if math.isnan(number):
        raise wrong
    if not bound.least <= number <= bound.most:
        raise BadInput(f"{option} {number} is out of range", mend=_range(bound, kind))
    return number


def _range(bound: Bound, kind: str) -> str:
    if math.isfinite(bound.most):
        return f"give {kind} from {bound.least:.0f} to {bound.most:.0f}"
    return f"give {kind}" + (f", {bound.least:g} or more" if math.isfinite(bound.least) else "")
