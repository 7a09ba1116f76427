"""What waits for what: loads in a row of kernels where it is known."""

from __future__ import annotations

import numpy as np
import pytest
from support.traced import traced

from gibench.trace import waves
from gibench.trace.analysis import wave_streams
from gibench.trace.request import Sampling

SOURCE = """
__kernel void chase(__global const int *next, __global int *out, int steps)
{
    int at = get_global_id(0);
    for (int i = 0; i < steps; ++i)
        at = next[at];
    out[get_global_id(0)] = at;
}
__kernel void sums(__global const float *from, __global float *out, int steps, int apart)
{
    float sum = 0.0f;
    for (int i = 0; i < steps; ++i)
        sum += from[i * apart + get_global_id(0)];
    out[get_global_id(0)] = sum;
}
__kernel void indirect(__global const int *which, __global const float *from, __global float *out)
{
    const int i = get_global_id(0);
    out[i] = from[which[i]] + from[which[i + 64]];
}
// The loop ends by what was loaded: no step may begin before the last is known.
__kernel void until(__global const float *from, __global float *out, float most)
{
    float sum = 0.0f;
    int i = 0;
    while (sum < most)
        sum += from[i++];
    out[get_global_id(0)] = sum;
}
__kernel void staged(__global const float *from, __global float *out, __local float *tile)
{
    const int i = get_local_id(0);
    tile[i] = from[get_global_id(0)];
    barrier(CLK_LOCAL_MEM_FENCE);
    out[get_global_id(0)] = tile[63 - i] * from[i];
}
"""


def waits(kernel: str, how: Sampling | None = None, **values: object) -> np.ndarray:
    trace = traced(SOURCE, kernel, 1, 64, *(() if how is None else (how,)), **values)
    return wave_streams(trace, 32).waits


@pytest.mark.parametrize("steps", (1, 5, 40))
def test_a_chase_is_as_long_as_its_steps(steps: int, rng: np.random.Generator) -> None:
    ring = rng.permutation(64).astype(np.int32)
    found = waits("chase", next=ring, out=np.zeros(64, np.int32), steps=np.int32(steps))
    assert (found[:, waves.IN_A_ROW] == steps).all()
    assert (found[:, waves.BATCHES] == steps).all()


def test_loads_that_need_nothing_are_one_in_a_row_but_follow_each_other() -> None:
    from_ = np.ones(64 * 10, np.float32)
    numbers = {"steps": np.int32(10), "apart": np.int32(64)}
    found = waits("sums", **{"from": from_}, out=np.zeros(64, np.float32), **numbers)
    assert (found[:, waves.IN_A_ROW] == 1).all()
    assert (found[:, waves.BATCHES] == 10).all()
    assert (found[:, waves.LOCAL_BATCHES] == 0).all()


def test_an_index_comes_before_what_it_points_to() -> None:
    which = np.arange(128, dtype=np.int32) % 64
    values = {"which": which, "from": np.ones(64, np.float32), "out": np.zeros(64, np.float32)}
    found = waits("indirect", **values)
    assert (found[:, waves.IN_A_ROW] == 2).all()
    assert (found[:, waves.BATCHES] == 2).all()


def test_a_branch_on_what_was_loaded_holds_what_follows() -> None:
    from_, most = np.ones(64, np.float32), np.float32(6.5)
    found = waits("until", **{"from": from_}, out=np.zeros(64, np.float32), most=most)
    assert (found[:, waves.IN_A_ROW] == 7).all()


def test_a_barrier_waits_for_what_was_loaded_before_it() -> None:
    out = np.zeros(64, np.float32)
    found = waits("staged", **{"from": np.ones(64, np.float32)}, out=out, tile=256)
    assert (found[:, waves.IN_A_ROW] == 2).all()


def test_unrolled_loops_issue_less_and_load_the_same(rng: np.random.Generator) -> None:
    source = SOURCE.replace("i < steps", "i < 8")
    values = {"from": rng.random(640).astype(np.float32), "out": np.zeros(64, np.float32)}
    numbers = {"steps": np.int32(8), "apart": np.int32(64)}
    rolled, unrolled = (
        wave_streams(
            traced(source, "sums", 1, 64, Sampling(1, 1, unroll=each), **values, **numbers), 32
        )
        for each in (False, True)
    )
    assert unrolled.waits[0, waves.ISSUED] < 0.8 * rolled.waits[0, waves.ISSUED]
    assert unrolled.sectors.tolist() == rolled.sectors.tolist()
    assert (rolled.waits[:, waves.BATCHES] == 8).all()
    assert (unrolled.waits[:, waves.BATCHES] == 1).all()
