"""Motions of objects: their poses, their tables in TOML, the objects they name, and the command."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from support.moving_scenes import LEFT, crowd, furnished_room

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.measure.compare.timings import _motion
from gibench.scene.builtin import moving_names, names
from gibench.scene.load import load_scene
from gibench.scene.motion.file import load_motions
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import IDENTITY, Keyframes, Turn
from gibench.techniques.object_motion import MotionOptions
from gibench.techniques.parts.conformance.synthetic import random_motion

ORIGIN = (0.0, 0.0, 0.0)


# -- poses ----------------------------------------------------------------------------------------


def test_a_turn_goes_round_once_a_period(rng):
    axis, through = rng.normal(size=3), rng.normal(size=3)
    turn = Turn("box", tuple(axis), tuple(through), period_frames=7)
    for frame in (0, 3, 12, 7_000_000_003):
        rotation, shift = turn.pose(frame)
        angle = 2 * np.pi * (frame % 7) / 7
        expected = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        np.testing.assert_allclose(rotation, expected, atol=1e-12)
        assert not shift.any()
    np.testing.assert_allclose(turn.pose(1)[0] @ axis, axis, atol=1e-12)
    np.testing.assert_array_equal(turn.pose(14)[0], np.eye(3))


def test_a_swing_goes_to_each_side_and_back():
    swing = Turn("lamp", (0.0, 0.0, 2.0), period_frames=8, swing_degrees=30.0)
    angles = [np.degrees(np.arctan2(m[1, 0], m[0, 0])) for m, _ in map(swing.pose, range(9))]
    half = 30 * np.sqrt(0.5)
    expected = [0, half, 30, half, 0, -half, -30, -half, 0]
    np.testing.assert_allclose(angles, expected, atol=1e-12)


def test_keyframes_are_met_and_never_overshot(rng):
    motion = random_motion("box", rng, frames=5)
    motion = Keyframes("box", (3, 10, 11, 30, 50), motion.positions, motion.rotations)
    for frame, position, rotation in zip(
        motion.frames, motion.positions, motion.rotations, strict=True
    ):
        turn, shift = motion.pose(frame)
        np.testing.assert_allclose(turn, rotation, atol=1e-12)
        np.testing.assert_allclose(shift, position, atol=1e-12)
    shifts = np.array([motion.pose(frame)[1] for frame in range(3, 51)])
    keys = np.array(motion.positions)
    assert np.all(shifts >= keys.min(0) - 1e-12) and np.all(shifts <= keys.max(0) + 1e-12)
    slerp = Slerp(motion.frames, Rotation.from_matrix(np.array(motion.rotations)))
    for frame in range(3, 51):
        expected = slerp(frame).as_matrix()
        np.testing.assert_allclose(motion.pose(frame)[0], expected, atol=1e-12)
    for early, late in ((0, 3), (50, 1234)):
        for one, other in zip(motion.pose(early), motion.pose(late), strict=True):
            np.testing.assert_array_equal(one, other)


def test_keyframes_turn_the_shorter_way_at_an_even_pace():
    quarter = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
    motion = Keyframes("box", (0, 90), (ORIGIN, ORIGIN), (IDENTITY, quarter))
    for frame in (0, 17, 90):
        rotation = motion.pose(frame)[0]
        expected = Rotation.from_euler("y", frame, degrees=True).as_matrix()
        np.testing.assert_allclose(rotation, expected, atol=1e-12)


def test_keyframes_repeat_from_the_first():
    motion = Keyframes("box", (5, 15), (ORIGIN, (1.0, 2.0, 3.0)), (IDENTITY,) * 2, repeat=True)
    for frame in range(6, 15):
        for later in (10, 1000):
            np.testing.assert_array_equal(motion.pose(frame)[1], motion.pose(frame + later)[1])
    assert not motion.pose(0)[1].any()


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: Turn("a", ORIGIN), "axis of 'a' is 0, 0, 0"),
        (lambda: Turn("a", (0, 1, 0), period_frames=0), "a period of 0 frames"),
        (lambda: Turn("a", (0, float("inf"), 0)), "not finite"),
        (lambda: Keyframes("a", (0,), (ORIGIN,), (IDENTITY,)), r"has 1 keyframe\(s\)"),
        (lambda: Keyframes("a", (4, 4), (ORIGIN,) * 2, (IDENTITY,) * 2), "are at 4, 4"),
        (lambda: Keyframes("a", (-1, 4), (ORIGIN,) * 2, (IDENTITY,) * 2), "are at -1, 4"),
        (lambda: Keyframes("a", (0, 4), (ORIGIN,) * 3, (IDENTITY,) * 2), "2 frames and 3 pos"),
        (lambda: Keyframes("a", (0, 4), (ORIGIN,) * 2, (IDENTITY,)), "2 frames and 1 rotations"),
        (
            lambda: Keyframes("a", (0, 4), (ORIGIN, (0, float("nan"), 0)), (IDENTITY,) * 2),
            "not finite",
        ),
        (
            lambda: Keyframes("a", (0, 4), (ORIGIN,) * 2, (IDENTITY, ((2, 0, 0), *IDENTITY[1:]))),
            "keyframe 2 of 'a' is not rigid",
        ),
        (
            lambda: Keyframes("a", (0, 4), (ORIGIN,) * 2, (IDENTITY, ((-1, 0, 0), *IDENTITY[1:]))),
            "keyframe 2 of 'a' is not rigid",
        ),
    ],
)
def test_a_motion_that_makes_no_sense(make, what):
    with pytest.raises(BadInput, match=what) as error:
        make()
    assert "\n" not in str(error.value)


# -- objects --------------------------------------------------------------------------------------


def test_objects_turn_about_their_middle_or_where_they_are_told():
    scene = furnished_room()
    middle = np.array([-0.9, 0.5505, -0.5])
    for through in (None, (1.0, 2.0, 3.0)):
        motion = MovingObjects.of(scene, [Turn(LEFT, (0, 1, 0), through, 4)])
        transforms = motion.transforms_in(1)
        fixed = middle if through is None else np.array(through)
        np.testing.assert_allclose(transforms[1, :, :3] @ fixed + transforms[1, :, 3], fixed)
        np.testing.assert_allclose(transforms[1, :, :3] @ (1, 0, 0), (0, 0, -1), atol=1e-12)
        np.testing.assert_array_equal(transforms[[0, 2]], np.tile(np.eye(3, 4), (2, 1, 1)))
        assert motion.triangles.sum() == 12
        assert np.array_equal(motion.triangles, scene.object_numbers() == 1)


def test_all_objects_of_a_name_move_as_one(rng):
    scene = crowd(rng, (5, 6, 7), ("a", "b", "a"))
    motion = MovingObjects.of(scene, [Turn("a", (0, 1, 0))])
    assert motion.triangles.sum() == 12
    assert motion.numbers[0].tolist() == [0, 2]
    transforms = motion.transforms_in(60)
    np.testing.assert_array_equal(transforms[0], transforms[2])
    assert "2 of 4 objects move, with 12 triangles" in motion.note()


def test_an_object_that_is_not_there_is_told_beside_those_that_are():
    scene = furnished_room()
    with pytest.raises(BadInput, match="no object called 'left bx'") as error:
        MovingObjects.of(scene, [Turn("left bx", (0, 1, 0))])
    assert "it has left box" in str(error.value)
    with pytest.raises(BadInput, match="'left box' has two motions"):
        MovingObjects.of(scene, [Turn(LEFT, (0, 1, 0)), Turn(LEFT, (1, 0, 0))])


def test_an_object_that_shares_vertices_cannot_move():
    scene = furnished_room()
    scene.triangles[0, 0] = scene.triangles[-1, 0]
    with pytest.raises(BadInput, match="'right box' shares 1 vertices with another one"):
        MovingObjects.of(scene, [Turn("right box", (0, 1, 0))])
    MovingObjects.of(scene, [Turn(LEFT, (0, 1, 0))])


def test_built_in_scenes_rest_unless_told_otherwise():
    """They describe motions; nothing that is baked or published depends on these."""
    assert moving_names() == ["hall", "atrium", "hall-door"]
    for name in names():
        scene = load_scene(name)
        assert MotionOptions().of(scene) is None
        if scene.motions:
            motion = MotionOptions("scene").of(scene)
            assert 0 < motion.triangles.sum() < len(scene.triangles) / 2
            np.testing.assert_array_equal(
                motion.transforms_in(0), np.tile(np.eye(3, 4), (motion.objects, 1, 1))
            )
        else:
            with pytest.raises(BadInput, match=f"'{name}' describes no motion") as error:
                MotionOptions("scene").of(scene)
            assert "hall, atrium or hall-door" in str(error.value)


# -- files ----------------------------------------------------------------------------------------

GOOD = """
[[motion]]
object = "short box"
axis = [0, 1, 0]
period_frames = 60
swing_degrees = 10

[[motion]]
object = "tall box"
frames = [0, 30]
positions = [[0, 0, 0], [0, 0.5, 0]]
rotate_degrees = [[0, 0, 0], [0, 90, 0]]
through = [1, 2, 3]
repeat = true

[[motion]]
object = "left"
frames = [0, 30]
matrices = [
  [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
  [[0, 0, 1, 5], [0, 1, 0, 6], [-1, 0, 0, 7], [0, 0, 0, 1]],
]
"""


def test_a_file_says_what_it_means(tmp_path):
    path = tmp_path / "motion.toml"
    path.write_text(GOOD)
    quarter = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
    swing, lift, drive = load_motions(path)
    assert swing == Turn("short box", (0.0, 1.0, 0.0), None, 60, 10.0)
    assert lift.positions == (ORIGIN, (0.0, 0.5, 0.0)) and lift.through == (1.0, 2.0, 3.0)
    assert lift.repeat and lift.frames == (0, 30)
    np.testing.assert_allclose(lift.rotations[1], quarter, atol=1e-15)
    assert drive == Keyframes(
        "left", (0, 30), (ORIGIN, (5.0, 6.0, 7.0)), (IDENTITY, quarter), ORIGIN
    )
    motion = MotionOptions(str(path)).of(load_scene("cornell-box"))
    at_end = motion.transforms_in(30)[3]  # the matrix as it stands
    np.testing.assert_allclose(at_end, [[0, 0, 1, 5], [0, 1, 0, 6], [-1, 0, 0, 7]], atol=1e-12)


WRONG = {
    'object = "sofa"\naxis = [0, 1, 0]': "no object called 'sofa' in scene 'cornell-box'",
    "axis = [0, 1, 0]": "'object' in [[motion]] 1 is missing",
    'object = "back"': "[[motion]] 1 has no motion; give either axis or frames",
    'object = "back"\naxis = [0, 1, 0]\nframes = [0, 1]': "give either axis or frames",
    'object = "back"\naxis = [0, 0, 0]': "the axis of 'back' is 0, 0, 0",
    'object = "back"\naxis = [0, nan, 0]': "'axis' in [[motion]] 1",
    'object = "back"\naxis = [0, 1, 0]\nperiod_frames = 0': "of at least 1",
    'object = "back"\naxis = [0, 1, 0]\nrepeat = true': "unknown key 'repeat'",
    'object = "back"\nframes = [0]\npositions = [[0, 0, 0]]': "has 1 keyframe(s); give at least",
    'object = "back"\nframes = [0, 9]': "give positions, rotate_degrees or matrices, or albedo",
    'object = "back"\nframes = [0, 9]\npositions = [[0, 0, 0]]': "2 frames and 1 positions",
    'object = "back"\nframes = [9, 0]\npositions = [[0, 0, 0], [1, 1, 1]]': "are at 9, 0",
    'object = "back"\nframes = [0, 0.5]\npositions = [[0, 0, 0], [1, 1, 1]]': "whole numbers",
    'object = "back"\nframes = 7\npositions = [[0, 0, 0], [1, 1, 1]]': "one entry per keyframe",
    'object = "back"\nframes = [0, 9]\npositions = [[0, 0, 0], [nan, 1, 1]]': "keyframe 2",
    'object = "back"\nframes = [0, 9]\nmatrices = [[1], [2]]': "a list of 16 numbers",
    'object = "back"\nframes = [0, 9]\npositions = [[0, 0, 0], [0, 0, 0]]\n'
    "matrices = []": "give either matrices or positions",
    'object = "sofa"\nframes = [0, 9]\nemission = [0, 1]': "no object called 'sofa'",
    'material = "velvet"\nframes = [0, 9]\nalbedo = [0, 1]': "no material called 'velvet'",
    'material = "white"\nframes = [0, 9]\nalbedo = [0, 1.5]': "keyframe 2 is 1.5, 1.5, 1.5; give",
    'object = "back"\nframes = [0, 9]\nemission = [[0, 0, -1], 0]': "keyframe 1 is 0, 0, -1; give",
    'object = "back"\nframes = [0, 9]\nemission = [1]': "2 frames and 1 of emission",
    'material = "white"\nframes = [0, 9]': "give albedo or emission, one per frame",
    'material = "white"\nframes = [0, 9]\npositions = []': "a material has albedo and emission",
    'object = "back"\nframes = [0, 9]\nmatrices = [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]'
    ", [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]]": "keyframe 2 of 'back' is not rigid",
}


@pytest.mark.parametrize("text", WRONG, ids=range(len(WRONG)))
def test_a_file_that_is_no_motion(tmp_path, capsys, text):
    path = tmp_path / "motion.toml"
    path.write_text(f"[[motion]]\n{text}\n")
    command = ["run", "--technique", "direct", "--motion", str(path), "--resolution", "16x8"]
    assert call([*command, "--frames", "1", "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and told.startswith(f"gibench: {path}: ")
    assert WRONG[text] in told and "Traceback" not in told
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "what"),
    [(None, "no such file"), ("", "holds no [[motion]]"), ("motion = 3", "write [[motion]]"),
     ("[[motion", "no motion can be read"), ("[[light]]\na = 1", "unknown key 'light'")],
)  # fmt: skip
def test_a_file_without_motion(tmp_path, text, what):
    path = tmp_path / "motion.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(BadInput) as error:
        load_motions(path)
    assert what in str(error.value) and str(error.value).startswith(str(path))


def test_the_pages_motions_are_sound(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "motion.md").read_text()
    path = tmp_path / "motion.toml"
    path.write_text(text.split("```toml\n")[1].split("```")[0])
    door, crate = load_motions(path)
    assert door == Turn("door", (0.0, 1.0, 0.0), (1.2, 0.0, -0.5), 120, 60.0)
    assert crate.repeat and crate.positions[1] == (0.0, 0.4, 0.0)


def test_the_pages_colours_are_sound(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "motion.md").read_text()
    path = tmp_path / "motion.toml"
    path.write_text(text.split("```toml\n")[2].split("```")[0])
    lamp, move, glow = load_motions(path)
    assert lamp.of_material and lamp.step and lamp.emission[1] == (8.0, 8.0, 8.0)
    assert move.name == glow.name == "door" and move.frames == glow.frames
    assert glow.albedo[0] == (0.5, 0.4, 0.3) and glow.emission[1] == (5.0, 4.5, 4.0)


def test_a_scene_file_describes_motions_of_meshes_by_name(tmp_path):
    (tmp_path / "two.obj").write_text(
        "o lid\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no tray\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf 4 5 6\n"
    )
    path = tmp_path / "scene.toml"
    text = """
schema_version = 1
[[mesh]]
file = "two.obj"
[[mesh]]
shape = "cube"
translate = [0, 0, 9]
[[mesh]]
name = "all of it"
file = "two.obj"
translate = [0, 0, 20]
[[motion]]
object = "NAME"
axis = [0, 0, 1]
"""
    for name, triangles in (("lid", 1), ("tray", 1), ("cube", 12), ("all of it", 2)):
        path.write_text(text.replace("NAME", name))
        scene = load_scene(str(path))
        assert scene.object_names == ("lid", "tray", "cube", "all of it", "all of it")
        motion = MotionOptions("scene").of(scene)
        assert motion.triangles.sum() == triangles
    path.write_text(text.replace("NAME", "lid").replace("axis", "axes"))
    with pytest.raises(BadInput, match=r"\[\[motion\]\] 1 has no motion"):
        load_scene(str(path))


def test_names_and_motions_change_no_hash():
    """What is baked and published is of scenes at rest."""
    from dataclasses import replace

    scene = load_scene("hall")
    plain = replace(scene, object_names=(), motions=())
    assert plain.content_hash() == scene.content_hash()


def test_runs_with_different_motions_are_not_compared():
    scenes = [{"name": "hall", "motions_hash": "a"}]
    rested = {"motion": {"path": "rest", "motions_hash": None}, "scenes": scenes}
    assert _motion({}) is _motion(rested) is None
    described = {"motion": {"path": "scene", "motions_hash": None}, "scenes": scenes}
    changed = {**described, "scenes": [{"name": "hall", "motions_hash": "b"}]}
    filed = {"motion": {"path": "a.toml", "motions_hash": "c"}, "scenes": scenes}
    told = [_motion(record) for record in (described, changed, filed)]
    assert None not in told and told[0] != told[1] != told[2] != told[0]


def test_pivots_of_a_far_scene_come_with_it(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("o sheet\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    poses = {}
    for far in (0, 2_000_000):
        (tmp_path / "a.toml").write_text(
            f'schema_version = 1\n[[mesh]]\nfile = "a.obj"\ntranslate = [{far}, 0, 0]\n'
            f'[[motion]]\nobject = "sheet"\naxis = [0, 1, 0]\nthrough = [{far + 2}, 0, 0]\n'
            f"period_frames = 8\n[probes]\npositions = [[{far + 0.25}, 0.5, 1]]\n"
        )
        scene = load_scene(str(tmp_path / "a.toml"))
        assert scene.origin == (far, 0, 0)
        assert scene.probes.positions.tolist() == [[0.25, 0.5, 1]]
        poses[far] = MovingObjects.of(scene, scene.motions).transforms_in(3)
    np.testing.assert_array_equal(poses[0], poses[2_000_000])
