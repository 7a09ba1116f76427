"""A device held to a profile: every byte counted, every launch checked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gibench.device import SIMT, WIDE, Device, MemoryLedger, kernel_source
from gibench.device.build import named, preferred_layout, width_of
from gibench.device.choice import trial
from gibench.device.selection import list_devices, select_cl_device
from gibench.errors import BadInput, CannotRun, GibenchError
from gibench.profiles import load_profile

SMALL = replace(load_profile("iphone7"), memory_budget_bytes=1000, max_buffer_bytes=600)

KERNELS = """
#define SIZE 64
__kernel void plain(__global float *a) { a[get_global_id(0)] += 1.0f; }
__kernel __attribute__((reqd_work_group_size(64, 1, 1)))
void fixed_size(__global float *a) { a[get_global_id(0)] += 1.0f; }
__kernel void with_local(__global float *a, __local float *l)
{
    __local float own[1024];
    own[get_local_id(0)] = a[get_global_id(0)];
    l[get_local_id(0)] = a[get_global_id(0)];
    barrier(CLK_LOCAL_MEM_FENCE);
    a[get_global_id(0)] = own[0] + l[0];
}
"""


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    (tmp_path / "a.cl").write_text('#include "b.cl"\n#include "b.cl"\n' + KERNELS)
    (tmp_path / "b.cl").write_text("inline float two(void) { return 2.0f; }\n")
    (tmp_path / "broken.cl").write_text("__kernel void f( { nonsense }")
    return tmp_path


@pytest.fixture
def device() -> Device:
    return Device(SMALL)


def test_what_is_counted_is_what_is_allocated(rng: np.random.Generator, device: Device) -> None:
    data = rng.random(30, np.float32)
    first = device.upload("first", data)
    second = device.empty("second", (5, 7), np.uint16)
    for buffer in (first, second):
        assert device.memory.allocated[buffer.name] == buffer.nbytes == buffer.mem.size
    assert device.memory.total_bytes == 120 + 70
    np.testing.assert_array_equal(device.read(first), data)
    assert not device.read(second).any()
    device.release(first)
    assert device.memory.total_bytes == 70
    assert device.memory.peak_bytes == 190


def test_one_buffer_over_the_limit_is_refused_with_bytes(device: Device) -> None:
    device.empty("fits", 600, np.uint8)
    with pytest.raises(CannotRun, match=r"'big' asks for 601 bytes.*iphone7 allows 600"):
        device.empty("big", 601, np.uint8)
    assert device.memory.total_bytes == 600


def test_the_total_over_the_budget_is_refused_with_bytes(device: Device) -> None:
    device.empty("first", 600, np.uint8)
    device.empty("second", 400, np.uint8)
    with pytest.raises(CannotRun, match=r"asks for 1 bytes; 0 of profile iphone7's 1,000"):
        device.empty("third", 1, np.uint8)


def test_a_name_is_given_once(device: Device) -> None:
    device.empty("a", 1, np.uint8)
    with pytest.raises(ValueError, match="already allocated"):
        device.empty("a", 1, np.uint8)


def test_what_the_device_refuses_is_not_counted(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise cl.MemoryError("clCreateBuffer", cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE, "")

    monkeypatch.setattr(cl, "Buffer", refuse)
    with pytest.raises(CannotRun, match="cannot allocate the 8 bytes of 'a'"):
        device.empty("a", 8, np.uint8)
    assert device.memory.total_bytes == 0


def test_writing_past_a_buffer_is_refused(device: Device) -> None:
    buffer = device.empty("a", 4, np.float32)
    device.write(buffer, np.arange(4))  # converted to the buffer's type
    np.testing.assert_array_equal(device.read(buffer), np.arange(4, dtype=np.float32))
    with pytest.raises(ValueError, match="do not fit"):
        device.write(buffer, np.zeros(5))


@settings(max_examples=200)
@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 700), st.booleans()), max_size=40))
def test_the_ledger_never_passes_the_budget(steps: list[tuple[int, int, bool]]) -> None:
    ledger, live = MemoryLedger(SMALL), {}
    for number, nbytes, free in steps:
        name = str(number)
        if name in live:
            if free:
                ledger.release(name)
                del live[name]
            continue
        fits = nbytes <= 600 and sum(live.values()) + nbytes <= 1000
        try:
            ledger.reserve(name, nbytes)
            assert fits
            live[name] = nbytes
        except CannotRun:
            assert not fits
        assert ledger.allocated == live
        assert ledger.total_bytes == sum(live.values()) <= 1000
        assert ledger.peak_bytes >= ledger.total_bytes


def test_launches_are_held_to_the_profile(kernels: Path) -> None:
    device = Device(load_profile("iphone7"), kernel_root=kernels)
    program = device.program("a.cl")
    plain, local = program.kernel("plain"), program.kernel("with_local")
    assert device.launch_problem(plain, 512) is None
    assert "512" in str(device.launch_problem(plain, 544))
    assert "multiple" in str(device.launch_problem(plain, 48))
    # 4096 bytes of its own and what is passed: 16 384 are there.
    assert device.launch_problem(local, 64, 12288) is None
    problem = str(device.launch_problem(local, 64, 12289))
    assert "16,385 bytes" in problem
    assert "16,384" in problem
    assert device.launch_problem(program.kernel("fixed_size"), 64) is None
    assert "the 64 this" in str(device.launch_problem(program.kernel("fixed_size"), 128))


def test_the_executing_devices_own_limits_bind_too(kernels: Path) -> None:
    vast = replace(load_profile("iphone7"), max_workgroup_size=1 << 20, local_memory_bytes=1 << 40)
    device = Device(vast, kernel_root=kernels)
    plain = device.program("a.cl").kernel("plain")
    over = int(device.cl_device.max_work_group_size) * 2
    assert "this kernel allows" in str(device.launch_problem(plain, over))
    too_much = int(device.cl_device.local_mem_size) + 1
    assert "device's own limit" in str(device.launch_problem(plain, 32, too_much))


def test_a_program_is_built_with_the_macros_that_it_names() -> None:
    source = "#if DEEP // SHALLOW\nint f(int a) { return WIDE + a * NARROWER; }\n#endif"
    given = {"DEEP": 1, "SHALLOW": 2, "WIDE": 0.5, "NARROW": True, "WID": 3}
    assert named(source, given) == {"DEEP": 1, "WIDE": 0.5}
    assert named("", given) == {}


def test_programs_are_built_once_per_set_of_defines(kernels: Path) -> None:
    device = Device(SMALL, kernel_root=kernels)
    assert device.program("a.cl") is device.program("a.cl", {})
    assert device.program("a.cl", {"N": 1}) is not device.program("a.cl", {"N": 2})
    assert device.program("a.cl").kernel("plain") is not device.program("a.cl").kernel("plain")


def test_what_does_not_build_is_told(kernels: Path) -> None:
    device = Device(SMALL, kernel_root=kernels)
    with pytest.raises(GibenchError, match=r"building broken\.cl"):
        device.program("broken.cl")
    with pytest.raises(GibenchError, match=r"'missing\.cl' is missing"):
        device.program("missing.cl")
    with pytest.raises(GibenchError, match="no kernel 'nothing'"):
        device.program("a.cl").kernel("nothing")


def test_includes_are_expanded_once(kernels: Path) -> None:
    assert kernel_source("a.cl", kernels).count("inline float two") == 1


def test_a_device_is_chosen_by_number() -> None:
    assert select_cl_device(None) == select_cl_device(0)
    for wrong in (-1, 99):
        with pytest.raises(BadInput, match="gibench devices"):
            select_cl_device(wrong)


def test_pyopencls_variable_is_followed_or_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    first = list_devices()[0]
    monkeypatch.setenv("PYOPENCL_CTX", "Portable")
    assert select_cl_device(None) == first
    for wrong in ("nowhere at all", "99"):
        monkeypatch.setenv("PYOPENCL_CTX", wrong)
        with pytest.raises(BadInput, match="PYOPENCL_CTX"):
            select_cl_device(None)
    monkeypatch.setenv("PYOPENCL_CTX", "Portable")
    assert select_cl_device(0) == first
    assert caplog.text == ""
    monkeypatch.setattr("gibench.device.selection._by_variable", lambda asked: object())
    assert select_cl_device(0) == first
    assert "PYOPENCL_CTX=Portable not followed" in caplog.text


def test_a_device_is_tried_in_a_process_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    assert trial(0) is None
    assert "IndexError" in (trial(99) or "")
    monkeypatch.setattr("gibench.device.choice.TRIAL_S", 0.01)
    assert trial(0) == "no answer within 0.01 s"


class _Prefers:
    """As much of a device as says what vectors it likes."""

    def __init__(self, preferred: int, native: int) -> None:
        self.preferred_vector_width_float = preferred
        self.native_vector_width_float = native


def test_a_layout_is_what_the_device_prefers_or_what_is_asked() -> None:
    """A GPU and Intel's runtime prefer 1 (the latter's registers hold 16), PoCL 8 or 16."""
    for preferred, native, layout, wide in ((1, 1, SIMT, 4), (1, 16, WIDE, 16), (8, 8, WIDE, 8)):
        made_up = _Prefers(preferred, native)
        assert preferred_layout(made_up) == layout
        assert (width_of(made_up, SIMT), width_of(made_up, WIDE)) == (1, wide)
    device = Device(SMALL, layout=SIMT)
    assert (device.layout, device.vector_width) == (SIMT, 1)
    assert Device(SMALL).layout == WIDE
