"""Sentences of ``gibench explain`` from made-up facts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gibench.profiles import load_profile
from gibench.report.explain import at_width, row, sentence
from gibench.report.occupancy import held
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
        (
            replace(FINE, local_bytes=12288),
            0.0,
            "its 12 KB of local memory let 1 to 2 groups at a time onto a unit of iphone7: 8 of "
            "the 16 waves that it has room for",
        ),
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


@pytest.mark.parametrize(
    ("profile", "items", "kilobytes", "groups", "held_by"),
    [
        ("vega56", 256, 20, 3, "local memory"),  # of 64 KB, of which one group may use 32
        ("titan-x-pascal", 128, 40, 2, "local memory"),  # of 96 KB
        ("h100", 256, 48, 4, "local memory"),  # of 228 KB
        ("vega56", 256, 0, 10, "waves"),  # 40 waves, four a group
        ("titan-x-pascal", 32, 1, 32, "groups"),  # 64 waves, but 32 groups
    ],
)
def test_a_unit_holds_what_its_waves_groups_and_local_memory_have_room_for(
    profile: str, items: int, kilobytes: int, groups: int, held_by: str
) -> None:
    facts = replace(FINE, items=items, local_bytes=kilobytes << 10)
    found = held(facts, load_profile(profile))
    assert found is not None
    assert (found.groups, found.held_by) == (groups, held_by)
    told = row(facts, load_profile(profile))
    assert (told["groups_held"], told["work_items_held"]) == (groups, groups * items)
    assert told["waves_held_share"] == found.waves / found.of_waves <= 1


def test_small_groups_are_told_where_a_unit_surely_holds_too_few() -> None:
    small = replace(FINE, items=32)
    assert "groups of 32 work-items are small" in sentence(small, load_profile("titan-x-pascal"))
    # Of one wave, GCN may hold 16 groups or 40.
    one_wave = replace(FINE, items=64)
    assert "small" not in sentence(one_wave, load_profile("vega56"))


def test_what_a_unit_holds_is_unknown_without_a_machine_part() -> None:
    bare, facts = replace(PROFILE, machine=None), replace(FINE, local_bytes=12288)
    assert held(facts, bare) is None
    assert "groups_held" not in row(facts, bare)
    assert "local memory" not in sentence(facts, bare)
