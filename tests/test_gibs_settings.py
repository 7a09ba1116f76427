"""What GIBS refuses, in one clear line; camera paths; memory in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from gibs_scenes import Frames, furnished, gibs

from gibench.errors import BadInput, CannotRun
from gibench.profiles import load_profile
from gibench.rays.embree import EmbreeTracer
from gibench.scene.load import load_scene
from gibench.scene.model import Camera
from gibench.techniques.gibs import SPEC, GibsSettings
from gibench.techniques.gibs.camera_path import CameraPath, built_in_flight, camera_in
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
        ("flight_frames", 0),
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


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("positions = [[0, 0, 0]]\ntargets = [[1, 0, 0]]", "1 point"),
        ("positions = [[0, 0, 0], [1, 1, 1]]\ntargets = [[1, 0, 0]]", "1 targets"),
        ("positions = [[0, 0], [1, 1]]\ntargets = [[1, 0], [1, 0]]", "point"),
        ("positions = [[0, 0, 0], [1, 1, 1]]", "without targets"),
        ("positions = 'left'\ntargets = 'right'", "not lists"),
        ("positions = [", "no camera path"),
        ("positions = [[0, 0, nan], [1, 1, 1]]\ntargets = [[1, 0, 0], [1, 0, 0]]", "not finite"),
    ],
)
def test_a_file_that_is_no_camera_path(tmp_path, text, what):
    path = tmp_path / "path.toml"
    path.write_text(text)
    with pytest.raises(BadInput, match=what) as error:
        gibs(furnished(), camera_path=str(path), surfels=100)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_camera_path_that_is_not_there():
    with pytest.raises(BadInput, match="no camera path"):
        gibs(furnished(), camera_path="nowhere.toml", surfels=100)


def test_a_camera_path_goes_through_its_keyframes_and_comes_back_to_rest():
    camera = Camera((9, 9, 9), (0, 0, 0), fov_degrees=33)
    keys = np.array([[0, 0, 0], [1, 2, 3], [4, 2, 1.0]])
    path = CameraPath(keys, keys + 1)
    seen = [camera_in(frame, camera, path, 10, 21) for frame in range(40)]
    assert all(one == camera for one in seen[:10] + seen[31:])
    for key, frame in zip(keys, (10, 20, 30), strict=True):
        np.testing.assert_allclose(seen[frame].position, key, atol=1e-12)
        np.testing.assert_allclose(seen[frame].target, key + 1, atol=1e-12)
        assert seen[frame].fov_degrees == 33
    between = np.array([one.position for one in seen[10:31]])
    assert np.all(between >= keys.min(0)) and np.all(between <= keys.max(0))


def test_the_built_in_flight_stays_inside():
    scene = furnished()
    path = built_in_flight(scene, scene.cameras[0])
    low, high = scene.bounds
    for share in np.linspace(0, 1, 100):
        camera = path.at(float(share), scene.cameras[0])
        assert np.all(np.array(camera.position) > low)
        assert np.all(np.array(camera.position) < high)
        assert np.linalg.norm(np.subtract(camera.target, camera.position)) > 0.1


def seen_from(tracer, camera, points, normals):
    """Which fronts (n, 3) a camera's square image shows, by rays from the camera."""
    position = np.array(camera.position)
    axis = np.subtract(camera.target, position)
    side = np.cross(axis, camera.up)
    frame = np.stack([side / np.linalg.norm(side), np.cross(side, axis), axis])
    frame /= np.linalg.norm(frame, axis=1, keepdims=True)
    way = points - position
    x, y, z = frame @ way.T
    edge = np.tan(np.radians(camera.fov_degrees) / 2) * z
    inside = (z > 0) & (np.abs(x) < edge) & (np.abs(y) < edge)
    return inside & in_sight(tracer, position, points, normals)


def in_sight(tracer, position, points, normals):
    """Which fronts (n, 3) nothing hides from ``position``."""
    origins = np.broadcast_to(position, points.shape).astype(np.float32)
    way = points - position
    distance = tracer.closest(origins, way.astype(np.float32)).distance
    return (distance > 0.999) & ((way * normals).sum(axis=1) < 0)


@pytest.mark.parametrize("name", ["cornell-box", "two-rooms"])
def test_the_built_in_flight_shows_what_the_camera_at_rest_does_not(name):
    scene = load_scene(name)
    rng = np.random.default_rng()
    corners = scene.corners.astype(np.float64)
    edges = corners[:, 1:] - corners[:, :1]
    across = np.cross(edges[:, 0], edges[:, 1])
    area = np.linalg.norm(across, axis=1)
    weights = rng.dirichlet((1, 1, 1), 3000)
    triangle = rng.choice(len(area), 3000, p=area / area.sum())
    points, normals = np.einsum("nc,ncx->nx", weights, corners[triangle]), across[triangle]
    # Not what nobody sees.
    tracer = EmbreeTracer(scene.corners)
    anywhere = rng.uniform(*scene.bounds, (200, 3))
    seeable = np.any([in_sight(tracer, one, points, normals) for one in anywhere], axis=0)
    points, normals = points[seeable], normals[seeable]
    rest = scene.cameras[0]
    path = built_in_flight(scene, rest)
    at_rest = seen_from(tracer, rest, points, normals)
    shares = np.linspace(0, 1, len(path.positions))
    seen = at_rest.copy()
    for share in shares:
        seen |= seen_from(tracer, path.at(float(share), rest), points, normals)
    assert at_rest.mean() < 0.85
    assert seen.mean() > 0.98


@pytest.mark.parametrize("variant", [PUBLISHED, TUNED])
@pytest.mark.parametrize("grid", ["uniform", "perspective"])
@pytest.mark.parametrize("depth", [True, False])
def test_memory_is_known_in_closed_form(variant, grid, depth):
    technique = gibs(
        furnished(), variant, surfels=777, grid=grid, depth_moments=depth, ray_guiding=not depth
    )
    assert technique.nbytes == technique.device.memory.total_bytes
    floor = SPEC.memory_floor(technique.scene.scene, 0, technique.settings, 64, 48)
    assert 0.2 * technique.nbytes < floor <= technique.nbytes


def test_work_is_declared_for_every_pass():
    technique = gibs(furnished(), surfels=500, placement_chance=1.0)
    Frames(technique).run(5)
    passes = {item.name: item for item in technique.passes()}
    sorting = ["transform_and_count", "prefix_sum", "finalise"]
    light = ["irradiance", "gbuffer", "application"]
    assert list(passes) == [*sorting, *light, "coverage", "placement", "recycling"]
    assert passes["irradiance"].work.rays == technique.life()["alive"] - technique.life()["placed"]
    assert passes["gbuffer"].work.rays == 64 * 48
    assert all(item.work.bytes_read or item.work.bytes_written for item in passes.values())


def test_no_more_rays_than_the_budget():
    technique = gibs(furnished(), surfels=500, placement_chance=1.0, ray_budget=7)
    Frames(technique).run(12)
    assert technique.life()["alive"] > 7
    assert {p.name: p for p in technique.passes()}["irradiance"].work.rays == 7
    first = technique.device.read(technique.surfels.ray_first)
    assert first[technique.life()["alive"] - technique.life()["placed"]] == 7


def test_defaults_are_the_thesis_values():
    settings = GibsSettings()
    assert settings.placement_chance == 0.08
    assert settings.placement_threshold == 1.0
    assert settings.rays_per_surfel == 1.0
