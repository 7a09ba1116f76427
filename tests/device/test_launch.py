"""Launches are declared by name with access, refused in one line, and counted without an edit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gibench.device import (
    Access,
    Argument,
    BufferSpec,
    Device,
    Launch,
    ProgramSpec,
    integer,
    largest,
    local,
    reads,
    scalar,
    total_bytes,
    updates,
    writes,
)
from gibench.errors import CannotRun, GibenchError
from gibench.profiles import load_profile

SOURCE = """
__kernel void add(__global const float *a, float factor, __global const float *b, int count,
                  __local float *scratch, __global float *sum)
{
    const int i = get_global_id(0);
    scratch[get_local_id(0)] = 0.0f;
    if (i < count)
        sum[i] = a[i] + factor * b[i];
}

__kernel void rows(__global int *out, int across)
{
    out[get_global_id(1) * across + get_global_id(0)] += 1;
}
"""
N = 70


@pytest.fixture
def device(tmp_path: Path) -> Device:
    (tmp_path / "sums.cl").write_text(SOURCE)
    return Device(load_profile("iphone7"), kernel_root=tmp_path)


def adding(device: Device) -> Launch:
    a, b = (device.upload(name, np.arange(N, dtype=np.float32)) for name in "ab")
    args = (
        reads("a", a),
        scalar("factor", np.float32(2.0)),
        reads("b", b),
        integer("count", N),
        local("scratch", 4 * 32),
        writes("sum", device.empty("sum", N, np.float32)),
    )
    return Launch(ProgramSpec("sums.cl"), "add", args, items=N)


def test_a_launch_is_data_until_it_is_enqueued(device: Device) -> None:
    launch = adding(device)
    (result,) = launch.buffers(Access.WRITE, Access.UPDATE)
    assert [buffer.name for buffer in launch.buffers(Access.READ)] == ["a", "b"]
    prepared = device.prepare(launch, 32)
    assert prepared.launch is launch
    assert prepared.global_sizes == (96,)
    prepared.enqueue(device.queue)
    np.testing.assert_array_equal(device.read(result), 3 * np.arange(N))
    device.write(result, np.zeros(N))
    device.enqueue(launch, 32)
    np.testing.assert_array_equal(device.read(result), 3 * np.arange(N))


def test_kernels_of_single_launches_take_new_arguments(device: Device) -> None:
    launch = adding(device)
    (result,) = launch.buffers(Access.WRITE)
    for factor in (1.0, 5.0):
        args = [
            scalar("factor", np.float32(factor)) if a.name == "factor" else a for a in named(launch)
        ]
        device.enqueue(replace(launch, args=args), 32)
        np.testing.assert_array_equal(device.read(result), (1 + factor) * np.arange(N))


def named(launch: Launch) -> list[Argument]:
    return [a for a in launch.args if isinstance(a, Argument)]


def test_swapped_missing_and_spare_arguments_are_told_in_one_line(device: Device) -> None:
    launch = adding(device)
    a, factor, b, *rest = named(launch)
    for args, told in (
        ([b, factor, a, *rest], "sums.cl: add takes 'a' as argument 1, not 'b'"),
        ([a, b, factor, *rest], "sums.cl: add takes 'factor' as argument 2, not 'b'"),
        ([a, factor, b, *rest[:-1]], "sums.cl: add takes 6 arguments, not 5: 'sum' is missing"),
        ([a, factor, b, *rest, a], "sums.cl: add takes 6 arguments, not 7"),
        ([replace(a, name="A"), factor, b, *rest], "sums.cl: add takes 'a' as argument 1, not 'A'"),
    ):
        for run in (device.prepare, device.enqueue):
            with pytest.raises(GibenchError) as refused:
                run(replace(launch, args=args), 32)
            assert str(refused.value) == told


def test_access_and_type_are_held_against_the_kernel(device: Device) -> None:
    launch = adding(device)
    a, factor, b, count, scratch, total = named(launch)
    for args, told in (
        ([replace(a, access=Access.WRITE), factor, b, count, scratch, total], "can only read"),
        ([a, factor, b, count, scratch, replace(total, access=Access.READ)], "may write it"),
        ([a, scalar("factor", np.int32(2)), b, count, scratch, total], "is float, not int32"),
        ([a, factor, b, scalar("count", np.float32(2)), scratch, total], "is int, not float32"),
        ([a, factor, b, count, updates("scratch", total.value), total], "not a buffer"),  # type: ignore[arg-type]
        ([a, factor, local("b", 4), count, scratch, total], "is not local memory"),
        ([a, factor, scalar("b", np.float32(1)), count, scratch, total], "not a number"),
    ):
        with pytest.raises(GibenchError, match=told):
            device.prepare(replace(launch, args=args), 32)


def test_single_launches_are_held_to_the_profile_too(device: Device) -> None:
    with pytest.raises(CannotRun, match="multiple"):
        device.enqueue(adding(device), 48)


def test_groups_have_rows(device: Device) -> None:
    out = device.empty("out", (3, 64), np.int32)
    args = (updates("out", out), integer("across", 64))
    launch = Launch(ProgramSpec("sums.cl"), "rows", args, items=(64, 3))
    device.enqueue(launch, 32)
    device.enqueue(replace(launch, items=None, groups=(2, 3)), 32)
    np.testing.assert_array_equal(device.read(out), np.full((3, 64), 2))
    assert device.enqueue(replace(launch, items=(64, 0)), 32) is None


def test_programs_know_whether_a_group_matters(device: Device) -> None:
    program = device.program("sums.cl")
    assert program.asks_for_its_group("add")
    assert not program.asks_for_its_group("rows")
    assert program.asks_for_its_group("no_such_kernel")


def test_a_device_beside_shares_all_but_its_queue_and_ledger(device: Device) -> None:
    launch = adding(device)
    other = device.beside()
    (result,) = launch.buffers(Access.WRITE)
    assert other.program("sums.cl") is device.program("sums.cl")
    assert other.queue is not device.queue
    assert other.memory.total_bytes == 0
    other.enqueue(launch, 32)
    np.testing.assert_array_equal(other.read(result), 3 * np.arange(N))


def test_buffers_come_from_their_declaration(device: Device) -> None:
    specs = [
        BufferSpec.of("words", 5, np.uint32),
        BufferSpec.of("maps", (2, 3, 4), np.float16),
        BufferSpec.of("nothing", 0, np.float32),
    ]
    assert total_bytes(specs) == 20 + 48
    assert largest(specs) == 48
    assert largest([]) == 0
    data = np.arange(5, dtype=np.uint32)
    found = device.allocate(specs, {"words": data})
    assert device.memory.allocated == {spec.name: spec.nbytes for spec in specs}
    np.testing.assert_array_equal(device.read(found["words"]), data)
    np.testing.assert_array_equal(device.read(found["maps"]), np.zeros((2, 3, 4), np.float16))
    with pytest.raises(ValueError, match="'other' is declared as float32"):
        device.create(BufferSpec.of("other", 5, np.float32), data)
    with pytest.raises(ValueError, match="no buffer 'unknown'"):
        device.allocate([], {"unknown": data})


def test_no_profile_binds_an_unlimited_device(tmp_path: Path) -> None:
    (tmp_path / "sums.cl").write_text(SOURCE)
    device = Device.unlimited(kernel_root=tmp_path)
    launch = adding(device)
    device.enqueue(launch, 7)
    (result,) = launch.buffers(Access.WRITE)
    np.testing.assert_array_equal(device.read(result), 3 * np.arange(N))
