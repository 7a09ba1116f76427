"""Techniques on scenes that move: their passes, their images, and what cannot follow."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support.ddgi_oracle import create as ddgi
from support.gibs_scenes import FEW, Frames, gibs
from support.made import check_memory
from support.made import made as create
from support.moving_scenes import (
    LEFT,
    RIGHT,
    UNDER_THE_LAMP,
    furnished_room,
    jump,
    scene_in,
    shaded_room,
)
from support.shading_oracle import open_device, render
from support.synthetic_bake import random_lightmap
from support.vector_widths import widths

from gibench.bake.lightmap import cached_lightmap
from gibench.cli.main import call
from gibench.commands.quality import quality
from gibench.device import Device
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.reference.path_tracer import reference_irradiance
from gibench.scene.load import load_scene
from gibench.scene.motion.file import load_motions
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import Keyframes, Turn
from gibench.techniques.direct import SPEC as DIRECT
from gibench.techniques.gibs.settings import PERSPECTIVE
from gibench.techniques.parts.conformance.synthetic import random_motion
from gibench.techniques.parts.frame_passes import frame_passes
from gibench.techniques.registry import (
    PUBLISHED,
    TUNED,
    BakeContext,
    Follows,
    find_technique,
    techniques,
)

HELD = {
    "moving_vertices", "moving_vertex_objects", "rest_positions", "rest_normals",
    "moving_triangle_slots", "moving_node_slots",
}  # fmt: skip
MOVES = ["move_vertices", "refit_leaves", "refit_nodes"]


def direct(scene, motion=None, variant=TUNED, size=64, image=(48, 32)):
    """Direct light on a device of its own."""
    lightmap = random_lightmap(np.random.default_rng(1), scene, 5, 4, 4)
    return create(DIRECT, open_device(), scene, lightmap, DIRECT.settings({}), None, variant,
                  size, *image, scene.cameras[0], motion=motion)  # fmt: skip


# Small enough to be set up twice, where a technique has them.
SMALL = {
    **FEW, "counts": "2x2x2", "links": 8, "caches": 60, "relaxation": 1, "capture_texels": 6,
    "map_texels": 6,
}  # fmt: skip

FOLLOWING = [n for n, spec in techniques().items() if Follows.DIRECT_LIGHT in spec.follows]


def small(name):
    """Its settings."""
    spec = find_technique(name)
    return spec.settings({k: v for k, v in SMALL.items() if hasattr(spec.settings_type, k)})


def made(name, scene, motion, cache):
    """A technique on a device of its own."""
    spec, settings = find_technique(name), small(name)
    lightmap = random_lightmap(np.random.default_rng(1), scene, 5, 4, 4)
    baked = spec.bake(BakeContext(scene, lightmap, settings, cache))
    return create(spec, open_device(), scene, lightmap, settings, baked, TUNED,
                  64, 24, 16, scene.cameras[0], motion=motion)  # fmt: skip


def test_some_techniques_follow():
    assert {"direct", "ddgi", "gibs", "srp"} <= set(FOLLOWING)


# SRP has passes of its own for what moves (srp/test_srp_movers.py).
@pytest.mark.parametrize("name", [n for n in FOLLOWING if n != "srp"])
def test_a_technique_that_follows_gains_the_passes_first_and_nothing_else(name, tmp_path):
    scene = furnished_room()
    motion = MovingObjects.of(scene, [Turn(LEFT, (0, 1, 0))])
    resting, moving = made(name, scene, None, tmp_path), made(name, scene, motion, tmp_path)
    own = [item.name for item in resting.passes()]
    assert [item.name for item in frame_passes(resting)] == own
    assert [item.name for item in moving.passes()] == own
    assert [item.name for item in frame_passes(moving)] == MOVES + own
    assert [item.name for item in prepare_passes(moving, 64)] == MOVES + own
    added = set(moving.device.memory.allocated) - set(resting.device.memory.allocated)
    assert added - {"object_transforms"} == HELD
    check_memory(find_technique(name), moving, small(name), TUNED, 64, 5, motion)
    tables = [name for name in moving.device.memory.allocated if "transforms" in name]
    assert tables == ["object_transforms"]  # surfels use the same one


@pytest.mark.parametrize("variant", [PUBLISHED, TUNED])
@pytest.mark.parametrize("width", widths(8, 16))
@pytest.mark.parametrize("size", [16, 100])
def test_direct_light_is_that_of_the_scene_as_it_lies(rng, monkeypatch, variant, width, size):
    """Shadows, shading normals and all: as the same kernels have it where the moved triangles rest,
    and by float64 and Embree.

    Boxes stay 0.6 m away from the lamp: as kernels shade points a little off the surface
    (sampling.cl), they err more the nearer it is, by at most 6e-5 m / 0.6 m of its 8 W/m2, times
    albedo / pi.
    """
    monkeypatch.setattr(Device, "vector_width", property(lambda self: width))
    scene = furnished_room()
    motion = MovingObjects.of(
        scene,
        [
            random_motion(n, rng, low=(-0.5, -0.6, -0.5), high=(0.5, -0.1, 0.5))
            for n in (LEFT, RIGHT)
        ],
    )
    technique = direct(scene, motion, variant, size)
    prepared = prepare_passes(technique, size)
    pictures = []
    for frame in (1, 3, 0):
        enqueue_frame(technique, prepared, frame)
        image = technique.device.read(technique.scene.image)
        moved = scene_in(scene, motion, frame)
        expected = render(moved, frame, 48, 32)
        sure = expected.certain
        assert sure.mean() > 0.8
        np.testing.assert_allclose(image[sure], expected.direct[sure], rtol=5e-4, atol=2e-4)
        positions, normals = (
            technique.device.read(b)
            for b in (technique.scene.surfaces.positions, technique.scene.surfaces.normals)
        )
        resting = direct(replace(moved, positions=positions, normals=normals), None, variant, size)
        enqueue_frame(resting, prepare_passes(resting, size), frame)
        there = resting.device.read(resting.scene.image)
        np.testing.assert_allclose(image[sure], there[sure], rtol=1e-6, atol=1e-7)
        pictures.append(image)
    assert np.mean(np.abs(pictures[0] - pictures[1]) > 1e-3) > 0.02


def moves_about(rng):
    """A box that goes up and turns, slowly, and another that goes round and round."""
    scene = furnished_room()
    up = Keyframes(
        LEFT, (10, 60), ((0.0, 0.0, 0.0), (0.8, 0.5, 0.9)),
        (((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
         ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))),
    )  # fmt: skip
    axis = tuple(rng.normal(size=3).tolist())
    return scene, MovingObjects.of(scene, [up, Turn(RIGHT, axis, period_frames=37)])


BOXES = {1: ((-1.2, 0.001, -0.8), (-0.6, 1.1, -0.2)), 2: ((0.3, 0.001, 0.1), (1.0, 0.5, 0.8))}


def off_box(points, low, high):
    """How far points (n, 3) are from a box's surface, m."""
    low, high = np.array(low), np.array(high)
    outside = np.maximum(np.maximum(low - points, points - high), 0.0)
    inside = np.minimum(points - low, high - points).min(axis=1)
    return np.where(inside > 0, inside, np.linalg.norm(outside, axis=1))


@pytest.mark.parametrize(("variant", "grid"), [(PUBLISHED, PERSPECTIVE), (TUNED, "uniform")])
def test_surfels_stay_on_the_surface_of_what_moves(rng, variant, grid):
    """To 5 micrometres in a room of 4 m, ten roundings of float32, whenever they were placed."""
    scene, motion = moves_about(rng)
    capacity = 900
    technique = gibs(
        scene, variant, motion=motion, surfels=capacity, grid=grid, placement_chance=1.0,
        radius_share=0.06, grid_cells=12, recycle_chance=0.3,
    )  # fmt: skip
    frames, s = Frames(technique), technique.surfels
    g, read = s.geometry, technique.device.read
    known, checked = np.zeros(capacity, bool), 0
    for frame in range(70):
        # World positions are those of the surfels alive as the frame begins.
        ids = read(g.alive_ids)[: technique.life()["alive"]].copy()
        owners = read(g.object_ids)[ids].copy()
        frames.run()
        life = technique.life()
        alive, free = read(g.alive_ids)[: life["alive"]], read(s.free_ids)[: life["free"]]
        assert len(alive) + len(free) == capacity
        assert np.array_equal(np.sort(np.concatenate([alive, free])), np.arange(capacity))
        world, normal = read(g.world_position)[:, ids].T, read(g.world_normal)[:, ids].T
        transforms = motion.transforms_in(frame)
        for number, (low, high) in BOXES.items():
            mine = owners == number + 1
            m = transforms[number]
            at_rest = (world[mine] - m[:, 3]) @ m[:, :3]
            assert np.all(off_box(at_rest, low, high) < 5e-6)
            facing = normal[mine] @ m[:, :3]
            middle = (np.array(low) + high) / 2
            assert np.all(np.abs(np.abs(facing).max(axis=1) - 1) < 1e-6)  # a side's normal
            assert np.all(((at_rest - middle) * facing).sum(axis=1) > 0)  # outwards
            checked += np.count_nonzero(mine)
            known[ids[mine]] = True
    assert checked > 3000 and known.sum() > 60


def test_surfels_rest_as_they_did_where_nothing_moves():
    """The same bit for bit whether the table of transforms is written every frame or never."""
    scene = furnished_room()
    still = MovingObjects.of(scene, [jump(LEFT, (1, 1, 1), 10_000)])
    states = []
    for motion in (None, still):
        technique = gibs(scene, motion=motion, placement_chance=0.5, **FEW)
        Frames(technique).run(12)
        s = technique.surfels
        buffers = (s.estimator, s.geometry.local_position, s.geometry.world_position)
        states.append([technique.device.read(b) for b in (*buffers, technique.scene.image)])
    for one, other in zip(*states, strict=True):
        np.testing.assert_array_equal(one, other)


def settled(technique, first, frames, size=64):
    """Direct light of the last of ``frames`` frames from ``first`` on, and the mean indirect light
    of their last quarter.
    """
    prepared = prepare_passes(technique, size)
    whole = []
    for frame in range(first, first + frames):
        enqueue_frame(technique, prepared, frame)
        if frame >= first + frames * 3 // 4:
            whole.append(technique.device.read(technique.scene.image))
    direct_light = technique.images()["direct only"]
    return direct_light, np.mean(whole, axis=0) - direct_light


RESPONSES = {
    "ddgi": (
        lambda scene, motion=None: ddgi(
            scene, {"counts": "5x5x5", "rays": 64, "fixed_rays": 16, "hysteresis": 0.9},
            motion=motion,
        ),
        48,
        192,
    ),
    "gibs": (
        lambda scene, motion=None: gibs(
            scene, motion=motion, surfels=1500, width=24, height=16, placement_chance=1.0,
            radius_share=0.15, grid_cells=6, rays_per_surfel=8.0,
        ),
        160,
        320,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", RESPONSES)
def test_light_follows_a_plate_that_moves_under_the_lamp(name):
    """Direct light at once, indirect light after a while as if the plate had always been there."""

    def apart(one, other):
        return float(np.sqrt(np.mean((one - other) ** 2)))

    create, resting, frames = RESPONSES[name]
    scene = shaded_room()
    motion = MovingObjects.of(scene, [jump("plate", UNDER_THE_LAMP, resting)])
    technique = create(scene, motion)
    lit = settled(technique, 0, resting)
    shaded = settled(technique, resting, frames)
    expected = settled(create(scene_in(scene, motion, resting)), 0, frames)
    np.testing.assert_allclose(shaded[0], expected[0], rtol=1e-3, atol=1e-4 * lit[0].max())
    assert shaded[0].mean() < 0.7 * lit[0].mean()
    assert shaded[1].mean() < 0.8 * lit[1].mean()
    assert shaded[1].mean() == pytest.approx(expected[1].mean(), rel=0.05)
    assert apart(shaded[1], expected[1]) < 0.2 * apart(lit[1], expected[1])


# -- the command ----------------------------------------------------------------------------------

TURN = '[[motion]]\nobject = "tall box"\naxis = [0, 1, 0]\nperiod_frames = 20\n'


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "motion.toml"
    path.write_text(TURN)
    return str(path)


def run(tmp_path, *arguments):
    """``gibench run`` on next to nothing; its exit code and folder."""
    out = tmp_path / "run"
    command = [
        "run",
        "--no-quality",
        "--scene",
        "cornell-box",
        "--receivers",
        "200",
        "--resolution",
        "32x16",
    ]
    command += ["--frames", "3", "--warmup", "1", "-q", "--cache-dir", str(tmp_path / "cache")]
    return call([*command, "--out", str(out), *arguments]), out


def test_a_run_whose_objects_move(tmp_path, file, capsys):
    asked = ["-t", "direct", "-t", "srp", "--sh-order", "1", "--probes", "4", "--motion", file]
    asked += ["--set", "srp.transport_rays=16", "--set", "srp.relight_samples=64"]
    code, out = run(tmp_path, *asked)
    assert code == 0
    samples = pd.read_csv(out / "samples.csv")
    assert set(samples["technique"]) == {"direct", "srp"}
    assert list(dict.fromkeys(samples["pass"]))[:4] == [*MOVES, "camera"]
    assert "blocked_rays" in set(samples["pass"])
    record = json.loads((out / "run.json").read_text())
    assert record["motion"]["path"] == record["arguments"]["motion"] == "motion.toml"
    assert len(record["motion"]["motions_hash"]) == 64
    moved, probed = record["configurations"]
    assert "1 of 7 objects move, with 10 triangles" in moved["notes"][0]
    assert "never built anew" in moved["notes"][0]
    assert any("it is baked without the objects that move" in note for note in probed["notes"])
    report = (out / "report.md").read_text()
    assert "Objects moved as 'motion.toml' says" in report and "| move_vertices |" in report
    passes = pd.read_csv(out / "passes.csv")
    passes = passes[passes["technique"] == "direct"].set_index("pass")
    assert passes.loc["move_vertices", "flops"] == 33 * 20
    assert passes.loc[MOVES, "bytes"].gt(0).all()


def test_a_run_at_rest_has_the_passes_it_had(tmp_path):
    code, out = run(tmp_path, "-t", "direct")
    assert code == 0
    samples = pd.read_csv(out / "samples.csv")
    assert not set(samples["pass"]) & set(MOVES)
    record = json.loads((out / "run.json").read_text())
    assert record["motion"] == {"path": "rest", "motions_hash": None}
    report = (out / "report.md").read_text()
    assert not any(word in report for word in (*MOVES, "Objects moved"))


def test_what_does_not_follow_says_so(tmp_path, file, capsys, monkeypatch):
    spec = replace(find_technique("direct"), follows=frozenset())
    monkeypatch.setattr("gibench.measure.session.session.find_technique", lambda name: spec)
    code, _ = run(tmp_path, "-t", "direct", "--motion", file)
    assert code == 3
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "direct cannot follow objects that move: what it bakes holds for the scene" in told
    assert "run it without --motion, or ddgi, " in told


@pytest.mark.slow
def test_truth_in_a_frame_of_a_motion(tmp_path):
    """The light of a frame is that of a scene that lies so and has these colours."""
    path = tmp_path / "motion.toml"
    path.write_text(
        '[[motion]]\nobject = "tall box"\nframes = [0, 8]\n'
        "positions = [[0, 0, 0], [-0.1, 0.4, 0.1]]\n"
        '[[motion]]\nobject = "short box"\nframes = [0, 8]\nemission = [0, 4]\nstep = true\n'
    )
    cache = tmp_path / "cache"
    result = quality(
        scene="cornell-box", technique="direct", receivers=150, resolution="32x18",
        motion=str(path), light_frame=8, frames=16, target_error=0.4, out=tmp_path / "quality",
        cache_dir=cache,
    )  # fmt: skip
    assert result.error is None and set(result.table["light_frame"]) == {8}
    record = json.loads((tmp_path / "quality" / "run.json").read_text())
    assert record["arguments"]["motion"] == record["motion"]["path"] == "motion.toml"
    scene = load_scene("cornell-box")
    motion = MovingObjects.of(scene, load_motions(path))
    lightmap = cached_lightmap(scene, 150, cache)
    there = motion.scene_in(scene, 8)
    moved = motion.lightmap_in(scene, lightmap, 8)
    found = result.receivers
    np.testing.assert_array_equal(found[["x", "y", "z"]], moved.receivers.position)
    lifted = motion.receivers(lightmap)
    assert 5 < lifted.sum() < len(lifted) / 2
    shift = moved.receivers.position - lightmap.receivers.position
    np.testing.assert_allclose(shift[lifted], [[-0.1, 0.4, 0.1]] * lifted.sum(), atol=1e-5)
    assert not shift[~lifted].any()
    expected = reference_irradiance(there, moved, frame=8, target_error=0.4, seed=1)
    np.testing.assert_allclose(found["reference g"], expected.value[:, 1], rtol=1e-6)
    # Nothing glows in frame 7.
    before = motion.scene_in(scene, 7)
    dark = reference_irradiance(before, moved, frame=8, target_error=0.4, seed=1)
    assert expected.value.mean() > 1.2 * dark.value.mean()


def test_a_scene_that_describes_no_motion(tmp_path, capsys):
    code, out = run(tmp_path, "-t", "direct", "--motion", "scene")
    assert code == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "scene 'cornell-box' describes no motion" in told
    assert "hall, atrium or hall-door" in told and not out.exists()
