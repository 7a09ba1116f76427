"""A trace is kept for exactly what it depends on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gibench.trace import kept_streams
from gibench.trace.kept_streams import SAMPLING, compilers, request_key
from gibench.trace.request import TracedArgument, TraceRequest

REQUEST = TraceRequest(
    *("source", {"WIDTH": 8}, "k", [TracedArgument("a", np.arange(3, dtype=np.float32))]),
    *(32, (4, 1), "k"),
)


def test_the_compilers_and_the_processor_are_part_of_the_key(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import llvmlite
    import llvmlite.binding as llvm

    here = compilers()
    assert {llvmlite.__version__, llvm.get_host_cpu_name()} <= set(here)
    assert any("PoCL" in text or "Portable" in text for text in here)
    keys = {request_key(REQUEST, SAMPLING)}
    for place in range(len(here)):
        other = (*here[:place], "another", *here[place + 1 :])
        monkeypatch.setattr(kept_streams, "compilers", lambda other=other: other)
        keys.add(request_key(REQUEST, SAMPLING))
    assert len(keys) == 1 + len(here)


def test_what_is_launched_is_part_of_the_key() -> None:
    others = [
        replace(REQUEST, source="other"),
        replace(REQUEST, defines={"WIDTH": 4}),
        replace(REQUEST, kernel="l"),
        replace(REQUEST, items=64),
        replace(REQUEST, groups=(5, 1)),
        replace(REQUEST, args=[TracedArgument("a", np.arange(1, 4, dtype=np.float32))]),
    ]
    keys = {request_key(each, SAMPLING) for each in (REQUEST, *others)}
    keys.add(request_key(REQUEST, replace(SAMPLING, runs=SAMPLING.runs + 1)))
    assert len(keys) == len(others) + 2
    assert request_key(REQUEST, SAMPLING) in keys
