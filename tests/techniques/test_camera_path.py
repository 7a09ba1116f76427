"""The camera's flight: its keyframes, its file, and that every technique sees the same one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.ddgi_oracle import create as ddgi
from support.gibs_scenes import furnished, gibs
from support.made import made
from support.scaled import scaled
from support.shading_oracle import open_device
from support.synthetic_bake import random_lightmap
from support.tiny_scenes import box, quad_scene

from gibench.errors import BadInput
from gibench.measure.compare.timings import _flight
from gibench.rays.embree import EmbreeTracer
from gibench.scene.load import load_scene
from gibench.scene.model import Camera
from gibench.techniques.camera_path import CameraPath, Flight, FlightOptions, built_in_flight
from gibench.techniques.direct import SPEC as DIRECT
from gibench.techniques.parts.camera_table import camera_table
from gibench.techniques.parts.reach import light_in_reach

TWO = "positions = [[0, 1, 0], [1, 1, 0.5]]\ntargets = [[1, 1, 0], [1.5, 1, 0]]"


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
        (
            "positions = [[0, 0, 0], [1, 1, 1]]\ntargets = [[0, 0, 0], [2, 1, 1]]",
            "looks at where it is",
        ),
    ],
)
def test_a_file_that_is_no_camera_path(tmp_path, text, what):
    path = tmp_path / "path.toml"
    path.write_text(text)
    scene = furnished()
    with pytest.raises(BadInput, match=what) as error:
        FlightOptions(str(path)).of(scene, scene.cameras[0])
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_camera_path_that_is_not_there():
    scene = furnished()
    with pytest.raises(BadInput, match="no camera path"):
        FlightOptions("nowhere.toml").of(scene, scene.cameras[0])


@pytest.mark.parametrize("numbers", [{"rest_frames": -1}, {"flight_frames": 0}])
def test_numbers_of_frames_that_make_no_sense(numbers):
    with pytest.raises(BadInput, match="a flight of"):
        FlightOptions(**numbers)


def test_a_camera_path_goes_through_its_keyframes_and_comes_back_to_rest():
    camera = Camera((9, 9, 9), (0, 0, 0), fov_degrees=33)
    keys = np.array([[0, 0, 0], [1, 2, 3], [4, 2, 1.0]])
    flight = Flight(CameraPath(keys, keys + 1), 10, 21)
    seen = [flight.camera_in(frame, camera) for frame in range(40)]
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


@pytest.mark.parametrize("factor", [1e-3, 2500.0])
def test_the_path_around_sees_all_sides_from_outside(factor):
    """Of a block, whatever its size; and is back where it began."""
    block, _ = quad_scene(box((-1, 0, -1.1), (1, 2.4, 1.1), inward=False), 2, sky=(1.0, 1.0, 1.0))
    block = scaled(block, factor)
    start = Camera((0.0, 1.2 * factor, 8.0 * factor), (0.0, 1.2 * factor, 0.0), 50.0)
    flight = FlightOptions("around", 10, 60).of(block, start)
    low, high = block.bounds
    seen = [flight.camera_in(frame, start) for frame in range(80)]
    assert seen[9] == start == seen[70]
    for camera in seen:
        at = np.array(camera.position)
        assert ((at < low) | (at > high)).any()
        assert np.linalg.norm(at - (low + high) / 2) < 20 * factor
    front, side, top = 2 * 2.4, 2.2 * 2.4, 2 * 2.2
    # All but the bottom, which lies on the ground.
    expected = (front + side + top / 2) / (front + side + top)
    assert light_in_reach(block, seen, 1.5, hops=False) == pytest.approx(expected, abs=0.01)


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
def test_the_built_in_flight_shows_what_the_camera_at_rest_does_not(rng, name):
    scene = load_scene(name)
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


def direct(scene, flight):
    """Direct light on a device of its own."""
    lightmap = random_lightmap(np.random.default_rng(1), scene, 5, 4, 4)
    return made(DIRECT, open_device(), scene, lightmap, DIRECT.settings({}), None, "tuned",
                64, 24, 16, scene.cameras[0], 0, flight)  # fmt: skip


@pytest.mark.parametrize("which", ["flight", "file"])
def test_every_technique_sees_the_same_flight(tmp_path, which):
    (tmp_path / "path.toml").write_text(TWO)
    path = "flight" if which == "flight" else str(tmp_path / "path.toml")
    scene, options = furnished(), FlightOptions(path, 3, 7)
    flight = options.of(scene, scene.cameras[0])
    assert flight is not None
    techniques = [
        direct(scene, flight),
        ddgi(scene, {"counts": "2x2x2"}, flight=flight),
        gibs(scene, camera_path=path, rest_frames=3, flight_frames=7, surfels=50, width=24,
             height=16),
    ]  # fmt: skip
    for frame in range(options.frames + 2):
        expected = camera_table(flight.camera_in(frame, scene.cameras[0]), 24, 16)
        for technique in techniques:
            technique.begin_frame(frame)
            seen = technique.device.read(technique.scene.camera_args[0].value)
            np.testing.assert_array_equal(seen, expected)
        moves = not np.array_equal(expected, camera_table(scene.cameras[0], 24, 16))
        # The built-in flight begins and ends where the camera rests; the file's does not.
        assert moves == (3 < frame < 9 if which == "flight" else 3 <= frame <= 9)


def test_a_scrolling_volume_follows_the_flight():
    scene = furnished()
    flight = FlightOptions("flight", 0, 9).of(scene, scene.cameras[0])
    settings = {"counts": "3x3x3", "origin": "-0.5,0.5,-0.5", "spacing": "0.5,0.5,0.5",
                "scrolling": True}  # fmt: skip
    technique = ddgi(scene, settings, flight=flight)
    for frame in (0, 4):
        technique.begin_frame(frame)
        middle = technique.probes.volume.positions.mean(axis=0)
        off = middle - flight.camera_in(frame, scene.cameras[0]).position
        assert np.all(np.abs(off) <= 0.25 + 1e-9)


def test_runs_with_different_flights_are_not_compared():
    flown = {"flight": {"path": "flight", "rest_frames": 3, "flight_frames": 7}}
    rested = {"flight": {"path": "rest", "rest_frames": 60, "flight_frames": 240}}
    assert _flight({}) is _flight(rested) is None
    assert _flight(flown) == flown["flight"]


def test_it_is_one_option_for_all_techniques(tmp_path, capsys):
    from gibench.cli.main import call

    path = Path(tmp_path / "one.toml")
    path.write_text("positions = [[0, 0, 0]]\ntargets = [[1, 0, 0]]")
    command = ["run", "--technique", "direct", "--camera-path", str(path)]
    assert call([*command, "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "a camera path with 1 point(s)" in told
    assert "give at least two positions" in told and not (tmp_path / "out").exists()


def test_a_path_s_file_is_in_the_space_of_a_far_scene_s_file(tmp_path: Path) -> None:
    path = tmp_path / "path.toml"
    path.write_text(
        "positions = [[1e6, 1, 2], [1000001, 1, 2]]\ntargets = [[1e6, 1, 0], [1e6, 2, 0]]\n"
    )
    scene = replace(load_scene("cornell-box"), origin=(1e6, 0.0, 0.0))
    flight = FlightOptions(str(path)).of(scene, scene.cameras[0])
    assert flight is not None
    assert flight.path.positions.tolist() == [[0, 1, 2], [1, 1, 2]]
    assert flight.path.targets.tolist() == [[0, 1, 0], [0, 2, 0]]
