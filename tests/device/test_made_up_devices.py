"""Devices and platforms that are not at hand, as made-up records: what runs, and what is told."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from gibench.cli.main import call
from gibench.device import Device
from gibench.device.able import lacks
from gibench.device.choice import default_device
from gibench.device.selection import list_devices, select_cl_device
from gibench.errors import CannotRun
from gibench.measure.compare.lockstep import FRAME, PairTimes
from gibench.profiles import load_profile
from gibench.resources import data

CPU, GPU, OTHER = cl.device_type.CPU, cl.device_type.GPU, cl.device_type.ACCELERATOR
PROFILING = cl.command_queue_properties.PROFILING_ENABLE
OUT_OF_ORDER = cl.command_queue_properties.OUT_OF_ORDER_EXEC_MODE_ENABLE


@dataclass(frozen=True)
class Made:
    """A made-up record of a device; by default a GPU with the least that OpenCL 1.2 asks for."""

    name: str = "device"
    type: int = GPU
    platform: Any = None
    version: str = "OpenCL 1.2 made up"
    available: bool = True
    compiler_available: bool = True
    queue_properties: int = PROFILING
    extensions: str = ""
    image_support: bool = False
    address_bits: int = 32
    local_mem_size: int = 16384


@dataclass(frozen=True)
class MadePlatform:
    """A made-up platform."""

    name: str
    devices: tuple[Made, ...] = ()
    problem: str = ""

    def get_devices(self) -> list[Made]:
        """Its devices, or what it says instead."""
        if self.problem:
            raise cl.LogicError(f"clGetDeviceIDs failed: {self.problem}")
        return [replace(device, platform=self) for device in self.devices]


@pytest.fixture
def platforms(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Puts made-up platforms in the place of this machine's; no device of them is tried."""
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)
    monkeypatch.setattr("gibench.device.selection._name_once", lambda device: None)

    def put(*made: MadePlatform, problems: dict[str, str] | None = None) -> None:
        def default(devices: Sequence[Any]) -> tuple[Any, str]:
            return default_device(devices, lambda n: (problems or {}).get(devices[n].name))

        monkeypatch.setattr(cl, "get_platforms", lambda: list(made))
        monkeypatch.setattr("gibench.device.selection._default", default)

    return put


POCL = MadePlatform("Portable Computing Language", (Made("cpu", CPU),))


@pytest.mark.parametrize(
    ("kinds", "problems", "chosen", "why"),
    [
        ([CPU], {}, 0, "no GPU was found"),
        ([CPU, GPU], {1: None}, 1, "a GPU"),
        ([CPU, GPU], {1: "a small kernel's result is wrong"}, 0, "device 1 is not used (a small"),
        ([CPU, GPU, GPU], {1: "no answer within 30 s", 2: None}, 2, "a GPU"),
        ([GPU, CPU], {0: "it burns"}, 1, "device 0 is not used (it burns)"),
        ([OTHER, CPU], {}, 1, "no GPU was found"),
    ],
)
def test_a_gpu_that_computes_right_is_the_default(
    kinds: list[int], problems: dict[int, str | None], chosen: int, why: str
) -> None:
    inc = MadePlatform("Any Inc.")
    devices = [Made(f"device {number}", kind, inc) for number, kind in enumerate(kinds)]
    found, said = default_device(devices, lambda number: problems[number])
    assert found is devices[chosen]
    assert said.startswith(why)


def test_a_device_that_was_refused_is_never_the_default(
    platforms: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "gibench.device")
    only = MadePlatform("Graphics Inc.", (Made("gpu"), Made("other", OTHER)))
    platforms(only, problems={"gpu": "wrong result"})
    with pytest.raises(CannotRun, match=r"gpu is not used \(wrong result\)") as told:
        select_cl_device(None)
    assert "install PoCL" in str(told.value)
    assert select_cl_device(0).name == "gpu"  # who asks for it gets it
    assert not caplog.records
    platforms(POCL)
    assert select_cl_device(None).name == "cpu"
    assert not caplog.records
    platforms(only)
    assert select_cl_device(None).name == "gpu"
    assert "on gpu (Graphics Inc.): a GPU" in caplog.text
    # PoCL's own devices serve whatever type they are of.
    platforms(MadePlatform("Portable Computing Language", (Made("basic", OTHER),)))
    assert select_cl_device(None).name == "basic"


def test_ab_runs_where_it_says_whatever_else_there_is(
    platforms: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pocl = list_devices()[0].platform
    platforms(MadePlatform("Graphics Inc.", (Made("gpu"),)), pocl)
    assert select_cl_device(None).name == "gpu"
    ran = []

    def pair(job: Any, old: Any, new: Any, *, frames: int, keep: Path, **others: Any) -> PairTimes:
        ran.extend([old.device, new.device])
        for side in ("OLD", "NEW"):
            np.savez(keep / f"{side}.npz", light=np.ones(3))
        return PairTimes({FRAME: np.ones(frames)}, {FRAME: np.ones(frames)})

    monkeypatch.setattr("gibench.measure.compare.ab.time_pair", pair)
    monkeypatch.setattr("gibench.measure.compare.ab.bake_once", lambda job, cache: None)
    tree = str(data("kernels_cl"))
    arguments = ("--technique", "direct", "--replicates", "1", "--json", "-")
    assert call(["ab", tree, tree, *arguments]) == 0
    told = json.loads(capsys.readouterr().out)["measured"]["device"]
    assert ran and {list_devices()[number].platform for number in ran} == {pocl}
    assert told.startswith(pocl.name.strip())


def test_pocl_comes_first_of_several_platforms_and_a_line_says_what_runs(
    platforms: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "gibench.device")
    other = MadePlatform("Graphics Inc.", (Made("slow gpu"), Made("fast gpu")))
    platforms(MadePlatform("CPU Inc.", (Made("other cpu", CPU),)), POCL, other)
    names = [device.name for device in list_devices()]
    assert names == ["cpu", "other cpu", "slow gpu", "fast gpu"]
    assert select_cl_device(None).name == "slow gpu"
    assert "on slow gpu (Graphics Inc.): a GPU; --device N takes another" in caplog.text
    assert select_cl_device(1).name == "other cpu"
    platforms(POCL, other, problems={"slow gpu": "no answer within 30 s"})
    assert select_cl_device(None).name == "fast gpu"
    caplog.clear()
    platforms(POCL, other, problems={"slow gpu": "wrong", "fast gpu": "no answer"})
    assert select_cl_device(None).name == "cpu"
    assert len(caplog.records) == 1
    assert "slow gpu is not used (wrong); fast gpu is not used (no answer)" in caplog.text


def test_pyopencls_variable_names_one_of_several_platforms(
    platforms: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "gibench.device")
    platforms(POCL, MadePlatform("Graphics Inc.", (Made("one"), Made("two"))))
    for asked, name in (("Graphics:two", "two"), ("Portable", "cpu"), ("1:0", "one")):
        monkeypatch.setenv("PYOPENCL_CTX", asked)
        assert select_cl_device(None).name == name
        assert f"on {name}" in caplog.text
        assert f"PYOPENCL_CTX={asked}" in caplog.text


def test_a_platform_that_cannot_load_is_named_and_skipped(
    platforms: Any, caplog: pytest.LogCaptureFixture
) -> None:
    broken = MadePlatform("Broken Inc.", problem="OUT_OF_HOST_MEMORY")
    empty = MadePlatform("Empty Inc.", problem="DEVICE_NOT_FOUND")
    platforms(broken, empty, POCL)
    assert [device.name for device in list_devices()] == ["cpu"]
    assert "'Broken Inc.' skipped" in caplog.text
    assert "Empty" not in caplog.text  # it has merely no device
    platforms(broken, empty)
    with pytest.raises(CannotRun, match="offer no device"):
        list_devices()


@pytest.mark.parametrize("version", ["1.2", "2.0", "2.1", "2.2", "3.0"])
@pytest.mark.parametrize("queues", [PROFILING, PROFILING | OUT_OF_ORDER])
@pytest.mark.parametrize("bits", [32, 64])
def test_nothing_more_is_asked_of_a_device_than_it_must_have(
    version: str, queues: int, bits: int
) -> None:
    """No fp16, no images, no second kind of queue, either address space, 16 KB of local memory."""
    made = Made(version=f"OpenCL {version} made up", queue_properties=queues, address_bits=bits)
    assert lacks(made) is None


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (Made(version="OpenCL 1.1 old"), "it is of OpenCL 1.1 old, and OpenCL 1.2 is needed"),
        (Made(version="?"), "OpenCL 1.2 is needed"),
        (Made(queue_properties=OUT_OF_ORDER), "no profiling"),
        (Made(compiler_available=False), "no compiler"),
        (Made(available=False), "not available"),
    ],
)
def test_what_a_device_lacks_is_told_in_one_line(
    made: Made, why: str, platforms: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in (lacks(made) or "")
    with pytest.raises(CannotRun, match="nothing can run on device: ") as told:
        Device(load_profile("iphone7"), made)
    assert why in str(told.value)
    # A GPU that lacks something is not even tried: PoCL runs, and the line says why.
    platforms(POCL, MadePlatform("Graphics Inc.", (made,)))
    found, said = default_device(list_devices(), lambda number: pytest.fail("tried"))
    assert found.name == "cpu"
    assert why in said
    platforms(MadePlatform("Graphics Inc.", (made,)))
    assert call(["run", "--device", "0", "--frames", "1", "--technique", "direct"]) == 3
    lines = capsys.readouterr().err.strip().splitlines()
    assert why in lines[-1]
    assert "Traceback" not in "".join(lines)


class Small:
    """A device that is there, with as much local memory and as small groups as a made-up one."""

    def __init__(self, device: Any, local_mem_size: int) -> None:
        self._device, self.local_mem_size = device, local_mem_size

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)


def test_16_kb_of_local_memory_bind_whatever_the_profile_has(tmp_path: Path) -> None:
    (tmp_path / "a.cl").write_text("__kernel void k(__local float *l) { l[get_local_id(0)] = 0; }")
    large = replace(load_profile("vega56"), local_memory_bytes=65536)
    device = Device(large, kernel_root=tmp_path)
    kernel = device.program("a.cl").kernel("k")
    device.cl_device, whole = Small(device.cl_device, 16384), device.cl_device
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(kernel), "get_work_group_info", _asked_of(whole), raising=False)
        assert device.launch_problem(kernel, 64, 16384) is None
        assert "device's own limit" in str(device.launch_problem(kernel, 64, 16388))


def test_kernels_ask_for_no_halves_no_doubles_and_no_images() -> None:
    """Halves are loaded and stored by ``vload_half`` and ``vstore_half`` alone, which are of the
    core language; so no kernel needs an extension of its device."""
    texts = {str(path): path.read_text() for path in Path(str(data("kernels_cl"))).rglob("*.cl")}
    assert len(texts) > 50
    asked = re.compile(
        r"image[123]d|sampler_t|pragma\s+OPENCL\s+EXTENSION|cl_khr_|\bdouble[2348]?\b"
    )
    for path, text in texts.items():
        code = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.S)
        assert not asked.findall(code), path
        # A half is only ever pointed at.
        assert not re.findall(r"(?<!typedef )\bhalf\d*\s+(?!\*)\w+\s*[=;,]", code), path


def _asked_of(device: Any) -> Any:
    original = cl.Kernel.get_work_group_info

    def asked(kernel: Any, info: Any, _: Any) -> Any:
        return original(kernel, info, device)

    return asked
