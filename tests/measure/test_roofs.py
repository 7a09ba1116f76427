"""The machine: its roofs, its environment, and paths that are nobody's business."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.vector_widths import widths

from gibench.device import Device
from gibench.measure.machine.environment import environment, versions, without_paths
from gibench.measure.machine.roofs import measure_roofs
from gibench.profiles import load_profile

IPHONE, RADEON = load_profile("iphone7"), load_profile("radeon560")


@pytest.mark.roofs
def test_the_machines_roofs_are_plausible() -> None:
    roofs = measure_roofs(replace(IPHONE, memory_budget_bytes=1, max_buffer_bytes=1))
    assert 1 < roofs.triad_gb_per_s < 5000
    assert 1 < roofs.read_gb_per_s < 5000
    assert 5 < roofs.fma_gflop_per_s < 200_000
    assert 0.05 < roofs.launch_us < 5000
    assert 0.1 < roofs.mrays_per_s < 50_000


@pytest.mark.parametrize(("count", "stretch", "size"), ((1000, 7, 8), (64, 4, 64), (13, 4, 32)))
@pytest.mark.parametrize("width", widths(1, 4, 8, 16))
def test_the_roof_kernels_do_what_they_say(
    rng: np.random.Generator, count: int, stretch: int, size: int, width: int
) -> None:
    device = Device(IPHONE)
    program = device.program("measure/roofs.cl", {"VEC": width})
    b, c = (rng.random(count * width, np.float32) for _ in range(2))
    items = -(-count // stretch) // size * size + size  # more than the work asks for
    out = device.empty("a", count * width, np.float32)
    sums = device.empty("sums", items * width, np.float32)
    mem_b, mem_c = device.upload("b", b).mem, device.upload("c", c).mem

    def launch(name: str, *arguments: Any) -> None:
        import pyopencl as cl

        kernel = program.kernel(name)
        kernel.set_args(*arguments)
        cl.enqueue_nd_range_kernel(device.queue, kernel, (items,), (size,))

    triad = np.float32(0.75), np.uint32(count), np.uint32(stretch)
    launch("roof_triad", out.mem, mem_b, mem_c, *triad)
    np.testing.assert_allclose(device.read(out), b + 0.75 * c.astype(np.float64), rtol=1e-6)

    four = 4 * -(-stretch // 4)
    launch("roof_read", sums.mem, mem_b, np.uint32(count), np.uint32(four))
    whole = count // 4 * 4  # it reads whole fours, for speed
    np.testing.assert_allclose(
        device.read(sums).reshape(items, width).astype(np.float64).sum(axis=0),
        b.reshape(count, width)[:whole].astype(np.float64).sum(axis=0),
        rtol=1e-5,
    )

    turns = 40
    launch("roof_fma", sums.mem, np.float32(0.5), np.uint32(turns), np.uint32(items))
    start = 0.5 + (np.arange(items) & 7)
    chains = start[:, None] + np.arange(10.0)
    for _ in range(turns):
        chains = chains * 0.5 + start[:, None]
    expected = np.repeat(chains.sum(axis=1), width)
    np.testing.assert_allclose(device.read(sums), expected, rtol=1e-5)

    nothing = np.zeros(count * width, np.float32)
    device.write(out, nothing)
    launch("roof_launch", out.mem)
    nothing[0] = 1.0
    np.testing.assert_array_equal(device.read(out), nothing)


def test_the_environment_holds_nothing_personal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("POCL_CACHE_DIR", "/home/alice/secret/cache")
    monkeypatch.setenv("POCL_MAX_PTHREAD_COUNT", "2")
    found = environment()
    assert found["variables"]["POCL_MAX_PTHREAD_COUNT"] == "2"
    assert found["variables"]["POCL_CACHE_DIR"] == "cache"
    text = json.dumps([found, versions()])
    assert "alice" not in text
    assert os.uname().nodename not in text.replace(os.uname().release, "")
    assert str(Path.home()) not in text
    assert found["cpu"]
    assert versions()["numpy"] == np.__version__


@pytest.mark.parametrize(
    ("text", "clean"),
    (
        ("/home/bob/a b.obj: broken", "a b.obj: broken"),
        ("cannot read /root/x/y.obj; mend", "cannot read y.obj; mend"),
        ("'~/data/scene.toml'", "'scene.toml'"),
        ("radiance in W/m2/sr", "radiance in W/m2/sr"),
        ("10 of 20 and/or more", "10 of 20 and/or more"),
    ),
)
def test_paths_are_cut_to_their_last_part(text: str, clean: str) -> None:
    assert without_paths(text) == clean
