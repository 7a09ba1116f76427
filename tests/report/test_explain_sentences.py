"""Sentences of ``gibench explain`` from made-up facts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gibench.profiles import load_profile
from gibench.report.explain import at_width, sentence
from gibench.trace.facts import AccessFacts, LaunchFacts, SimdFacts
from gibench.trace.instrument import ATOMIC, LOAD

PROFILE = load_profile("iphone7")
NAN = float("nan")
PLAIN = SimdFacts(32, 1.0, 1.0, 1.0, NAN, (), 0.0, 0.0)
FINE = LaunchFacts(
    groups=600,
    traced=16,
    items=256,
    local_bytes=0,
    simd=(PLAIN, replace(PLAIN, simd=64)),
    flops=2e6,
    instructions=1e6,
    instructions_error=0.0,
    dram_bytes=(1e6,) * 5,
    requested_bytes=1e6,
    atomics=0.0,
    atomics_per_address=0,
    private_per_item=0.0,
    outside=0,
    reuse=np.zeros(64, np.int64),
    cold=0,
)
LOADS = AccessFacts("value", LOAD, 4, 100, 3200, 200, 0, 0, 4096)


def with_simd(**changes: object) -> LaunchFacts:
    return replace(FINE, simd=(replace(PLAIN, **changes),))


@pytest.mark.parametrize(
    ("facts", "declared", "expected"),
    [
        (FINE, 0.0, "nothing stands out: 1 times the fewest cache lines, 2 flops a byte of DRAM"),
        (replace(FINE, outside=3), 0.0, "3 accesses of the sample lie outside every buffer"),
        (replace(FINE, groups=5), 0.0, "5 work-groups for 6 units: 1 of them has nothing to do"),
        (
            with_simd(accesses=(LOADS,)),
            0.0,
            "each load of `value` touches 32 lines where 2 could do: neighbours are 4 KB apart",
        ),
        (
            with_simd(accesses=(replace(LOADS, kind=ATOMIC, stride=None),)),
            0.0,
            "each atomic of `value` touches 32 lines where 2 could do: neighbours' addresses are",
        ),
        (
            with_simd(accesses=(AccessFacts("tile", LOAD, 4, 10, 0, 0, 320, 10, 128),)),
            0.0,
            "each load of `tile` takes 32 turns of local memory's banks where 1 could do",
        ),
        (with_simd(efficiency=0.25), 0.0, "25 % of the lanes are active"),
        (
            replace(FINE, atomics=37500.0, atomics_per_address=1000),
            0.0,
            "1,000 of 1,000 sampled atomics fall on one address",
        ),
        (FINE, 1e5, "touches 10.0 times the bytes that the pass must move, whatever the cache"),
        (
            replace(FINE, dram_bytes=(1e6, 1e6, 1e6, 1e6, 1e5)),
            1e5,
            "moves 10.0 times the bytes that the pass must move behind a cache of 1 MB",
        ),
        (replace(FINE, local_bytes=12288), 0.0, "its 12 KB of local memory let one group"),
    ],
)
def test_the_worst_is_told(facts: LaunchFacts, declared: float, expected: str) -> None:
    assert sentence(facts, PROFILE, declared).startswith(expected)


def test_at_most_two_things_are_told_the_worst_first() -> None:
    facts = replace(with_simd(accesses=(LOADS,), efficiency=0.2), groups=1)
    told = sentence(facts, PROFILE).split("; ")
    assert [text.split()[0] for text in told] == ["1", "each"]


def test_the_waves_are_the_profile_s() -> None:
    assert at_width(FINE, 32).simd == 32
    assert at_width(FINE, 64).simd == 64
    assert at_width(FINE, 8).simd == 32  # narrower than was analysed
