"""Requests for traces of small kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibench.trace.request import Sampling, TracedArgument, TraceRequest
from gibench.trace.trace import Trace, trace_launch

WHOLE = Sampling(runs=1, length=1 << 20, whole=True)


def traced(
    source: str, kernel: str, groups: int, items: int, how: Sampling = WHOLE, **values: Any
) -> Trace:
    """The trace of a kernel; ``values`` in its order: arrays, numbers, or bytes of local memory."""
    args = []
    for name, value in values.items():
        if isinstance(value, int):
            args.append(TracedArgument(name, None, value))
        else:
            args.append(TracedArgument(name, value, 0, isinstance(value, np.ndarray)))
    return trace_launch(
        TraceRequest(source, {}, kernel, args, items, (groups, 1), f"test.cl: {kernel}"), how
    )
