"""Albedo and emission that change over frames: keys, what they are bound to, a scene in a frame."""

from dataclasses import replace

import numpy as np
import pytest
from support.glow_scenes import glowing
from support.moving_scenes import LEFT, RIGHT, furnished_room, jump, scene_in
from support.synthetic_bake import random_scene
from support.tiny_scenes import room

from gibench.errors import BadInput
from gibench.scene.builtin import build
from gibench.scene.colours import Colours
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import Turn
from gibench.techniques.parts.recolouring import Shares

RED, WHITE, OFF = (0.9, 0.1, 0.1), (0.5, 0.5, 0.5), (0.0, 0.0, 0.0)


def test_keys_are_met_and_joined_straight(rng):
    keys = rng.uniform(0, 1, (4, 3))
    frames = (3, 7, 20, 21)
    albedo, emission = tuple(map(tuple, keys.tolist())), tuple(map(tuple, (9 * keys).tolist()))
    one = Colours("lamp", frames, albedo, emission)
    for frame in (0, 3, 5, 7, 13, 20, 21, 400):
        expected = [np.interp(frame, frames, keys[:, k]) for k in range(3)]
        found = one.at(frame)
        np.testing.assert_allclose(found[0], expected, atol=1e-12)
        np.testing.assert_allclose(found[1], 9 * np.array(expected), atol=1e-12)
    assert Colours("lamp", frames, albedo).at(5)[1] is None
    assert Colours("lamp", frames, (), emission).at(5)[0] is None
    np.testing.assert_allclose(one.brightest, 9 * keys.max(axis=0))


def test_a_step_holds_until_the_next_key_and_repeats():
    one = Colours("lamp", (0, 10, 20), (), (OFF, WHITE, OFF), step=True, repeat=True)
    lit = [one.at(frame)[1] != OFF for frame in range(60)]
    assert lit == [10 <= frame % 20 < 20 for frame in range(60)]


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: Colours("a", (0,), (RED,)), r"have 1 keyframe\(s\)"),
        (lambda: Colours("a", (4, 4), (RED, RED)), "are at 4, 4"),
        (lambda: Colours("a", (0, 4), (RED,)), "2 frames and 1 of albedo"),
        (lambda: Colours("a", (0, 4), (RED, (0, 1.01, 0))), "albedo of 'a' in keyframe 2 is 0, 1"),
        (lambda: Colours("a", (0, 4), ((-0.1, 0, 0), RED)), "albedo of 'a' in keyframe 1 is -0.1"),
        (lambda: Colours("a", (0, 4), (), (OFF, (0, 0, -1))), "emission of 'a' in keyframe 2"),
        (lambda: Colours("a", (0, 4), (), (OFF, (0, 0, float("inf")))), "emission of 'a'"),
    ],
)
def test_colours_that_make_no_sense(make, what):
    with pytest.raises(BadInput, match=what) as error:
        make()
    assert "\n" not in str(error.value)


def test_only_the_object_or_all_of_the_material_changes():
    scene = furnished_room()  # both boxes have the material "box"
    by_object = MovingObjects.of(scene, [Colours(LEFT, (0, 9), (RED, WHITE))])
    assert not by_object.moves
    changing = by_object.materials
    assert np.array_equal(changing.triangles, scene.object_numbers() == 1)
    seen = by_object.scene_in(scene, 0)
    for triangle in range(len(scene.triangles)):
        there = seen.materials[seen.material_ids[triangle]]
        before = scene.materials[scene.material_ids[triangle]]
        number = scene.object_numbers()[triangle]
        assert there == (replace(before, base_color=RED) if number == 1 else before)
    by_material = MovingObjects.of(
        scene, [Colours("box", (0, 9), (), (OFF, RED), of_material=True)]
    )
    assert np.array_equal(by_material.materials.triangles, scene.object_numbers() > 0)
    both = MovingObjects.of(
        scene,
        [
            Colours("box", (0, 9), (), (OFF, RED), of_material=True),
            Colours(LEFT, (0, 9), (RED,) * 2),
        ],
    )
    seen = both.scene_in(scene, 9)
    kinds = [seen.materials[i] for i in seen.material_ids[scene.object_numbers() == 1]]
    assert all(kind.base_color == RED and kind.emission == RED for kind in kinds)
    assert "24 triangles changes" in both.note() and "left box" in both.note()


def test_what_is_not_there_or_said_twice_is_told():
    scene = furnished_room()
    for colours, what in (
        ([Colours("left bx", (0, 9), (RED,) * 2)], "no object called 'left bx'.*has left box"),
        (
            [Colours("boxx", (0, 9), (RED,) * 2, of_material=True)],
            "no material called 'boxx'.*it has box",
        ),
        (
            [
                Colours("box", (0, 9), (RED,) * 2, of_material=True),
                Colours(LEFT, (0, 9), (RED,) * 2),
            ],
            "the albedo of 'left box' is keyed twice",
        ),
    ):
        with pytest.raises(BadInput, match=what) as error:
            MovingObjects.of(scene, colours)
        assert "\n" not in str(error.value)


def test_keyed_emission_takes_an_images_place(rng):
    scene = glowing(random_scene(rng), rng)
    name = scene.materials[0].name
    glows = np.zeros(len(scene.triangles), bool)
    glows[scene.glow.triangle] = True
    keyed = MovingObjects.of(scene, [Colours(name, (0, 9), (), (RED,) * 2, of_material=True)])
    left = keyed.scene_in(scene, 0).glow
    mine = keyed.materials.triangles
    expected = np.flatnonzero(glows & ~mine)
    assert (glows & mine).any()
    assert np.array_equal([] if left is None else left.triangle, expected)
    still = MovingObjects.of(scene, [Colours(name, (0, 9), (RED,) * 2, of_material=True)])
    assert still.scene_in(scene, 0).glow is scene.glow


def test_a_scene_in_a_frame_lies_where_float64_puts_it(rng):
    scene = furnished_room()
    changes = [
        Turn(LEFT, tuple(rng.normal(size=3)), period_frames=17),
        jump(RIGHT, (0.5, 0.1, -0.3), 4),
        Colours(LEFT, (0, 10), (RED, WHITE)),
    ]
    motion = MovingObjects.of(scene, changes)
    for frame in (0, 3, 5):
        found, expected = motion.scene_in(scene, frame), scene_in(scene, motion, frame)
        np.testing.assert_array_equal(found.positions, expected.positions)
        np.testing.assert_array_equal(found.normals, expected.normals)
    held = MovingObjects.of(scene, changes, held=5)
    for frame in (0, 77):
        np.testing.assert_array_equal(held.transforms_in(frame), motion.transforms_in(5))
        assert held.scene_in(scene, frame).materials == motion.scene_in(scene, 5).materials


def test_receivers_move_with_what_they_lie_on(rng):
    scene, lightmap = room(5)
    names = tuple(f"wall {n}" for n in range(len(np.unique(scene.object_ids))))
    scene = replace(scene, object_names=names)
    motion = MovingObjects.of(scene, [jump("wall 1", (0.25, 0.5, -0.125), 6)])
    mine = motion.receivers(lightmap)
    assert np.array_equal(
        mine, lightmap.fragments.triangle[lightmap.fragments.start[:-1]] // 2 == 1
    )
    moved = motion.lightmap_in(scene, lightmap, 6)
    shift = np.where(mine[:, None], (0.25, 0.5, -0.125), 0.0)
    np.testing.assert_allclose(
        moved.receivers.position, lightmap.receivers.position + shift, atol=1e-6
    )
    np.testing.assert_array_equal(moved.receivers.normal, lightmap.receivers.normal)
    pieces = np.repeat(shift, np.diff(lightmap.fragments.start), axis=0)[:, None]
    np.testing.assert_allclose(
        moved.fragments.corners, lightmap.fragments.corners + pieces, atol=1e-6
    )
    still = motion.lightmap_in(scene, lightmap, 5)
    np.testing.assert_array_equal(still.receivers.position, lightmap.receivers.position)


def recoloured(shares, receivers, materials):
    """Albedo and emission (n, 3) of receivers, in float64."""
    found = [receivers.albedo.astype(np.float64), receivers.emission.astype(np.float64)]
    base = np.array([m.base_color for m in materials])
    sent = np.array([m.emission for m in materials])
    for number, place in enumerate(shares.places):
        part = slice(shares.starts[number], shares.starts[number + 1])
        rows, share = shares.rows[part], shares.shares[part].astype(np.float64)
        found[0][place] = shares.rest[number, 0] + (share[:, :3] * base[rows]).sum(axis=0)
        found[1][place] = shares.rest[number, 1] + (share[:, 3:] * sent[rows]).sum(axis=0)
    return found


def test_a_texel_has_the_mean_of_what_it_covers_in_every_frame(rng):
    """As the atlas of a scene that has these colours finds it, images and all."""
    scene = random_scene(rng, 24)
    scene = replace(scene, object_ids=np.repeat(np.arange(4), 6).astype(np.int32),
                    object_names=("a", "b", "c", "d"))  # fmt: skip
    keys = [tuple(map(tuple, k.tolist())) for k in rng.uniform(0, 1, (3, 2, 3))]
    motion = MovingObjects.of(
        scene,
        [
            Colours("textured", (0, 4), keys[0], of_material=True),
            Colours("glowing", (0, 4), (), keys[1], of_material=True),
            Colours("plain", (0, 4), (), keys[2], of_material=True),
        ],
    )
    lightmap = unwrap(scene, 60)
    shares = Shares.of_receivers(scene, lightmap, motion.materials)
    for frame in (0, 3):
        now = motion.scene_in(scene, frame)
        expected = unwrap(now, 60).receivers
        np.testing.assert_array_equal(expected.texel, lightmap.receivers.texel)
        albedo, emission = recoloured(shares, lightmap.receivers, now.materials)
        np.testing.assert_allclose(albedo, expected.albedo, rtol=1e-4, atol=2e-5)
        np.testing.assert_allclose(emission, expected.emission, rtol=1e-4, atol=2e-5)


def test_an_object_that_rests_keeps_its_texels():
    scene = build("cornell-box")
    lightmap = unwrap(scene, 200)
    motion = MovingObjects.of(scene, [Colours("short box", (0, 4), (), (OFF, RED))])
    shares = Shares.of_receivers(scene, lightmap, motion.materials)
    on_box = motion.materials.triangles[lightmap.fragments.triangle]
    owners = np.repeat(np.arange(len(lightmap.receivers)), np.diff(lightmap.fragments.start))
    assert np.array_equal(shares.places, np.unique(owners[on_box]))
