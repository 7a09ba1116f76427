"""Traces of kernels whose answer is known."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from support.traced import traced

from gibench.errors import BadInput, CannotRun, CheckFailed
from gibench.trace.analysis import analyse
from gibench.trace.execute import record
from gibench.trace.facts import AccessFacts, LaunchFacts
from gibench.trace.request import Sampling, TraceRequest
from gibench.trace.trace import Trace

SOURCE = """
__kernel void copy(__global const float *from, __global float *to)
{
    const size_t i = get_global_id(0);
    to[i] = from[i];
}
__kernel void stride(__global const float *from, __global float *to, int step)
{
    const size_t i = get_global_id(0);
    to[i] = from[i * step];
}
__kernel void wide(__global const float8 *from, __global float8 *to)
{
    const size_t i = get_global_id(0);
    to[i] = from[i];
}
__kernel void gather(__global const float *from, __global float *to, __global const int *which)
{
    const size_t i = get_global_id(0);
    to[i] = from[which[i]];
}
__kernel void columns(__global const float *from, __global float *to, int n)
{
    const int i = get_global_id(0);
    to[(i % n) * n + i / n] = from[i];
}
// Tiles of 32 x 32 by groups of 256.
__kernel void transpose(__global const float *from, __global float *to, int n, int pitch,
                        __local float *tile)
{
    const int x = get_local_id(0) % 32, y = get_local_id(0) / 32;
    const int left = get_group_id(0) % (n / 32) * 32, up = get_group_id(0) / (n / 32) * 32;
    for (int k = y; k < 32; k += 8)
        tile[k * pitch + x] = from[(up + k) * n + left + x];
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = y; k < 32; k += 8)
        to[(left + k) * n + up + x] = tile[x * pitch + k];
}
__kernel void reduce(__global const float *from, __global float *to)
{
    __local float sums[64];
    const int i = get_local_id(0);
    sums[i] = from[get_global_id(0)];
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_of = 32; half_of > 0; half_of /= 2) {
        if (i < half_of)
            sums[i] += sums[i + half_of];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (i == 0)
        to[get_group_id(0)] = sums[0];
}
__kernel void loop(__global float *values)
{
    const size_t i = get_global_id(0);
    float x = values[i];
    for (int k = 0; k <= (int)(i % 32); ++k)
        x = x * x - 0.5f;
    values[i] = x;
}
// Both sides cost the same; lanes meet again behind them.
__kernel void sides(__global float *values)
{
    const size_t i = get_global_id(0);
    float x = values[i];
    if (i % 2)
        for (int k = 0; k < 100; ++k)
            x = x * x - 0.5f;
    else
        for (int k = 0; k < 100; ++k)
            x = x * 0.5f + x;
    values[i] = x;
}
__kernel void count(__global uint *bins)
{
    atomic_inc(bins + get_global_id(0) % 4);
}
__kernel void votes(__global uint *sums)
{
    __local uint votes;
    if (get_local_id(0) == 0)
        votes = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    atomic_inc(&votes);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0)
        sums[get_group_id(0)] = votes;
}
__kernel void roots(__global float *values)
{
    const size_t i = get_global_id(0);
    values[i] = exp(sqrt(values[i]));
}
__kernel void again(__global const float *from, __global float *to, int n)
{
    float sum = 0.0f;
    for (int turn = 0; turn < 4; ++turn)
        for (int k = get_local_id(0); k < n; k += get_local_size(0))
            sum += from[k];
    to[get_global_id(0)] = sum;
}
__kernel void astray(__global float *values, int far)
{
    values[(size_t)get_global_id(0) * far] = 1.0f;
}
__kernel void forever(__global volatile float *values)
{
    while (values[0] == 0.0f)
        ;
}
"""
N = 4096


def floats(n: int = N) -> np.ndarray:
    return np.linspace(0.1, 1.0, n, dtype=np.float32)


def of(facts: LaunchFacts, buffer: str, width: int = 0) -> AccessFacts:
    found = [each for each in facts.simd[width].accesses if each.buffer == buffer]
    assert len(found) == 1
    return found[0]


def ratio(access: AccessFacts) -> float:
    return access.lines / access.fewest_lines


def test_a_coalesced_copy_touches_the_fewest_lines_and_moves_each_byte_once() -> None:
    values = floats()
    trace = traced(SOURCE, "copy", N // 64, 64, **{"from": values, "to": np.zeros_like(values)})
    np.testing.assert_array_equal(trace.outputs["to"], values)
    facts = analyse(trace)
    for simd in facts.simd:
        assert simd.lines_over_fewest == simd.sectors_over_fewest == simd.efficiency == 1.0
        assert math.isnan(simd.bank_conflicts)
        assert [access.stride for access in simd.accesses] == [4, 4]
    assert set(facts.dram_bytes) == {2.0 * values.nbytes}
    assert (facts.flops, facts.atomics, facts.outside) == (0, 0, 0)


@pytest.mark.parametrize("step", [2, 4, 16, 64])
def test_a_stride_touches_as_many_lines_more(step: int) -> None:
    values = floats(N * step)
    trace = traced(
        *(SOURCE, "stride", N // 64, 64),
        **{"from": values, "to": np.zeros(N, np.float32), "step": np.int32(step)},
    )
    np.testing.assert_array_equal(trace.outputs["to"], values[::step])
    for width in (0, 1):
        assert ratio(of(analyse(trace), "from", width)) == min(step, 16)
        assert of(analyse(trace), "from", width).stride == 4 * step


def test_a_wide_load_is_several_requests_that_each_waste_half_a_line() -> None:
    values = floats()
    trace = traced(SOURCE, "wide", 8, 64, **{"from": values, "to": np.zeros_like(values)})
    access = of(analyse(trace), "from")
    assert (access.nbytes, access.requests) == (32, 2 * 8 * 2)
    assert ratio(access) == 2.0


def test_a_gather_touches_a_line_a_lane(rng: np.random.Generator) -> None:
    which = rng.permutation(1 << 14)[:N].astype(np.int32) * 16  # a line each
    values = floats(1 << 18)
    trace = traced(
        *(SOURCE, "gather", N // 64, 64),
        **{"from": values, "to": np.zeros(N, np.float32), "which": which},
    )
    np.testing.assert_array_equal(trace.outputs["to"], values[which])
    facts = analyse(trace)
    assert (ratio(of(facts, "from", 0)), ratio(of(facts, "from", 1))) == (16, 16)
    assert of(facts, "from").stride is None


@pytest.mark.parametrize(("pitch", "conflicts"), [(32, 32.0), (33, 1.0)])
def test_a_transpose_meets_bank_conflicts_without_padding(pitch: int, conflicts: float) -> None:
    values = floats().reshape(64, 64)
    trace = traced(
        *(SOURCE, "transpose", 4, 256),
        **{"from": values, "to": np.zeros_like(values), "n": np.int32(64)},
        pitch=np.int32(pitch),
        tile=4 * 32 * pitch,
    )
    np.testing.assert_array_equal(trace.outputs["to"], values.T)
    facts = analyse(trace)
    assert facts.simd[0].lines_over_fewest == facts.simd[1].lines_over_fewest == 1.0
    down = [access.cycles / access.fewest_cycles for access in facts.simd[0].accesses[1:3]]
    assert down == [1.0, conflicts]
    assert facts.local_bytes == 4 * 32 * pitch


def test_a_transpose_without_a_tile_writes_a_line_a_lane() -> None:
    values = floats().reshape(64, 64)
    trace = traced(
        *(SOURCE, "columns", 16, 256),
        **{"from": values, "to": np.zeros_like(values), "n": np.int32(64)},
    )
    np.testing.assert_array_equal(trace.outputs["to"], values.T)
    facts = analyse(trace)
    assert ratio(of(facts, "from")) == 1.0
    assert ratio(of(facts, "to")) == 16.0
    assert of(facts, "to").stride == 256


def test_a_reduction_leaves_lanes_idle() -> None:
    values = floats()
    trace = traced(
        *(SOURCE, "reduce", N // 64, 64),
        **{"from": values, "to": np.zeros(N // 64, np.float32)},
    )
    np.testing.assert_allclose(trace.outputs["to"], values.reshape(-1, 64).sum(axis=1), rtol=1e-5)
    facts = analyse(trace)
    assert facts.flops == N // 64 * 63
    assert facts.local_bytes == 256
    assert 0.3 < facts.simd[1].efficiency < facts.simd[0].efficiency < 1.0
    assert facts.simd[0].bank_conflicts == 1.0


def test_a_wave_goes_on_until_its_longest_loop_ends() -> None:
    trace = traced(SOURCE, "loop", N // 64, 64, values=floats())
    facts = analyse(trace)
    assert facts.flops == N * 16.5 * 2
    busy = trace.tables.flops > 0  # the loop's block
    words = trace.words
    assert (words == -1 - np.nonzero(busy)[0][0]).sum() == N * 16.5
    # Mean turns over the longest: 16.5 of 32, but for what is outside the loop.
    assert 0.5 < facts.simd[0].efficiency < 0.56
    assert facts.simd[0].efficiency == pytest.approx(facts.simd[1].efficiency)


def test_lanes_that_part_meet_again_behind_both_sides() -> None:
    facts = analyse(traced(SOURCE, "sides", 16, 64, values=floats(1024)))
    assert facts.simd[0].efficiency == pytest.approx(0.5, abs=0.02)
    assert facts.simd[0].lines_over_fewest == 1.0  # the store is of whole waves


def test_atomics_are_counted_by_address() -> None:
    trace = traced(SOURCE, "count", 16, 64, bins=np.zeros(4, np.uint32))
    np.testing.assert_array_equal(trace.outputs["bins"], [256] * 4)
    facts = analyse(trace)
    assert (facts.atomics, facts.atomics_per_address) == (1024, 256)


def test_atomics_in_local_memory_are_each_group_s_own() -> None:
    trace = traced(SOURCE, "votes", 16, 64, sums=np.zeros(16, np.uint32))
    np.testing.assert_array_equal(trace.outputs["sums"], [64] * 16)
    facts = analyse(trace)
    assert (facts.atomics, facts.atomics_per_address) == (1024, 64)


def test_builtins_are_charged_by_the_table() -> None:
    values = floats(64)
    trace = traced(SOURCE, "roots", 1, 64, values=values)
    np.testing.assert_allclose(trace.outputs["values"], np.exp(np.sqrt(values)), rtol=1e-5)
    assert analyse(trace).flops == 64 * 2


def test_a_cache_that_holds_what_comes_again_saves_its_bytes() -> None:
    n = 1 << 15  # 128 KB, read four times by one group
    values = floats(n)
    trace = traced(
        *(SOURCE, "again", 1, 64),
        **{"from": values, "to": np.zeros(64, np.float32), "n": np.int32(n)},
    )
    facts = analyse(trace)
    out = 64 * 4
    assert facts.dram_bytes[0] == 4 * values.nbytes + out  # 16 KB
    assert facts.dram_bytes[2] == values.nbytes + out  # 256 KB
    assert facts.requested_bytes == 4 * values.nbytes + out


def test_a_sample_is_scaled_to_the_launch_and_tells_its_error() -> None:
    how = Sampling(runs=4, length=2)
    values = floats(1 << 16)
    args = {"from": values, "to": np.zeros_like(values)}
    trace = traced(SOURCE, "copy", 1024, 64, how, **args)
    assert list(trace.groups) == [0, 1, 341, 342, 681, 682, 1022, 1023]
    facts = analyse(trace)
    assert facts.dram_bytes[0] == 2 * values.nbytes
    assert facts.instructions_error == facts.simd[0].lines_error == 0.0


def refused(kernel: str, how: Sampling | None = None, **values: object) -> Trace:
    return traced(SOURCE, kernel, 4, 64, how or Sampling(), **values)


def test_a_kernel_that_faults_is_told() -> None:
    with pytest.raises(CheckFailed, match=r"test.cl: astray: the kernel faulted .*work-group 0"):
        refused("astray", values=floats(64), far=np.int32(1 << 24))


def test_a_kernel_that_leaves_its_buffer_by_little_is_told() -> None:
    trace = traced(SOURCE, "astray", 1, 64, values=floats(60), far=np.int32(1))
    assert analyse(trace).outside == 4
    assert trace.ranges.end[0] - trace.ranges.start[0] == 240


def test_a_kernel_that_never_ends_is_told() -> None:
    with pytest.raises(CheckFailed, match="did not end within 2 s in work-group 0"):
        refused("forever", Sampling(timeout=2.0), values=np.zeros(1, np.float32))


def test_what_is_sampled_does_not_hang_on_what_else_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    real = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: 1000 * real())  # another program computes
    machine = SimpleNamespace(run=lambda groups: (np.zeros(3, np.int64), np.array([3])))
    machine.range_start = machine.range_end = np.zeros(0, np.int64)
    request = TraceRequest("", {}, "k", [], 1, (16,), "k")
    found = record(machine, request, Sampling(runs=2, length=8), lambda _: None)  # type: ignore[arg-type]
    assert found.groups.tolist() == list(range(16))


def test_a_group_with_too_much_to_tell_is_refused() -> None:
    with pytest.raises(CannotRun, match="too large to trace"):
        refused("loop", Sampling(words=1000), values=floats())


def test_a_kernel_that_is_not_there_is_told() -> None:
    with pytest.raises(BadInput, match="no kernel 'nothing'; it has copy, stride"):
        refused("nothing")


def test_a_program_that_does_not_build_is_told_with_its_line() -> None:
    with pytest.raises(BadInput, match=r"does not build: line 2:.*undeclared identifier 'y'"):
        traced("__kernel void x(__global int *a)\n{ *a = y; }", "x", 1, 1, a=np.zeros(1, np.int32))
