"""What fits a profile, and from where a scene is seen."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import fake_technique
from support.made import made
from support.synthetic_bake import random_lightmap

from gibench.device import BufferSpec, Device
from gibench.errors import BadInput, CannotRun
from gibench.measure.plan.fit import Demand, Footprint, demand_of
from gibench.measure.plan.view import choose_camera
from gibench.profiles import DeviceProfile, load_profile
from gibench.scene.builtin import build
from gibench.scene.readers.viewpoint import suggested_camera
from gibench.techniques.job import Job, Known, Shot, World
from gibench.techniques.registry import find_technique

IPHONE, RADEON = load_profile("iphone7"), load_profile("radeon560")


@given(st.integers(1, 10**6), st.integers(0, 5000), st.integers(0, 10**9), st.integers(1, 10**9))
def test_the_most_receivers_fit_and_one_more_does_not(
    asked_for: int, each: int, fixed: int, budget: int
) -> None:
    def buffers(known: Known) -> list[BufferSpec]:
        return [BufferSpec.of("all", fixed + known.receivers * each, np.uint8)]

    spec = replace(fake_technique.SPEC, buffers=buffers)
    profile = replace(IPHONE, memory_budget_bytes=budget)
    job = Job("fake", fake_technique.FakeSettings(), "tuned", "none", profile, 64)
    footprint = Footprint(spec, Known(job, None, 0))  # type: ignore[arg-type]
    most = footprint.most_receivers(asked_for)
    assert 0 <= most <= asked_for
    assert most == 0 or fixed + most * each <= budget
    assert most == asked_for or fixed + (most + 1) * each > budget


@dataclass(frozen=True)
class _Settings:
    """Of a technique that has no receivers on the device."""

    boxes: int = 1000
    nuts: int = 50
    share: float = 0.5

    def __post_init__(self) -> None:
        if self.nuts < 3:
            raise BadInput("too few nuts")


@given(st.integers(1, 400), st.integers(1, 100), st.integers(100, 30_000), st.integers(50, 20_000))
def test_a_refusal_names_the_most_that_fits(each: int, more: int, budget: int, one: int) -> None:
    """Of every whole-numbered option alone, by what is expected; and one more would not."""

    def held(known: Known) -> list[BufferSpec]:
        s = known.job.settings
        return [BufferSpec.of("a", s.boxes * each, np.uint8), BufferSpec.of("b", s.nuts, np.int64)]

    def expected(known: Known) -> list[BufferSpec]:
        return [*held(known), BufferSpec.of("c", known.job.settings.boxes * more, np.uint8)]

    options = tuple(f"--set fake.{name}" for name in ("boxes", "nuts", "share"))
    spec = replace(
        fake_technique.SPEC, buffers=held, expected=expected, memory_options=options, name="fake"
    )
    profile = replace(IPHONE, memory_budget_bytes=budget, max_buffer_bytes=one)
    job = Job("fake", _Settings(), "tuned", "none", profile, 64)
    footprint = Footprint(spec, Known(job, build("cornell-box"), 0))
    total, most = 1000 * each + 400, max(1000 * each, 400)
    if total <= budget and most <= one:
        footprint.check(0)
        return
    with pytest.raises(CannotRun) as refused:
        footprint.check(0)
    told = str(refused.value)
    assert ("in one buffer" in told) == (most > one)
    given_ = {name: int(n) for name, n in re.findall(r"fake\.(\w+)=(\d+)", told)}

    def fits(boxes: int, nuts: int) -> bool:
        sizes = boxes * each, 8 * nuts, boxes * more
        return sum(sizes) <= budget and max(sizes) <= one

    boxes = max((n for n in range(1, 1000) if fits(n, 50)), default=0)
    nuts = max((n for n in range(3, 50) if fits(1000, n)), default=0)
    assert given_ == {n: v for n, v in (("boxes", boxes), ("nuts", nuts)) if v}


def test_the_demand_is_what_is_allocated_without_limits(rng: np.random.Generator) -> None:
    scene, spec = build("cornell-box"), find_technique("direct")
    lightmap = random_lightmap(rng, scene, 50, 10, 10)
    vast = made(
        spec, Device(IPHONE), scene, lightmap, spec.settings({}), None, "tuned", 64, 30, 20,
        scene.cameras[0],
    )  # fmt: skip
    held = vast.device.memory.allocated
    tight = replace(IPHONE, memory_budget_bytes=sum(held.values()) - 1)
    world = World(scene, lightmap, None, scene.cameras[0])

    def demand(profile: DeviceProfile) -> Demand | None:
        job = Job("direct", spec.settings({}), "tuned", scene.name, profile, 64, shot=Shot(30, 20))
        return demand_of(spec, job, world, vast.device)

    total, most = sum(held.values()), max(held.values())
    assert demand(tight) == Demand(total, most, total, most)
    assert demand(replace(IPHONE, max_buffer_bytes=most - 1)) == Demand(total, most, total, most)
    assert demand(replace(IPHONE, memory_budget_bytes=total, max_buffer_bytes=most)) is None


def test_the_demand_scales_to_both_limits() -> None:
    profile = replace(IPHONE, memory_budget_bytes=1000, max_buffer_bytes=100)
    assert Demand(2000, 100).receivers_that_fit(profile, 1000) == 485
    assert Demand(1000, 400).receivers_that_fit(profile, 1000) == 242


def test_what_receivers_do_not_change_is_not_scaled() -> None:
    profile = replace(IPHONE, memory_budget_bytes=1000, max_buffer_bytes=100)
    # 600 of 2000 bytes are fixed: 400 of the other 1400 fit.
    assert Demand(2000, 100, 600, 90).receivers_that_fit(profile, 1000) == int(970 * 400 / 1400)
    # The image alone is larger than any buffer may be, or the scene fills the budget.
    assert Demand(2000, 200, 600, 101).receivers_that_fit(profile, 1000) == 0
    assert Demand(2000, 100, 1200, 90).receivers_that_fit(profile, 1000) == 0


def test_a_camera_by_number_or_name() -> None:
    scene = build("cornell-box")
    assert choose_camera(scene, None) is scene.cameras[0]
    assert choose_camera(scene, "1") is scene.cameras[1]
    assert choose_camera(scene, scene.cameras[1].name) is scene.cameras[1]
    with pytest.raises(BadInput, match="no camera '77'"):
        choose_camera(scene, "77")


def test_a_scene_without_cameras_is_seen_from_within() -> None:
    scene = replace(build("hall"), cameras=())
    camera = choose_camera(scene, None)
    assert camera == suggested_camera(scene)
    low, high = scene.bounds
    assert (np.array(camera.position) > low).all()
    assert (np.array(camera.position) < high).all()
