"""Constant memory: a cache of its own, free where all lanes of a wave read one address."""

from __future__ import annotations

import numpy as np
import pytest
from support.traced import traced

from gibench.trace import waves
from gibench.trace.analysis import analyse, wave_streams
from gibench.trace.streams import WaveStreams

SOURCE = """
#ifndef SPACE
#define SPACE __constant
#endif
__constant int LADDER[8] = {5, 3, 8, 1, 9, 2, 7, 4};

__kernel void alike(SPACE float *weights, __global float *to, int n)
{
    float sum = 0.0f;
    for (int k = 0; k < n; ++k)
        sum += weights[k];
    to[get_global_id(0)] = sum;
}
__kernel void apart(SPACE float *weights, __global float *to, int n)
{
    to[get_global_id(0)] = weights[get_global_id(0) % n];
}
__kernel void table(__global int *to, int turns)
{
    int at = get_global_id(0) % 8;
    for (int k = 0; k < turns; ++k)
        at = LADDER[at] % 8;
    to[get_global_id(0)] = at;
}
"""
GROUPS, ITEMS = 2, 64


def streams(kernel: str, space: str, n: int, size: int) -> tuple[WaveStreams, np.ndarray]:
    values = {"weights": np.arange(size, dtype=np.float32), "n": np.int32(n)}
    to = np.zeros(GROUPS * ITEMS, np.float32)
    source = SOURCE.replace("SPACE float", f"{space} float")
    given = {"weights": values["weights"], "to": to, "n": values["n"]}
    trace = traced(source, kernel, GROUPS, ITEMS, **given)
    return wave_streams(trace, 32), trace.outputs["to"]


def issued(found: WaveStreams) -> int:
    return int(found.waits[:, waves.ISSUED].sum())


def test_what_all_lanes_read_costs_neither_lines_nor_slots_nor_waits() -> None:
    (constant, sums), (plain, same) = (
        streams("alike", space, 100, 100) for space in ("__constant", "__global const")
    )
    np.testing.assert_array_equal(sums, 4950)
    np.testing.assert_array_equal(same, 4950)
    waves_run = GROUPS * ITEMS // 32
    assert issued(plain) - issued(constant) == 100 * waves_run
    assert constant.sectors.sum() == GROUPS * ITEMS * 4 // 32  # stores alone
    assert plain.sectors.sum() == constant.sectors.sum() + 100 * waves_run
    assert constant.waits[:, waves.BATCHES].max() == 0 < plain.waits[:, waves.BATCHES].min()
    assert constant.waits[:, waves.SPILLED].sum() == constant.outside == 0


@pytest.mark.parametrize(
    ("n", "turns"),
    [
        (16, 16),
        pytest.param(1, 0, marks=pytest.mark.slow),
        pytest.param(2, 2, marks=pytest.mark.slow),
        pytest.param(32, 32, marks=pytest.mark.slow),
    ],
)
def test_every_address_of_a_wave_has_its_turn(n: int, turns: int) -> None:
    (constant, found), (plain, _) = (
        streams("apart", space, n, 32) for space in ("__constant", "__global const")
    )
    np.testing.assert_array_equal(found, np.arange(GROUPS * ITEMS) % n)
    waves_run = GROUPS * ITEMS // 32
    assert issued(constant) - issued(plain) == (turns - 1) * waves_run


def test_what_the_cache_cannot_hold_is_global_memory() -> None:
    large, small = (streams("apart", "__constant", 32, size)[0] for size in (2049, 2048))
    plain, _ = streams("apart", "__global const", 32, 2049)
    assert large.sectors.sum() == plain.sectors.sum() > small.sectors.sum()
    assert issued(large) == issued(plain)


def test_a_program_s_own_table_is_constant_memory_too() -> None:
    to = np.zeros(GROUPS * ITEMS, np.int32)
    trace = traced(SOURCE, "table", GROUPS, ITEMS, to=to, turns=np.int32(3))
    ladder, at = np.array([5, 3, 8, 1, 9, 2, 7, 4]), np.arange(len(to)) % 8
    for _ in range(3):
        at = ladder[at] % 8
    np.testing.assert_array_equal(trace.outputs["to"], at)
    facts, found = analyse(trace), wave_streams(trace, 32)
    assert facts.private_per_item == facts.outside == 0
    assert "LADDER" in {access.buffer for access in facts.simd[0].accesses}
    assert found.waits[:, waves.SPILLED].sum() == 0
    assert found.sectors.sum() == GROUPS * ITEMS * 4 // 32
