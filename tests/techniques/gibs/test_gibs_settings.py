"""What GIBS refuses, in one clear line; memory in closed form."""

from dataclasses import replace

import pytest
from support.gibs_scenes import ROOMY, Frames, furnished, gibs
from support.made import check_memory

from gibench.errors import BadInput, CannotRun
from gibench.profiles import load_profile
from gibench.techniques.gibs import SPEC, GibsSettings
from gibench.techniques.registry import PUBLISHED, TUNED, find_technique


def test_it_is_found_by_name():
    assert find_technique("gibs") is SPEC
    assert set(SPEC.variants) == {PUBLISHED, TUNED}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ray_budget", 0),
        ("surfels", 0),
        ("surfels", -5),
        ("radius_share", -0.1),
        ("radius_share", float("nan")),
        ("smallest_radius", 0.0),
        ("rays_per_surfel", 0.0),
        ("grid", "octree"),
        ("grid_cells", 1),
        ("grid_cells", 100_000),
        ("normal_stretch", 0.5),
        ("placement_chance", 1.5),
        ("recycle_chance", -0.1),
        ("recycle_pressure_from", 1.0),
        ("estimator", "median"),
    ],
)
def test_a_wrong_setting_is_refused_by_name(name, value):
    with pytest.raises(BadInput) as error:
        SPEC.settings({name: value})
    message = str(error.value)
    assert f"gibs.{name}" in message
    assert "\n" not in message


def test_more_surfels_than_the_budget_holds():
    profile = replace(load_profile("iphone7"), memory_budget_bytes=200_000_000)
    with pytest.raises(CannotRun, match="1,000,000 surfels") as error:
        gibs(furnished(), profile=profile, surfels=1_000_000)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("variant", [PUBLISHED, TUNED])
@pytest.mark.parametrize("grid", ["uniform", "perspective"])
@pytest.mark.parametrize("depth", [True, False])
@pytest.mark.parametrize(("size", "width"), [(16, 1), (64, 64), (96, 33)])
def test_memory_is_declared(variant, grid, depth, size, width):
    technique = gibs(
        furnished(),
        variant,
        size,
        width=width,
        surfels=777,
        grid=grid,
        depth_moments=depth,
        ray_guiding=not depth,
    )
    least, held = check_memory(SPEC, technique, technique.settings, variant, size, 0)
    # Of all it is only the tree that is not known before.
    allocated = technique.device.memory.allocated
    assert held - least < allocated["bvh_nodes"] + allocated["bvh_triangles"]


def test_work_is_declared_for_every_pass():
    technique = gibs(furnished(), placement_chance=1.0, **ROOMY)
    Frames(technique).run(5)
    passes = {item.name: item for item in technique.passes()}
    sorting = ["transform_and_count", "prefix_sum", "finalise"]
    light = ["irradiance", "camera", "application"]
    assert list(passes) == [*sorting, *light, "coverage", "placement", "recycling"]
    assert passes["irradiance"].work.rays == technique.life()["alive"] - technique.life()["placed"]
    assert passes["camera"].work.rays == 64 * 48
    assert all(item.work.bytes_read or item.work.bytes_written for item in passes.values())


def test_no_more_rays_than_the_budget():
    technique = gibs(furnished(), placement_chance=1.0, ray_budget=7, **ROOMY)
    Frames(technique).run(12)
    assert technique.life()["alive"] > 7
    assert {p.name: p for p in technique.passes()}["irradiance"].work.rays == 7
    first = technique.device.read(technique.surfels.ray_first)
    assert first[technique.life()["alive"] - technique.life()["placed"]] == 7


def test_defaults_are_the_values_of_ekberg_2022():
    settings = GibsSettings()
    assert settings.placement_chance == 0.08
    assert settings.placement_threshold == 1.0
    assert settings.rays_per_surfel == 1.0
