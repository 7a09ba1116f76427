"""A program's bitcode from the process that asks, or from the one that traces."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from support.traced import traced

from gibench.trace import bitcode, trace
from gibench.trace.request import TraceRequest

SOURCE = """
__kernel void scale(__global float *to, float by)
{
    for (int k = 0; k < COUNT; ++k)
        to[get_global_id(0) * COUNT + k] *= by;
}
"""
REQUEST = TraceRequest(SOURCE, {"COUNT": 3}, "scale", [], 8, (2, 1), "test.cl: scale")


def test_both_trace_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = SOURCE.replace("COUNT", "3"), "scale", 2, 8
    values = {"to": np.arange(48, dtype=np.float32), "by": np.float32(2.5)}
    made = []
    for build in (bitcode.built_here, lambda request: None):
        monkeypatch.setattr(trace, "built_here", build)
        made.append(traced(*asked, **values))
    mine, its = made
    np.testing.assert_array_equal(mine.outputs["to"], np.arange(48) * 2.5)
    np.testing.assert_array_equal(its.outputs["to"], mine.outputs["to"])
    np.testing.assert_array_equal(its.ends, mine.ends)
    assert len(its.words) == len(mine.words) > 48
    for one in fields(mine.tables):
        np.testing.assert_array_equal(getattr(its.tables, one.name), getattr(mine.tables, one.name))


def test_macros_are_in_it() -> None:
    few, many = (
        bitcode.built_here(TraceRequest(SOURCE, {"COUNT": n}, "scale", [], 8, (2, 1), ""))
        for n in (3, 4)
    )
    assert few is not None and many is not None and few != many
    assert bitcode.built_here(REQUEST) == few


def test_what_does_not_build_is_left_to_who_can_tell() -> None:
    request = TraceRequest("__kernel void k() { no; }", {}, "k", [], 8, (2, 1), "")
    assert bitcode.built_here(request) is None


@pytest.mark.parametrize(
    "binary", [b"", b"poclbin/program.bc", b"poclbin/program.bc\x04\0\0\0junk"]
)
def test_a_binary_that_is_packed_otherwise_gives_none(binary: bytes) -> None:
    assert bitcode._packed(binary) is None
    sound = b"poclbin\0/program.bc\x06\0\0\0BC\xc0\xde!!more"
    assert bitcode._packed(sound) == b"BC\xc0\xde!!"
    assert bitcode._packed(sound[:-5]) is None  # cut short
