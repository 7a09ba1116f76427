"""Statistics, the grid, fitting, the run folder, the environment and the machine's roofs."""

from __future__ import annotations

import itertools
import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import fake_technique
from support.made import made
from support.synthetic_bake import random_lightmap
from support.vector_widths import widths

from gibench.bake.lightmap import cached_lightmap
from gibench.commands.asked import by_option, read_settings
from gibench.device import BufferSpec, Device
from gibench.errors import BadInput, CannotRun, GibenchError
from gibench.measure.machine.environment import environment, versions, without_paths
from gibench.measure.machine.roofs import measure_roofs
from gibench.measure.plan.fit import Demand, Footprint, demand_of
from gibench.measure.plan.grid import grid, typed_value
from gibench.measure.plan.view import choose_camera
from gibench.measure.runfolder.axes import TAKEN, axes_of, axis_values
from gibench.measure.runfolder.folder import (
    RunFolder,
    default_folder,
    sample_columns,
    write_atomically,
)
from gibench.measure.statistics.summary import (
    Roofs,
    best_of,
    least_ms,
    moved,
    per_second,
    summarize,
)
from gibench.profiles import DeviceProfile, load_profile
from gibench.report.tables import frame_columns, pass_columns
from gibench.scene.builtin import build
from gibench.scene.readers.viewpoint import suggested_camera
from gibench.study.quality import columns
from gibench.techniques.job import Job, Known, Shot, World
from gibench.techniques.registry import declared_counts, find_technique
from gibench.techniques.technique import Work

IPHONE, RADEON = load_profile("iphone7"), load_profile("radeon560")


@given(st.lists(st.floats(1e-3, 1e4), min_size=1, max_size=60))
def test_the_summary_is_in_order(times: list[float]) -> None:
    s = summarize(times)
    assert s.count == len(times)
    assert s.min_ms <= s.median_ms <= s.p95_ms <= s.p99_ms <= s.max_ms
    assert s.min_ms <= s.mean_ms * (1 + 1e-12) and s.mean_ms <= s.max_ms * (1 + 1e-12)


def test_the_summary_by_hand() -> None:
    s = summarize([4.0, 1.0, 2.0, 3.0, 10.0])
    assert (s.mean_ms, s.median_ms, s.min_ms, s.max_ms) == (4.0, 3.0, 1.0, 10.0)
    assert s.stdev_ms == pytest.approx(math.sqrt((0 + 9 + 4 + 1 + 36) / 4))
    assert s.p95_ms == pytest.approx(4.0 + 0.8 * 6.0)
    assert math.isnan(summarize([1.0]).stdev_ms)
    assert math.isnan(summarize([]).median_ms)


def test_the_roof_is_the_slowest_of_bytes_flops_and_rays() -> None:
    roofs = Roofs(
        read_gb_per_s=20, triad_gb_per_s=10, fma_gflop_per_s=100, launch_us=1, mrays_per_s=5
    )
    assert least_ms(Work(bytes_read=15e6, bytes_written=5e6), roofs) == pytest.approx(1.0)
    assert least_ms(Work(flops=2e8, bytes_read=2e7), roofs) == pytest.approx(2.0)
    assert least_ms(Work(flops=2e8, rays=2e4), roofs) == pytest.approx(4.0)
    assert math.isnan(least_ms(Work(), roofs))
    unmeasured = replace(roofs, mrays_per_s=math.nan)
    assert least_ms(Work(flops=2e8, rays=2e4), unmeasured) == pytest.approx(2.0)


def test_rates_and_moving_roofs() -> None:
    assert per_second(5e9, 500.0, 1e9) == pytest.approx(10.0)
    assert math.isnan(per_second(0, 1.0, 1e9))
    start = Roofs(20, 10, 100, 1.0, math.nan)
    end = Roofs(17, 10.5, 111, 5.0, math.nan)
    assert set(moved(start, end)) == {"read_gb_per_s", "fma_gflop_per_s"}
    assert moved(start, end)["read_gb_per_s"] == pytest.approx(-0.15)
    assert moved(start, start) == {}
    best = best_of(start, replace(end, mrays_per_s=3.0))
    assert (best.read_gb_per_s, best.fma_gflop_per_s, best.launch_us) == (20, 111, 1.0)
    assert best.mrays_per_s == 3.0


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


def test_the_grid_is_the_product_without_repeats() -> None:
    specs = [fake_technique.SPEC, fake_technique.PLAIN]
    found = grid(
        [IPHONE, RADEON],
        specs,
        variants=("published", "tuned"),
        common={"sh_order": (1, 2, 1), "probes": (5,)},
        workgroup_sizes=(64, 128),
    )
    fakes = [job for job in found if job.technique == "fake"]
    plain = [job for job in found if job.technique == "plain"]
    assert len(fakes) == 2 * 2 * 2 * 2  # variants, orders, sizes, profiles
    assert len(plain) == 2 * 2  # sizes, profiles
    bakes = [(job.technique, repr(job.settings)) for job in found]
    changes = sum(a != b for a, b in itertools.pairwise(bakes))
    assert changes == len(set(bakes)) - 1  # those that share a bake are next to each other


def test_the_grid_takes_each_profiles_own_size() -> None:
    wide = replace(RADEON, name="wide", default_workgroup_size=64)
    found = grid([IPHONE, wide], [fake_technique.PLAIN])
    assert [c.workgroup_size for c in found] == [IPHONE.default_workgroup_size, 64]


@pytest.mark.parametrize(
    ("options", "error", "told"),
    (
        ({"receivers": (0,)}, BadInput, "--receivers"),
        ({"variants": ("fast",)}, BadInput, "fast"),
        ({"workgroup_sizes": (0,)}, BadInput, "--workgroup-size"),
        ({"workgroup_sizes": (3000, 2048)}, BadInput, "2048 is over the 512 of profile iphone7"),
        ({"workgroup_sizes": (48,)}, CannotRun, "multiple"),
        ({"settings": {"other": {"a": ("1",)}}}, BadInput, "other"),
    ),
)
def test_the_grid_refuses(options: dict[str, Any], error: type[GibenchError], told: str) -> None:
    with pytest.raises(error) as refused:
        grid([IPHONE], [fake_technique.SPEC], **options)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("sh_order", "probes", "told"),
    ((9, None, "0 to 7"), ((2, -1), None, "0 to 7"), (2, 0, "--probes")),
)
def test_settings_with_an_option_of_their_own_are_refused(
    sh_order: Any, probes: Any, told: str
) -> None:
    with pytest.raises(BadInput, match=told):
        grid([IPHONE], [find_technique("srp")], common=by_option(sh_order, probes))


def test_any_setting_is_an_axis() -> None:
    """Given twice it makes two jobs, and has a column: its own, or with its technique's name where
    a table has a column of that name already.
    """
    texts = ["gibs.ray_budget=50000", "gibs.ray_budget=100000", "ddgi.rays=64", "ddgi.rays=128"]
    specs = [find_technique("gibs"), find_technique("ddgi")]
    jobs = grid([IPHONE], specs, settings=read_settings(texts))
    axes = axes_of(jobs)
    assert [axis_values(job, axes) for job in jobs] == [
        {"sh_order": None, "ray_budget": 50000, "ddgi.rays": None},
        {"sh_order": None, "ray_budget": 100000, "ddgi.rays": None},
        {"sh_order": None, "ray_budget": None, "ddgi.rays": 64},
        {"sh_order": None, "ray_budget": None, "ddgi.rays": 128},
    ]
    mapped = {"gibs.ray_budget": [50000, 100000], "ddgi.rays": (64, 128)}
    assert grid([IPHONE], specs, settings=read_settings(mapped)) == jobs


def test_no_axis_takes_the_place_of_a_column() -> None:
    content: dict[str, Any] = {"axes": [], "counts": {}}
    fixed = {*pass_columns(content), *frame_columns(content), *columns(()), *sample_columns((), ())}
    assert not [name for name in fixed - TAKEN - set(declared_counts()) if not _is_figure(name)]


def _is_figure(name: str) -> bool:
    """Names that no setting will have: figures with a unit or of an error metric."""
    ends = ("_ms", "_per_s", "_noise", "_fraction", "_covered", "_open", "_mse", "_l2")
    return name.endswith(ends) or name.startswith("reference_")


@pytest.mark.parametrize(
    ("hint", "text", "value"),
    (
        (int, "12", 12),
        (float, "1e-3", 1e-3),
        (bool, "off", False),
        (bool, "TRUE", True),
        (str, "12", "12"),
        (int | None, "none", None),
        (int | None, "3", 3),
        (str | None, "None", None),
        (Literal["fp16", "fp32"], "fp16", "fp16"),
    ),
)
def test_values_take_their_type(hint: Any, text: str, value: Any) -> None:
    typed = typed_value(hint, text, "--set a.b")
    assert typed == value
    assert type(typed) is type(value)


@pytest.mark.parametrize(
    ("hint", "text"), ((int, "x"), (bool, "2"), (int | None, ""), (Literal["a"], "b"))
)
def test_values_of_another_type_are_refused(hint: Any, text: str) -> None:
    with pytest.raises(BadInput):
        typed_value(hint, text, "--set a.b")


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
        return demand_of(spec, job, world, vast.device.vector_width)

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


def test_the_folder_belongs_to_one_run(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b"
    folder = RunFolder.create(path, {"seed": 1})
    assert list(path.iterdir()) == []
    folder.write_record({"arguments": {"seed": 1}, "figure": math.nan})
    assert json.loads((path / "run.json").read_text())["figure"] is None
    RunFolder.create(path, {"seed": 1})
    with pytest.raises(BadInput, match="already holds another run"):
        RunFolder.create(path, {"seed": 2})
    (path / "run.json").write_text("{")
    with pytest.raises(BadInput, match="already holds"):
        RunFolder.create(path, {"seed": 1})


def test_samples_are_on_the_disk_as_they_come(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", {})
    folder.start_samples((), ())
    folder.append_samples([("a,b", 1)])
    folder.append_samples([("c", 2)])
    assert (tmp_path / "run" / "samples.csv").read_text().splitlines()[1:] == ['"a,b",1', "c,2"]


def test_a_write_that_fails_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "table.csv"
    write_atomically(path, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(GibenchError, match="No space left on device") as refused:
        write_atomically(path, b"new")
    assert refused.value.exit_code == 1
    assert path.read_bytes() == b"old"
    assert [f.name for f in tmp_path.iterdir()] == ["table.csv"]


def test_default_folders_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    first = default_folder(["iphone7", "vega56"])
    assert first.name.endswith("-iphone7+vega56")
    first.mkdir(parents=True)
    assert default_folder(["iphone7", "vega56"]) != first
    assert default_folder(["vega56"], "quality").parent == Path("results", "quality")


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


def test_a_lightmap_is_unwrapped_once_and_again_when_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = build("cornell-box")
    first = cached_lightmap(scene, 300, tmp_path)
    (file,) = (tmp_path / "lightmaps").iterdir()

    import gibench.scene.lightmap.atlas as atlas

    calls = []
    unwrap = atlas.unwrap
    monkeypatch.setattr(atlas, "unwrap", lambda *a: calls.append(a) or unwrap(*a))
    again = cached_lightmap(scene, 300, tmp_path)
    assert not calls
    assert again.content_hash() == first.content_hash()
    assert again.requested == first.requested
    np.testing.assert_array_equal(again.receivers.area, first.receivers.area)

    file.write_bytes(file.read_bytes()[:-100])
    assert cached_lightmap(scene, 300, tmp_path).content_hash() == first.content_hash()
    assert len(calls) == 1
    cached_lightmap(replace(scene, lights=()), 300, tmp_path)
    assert len(calls) == 1  # lights have no part in it
    cached_lightmap(replace(scene, normals=-scene.normals), 300, tmp_path)
    assert len(calls) == 2  # other content, other file
