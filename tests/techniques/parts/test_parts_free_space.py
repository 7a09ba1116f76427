"""What is measured of a scene before a run, against closed forms; and what remarks say of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.scaled import scaled
from support.tiny_scenes import box, quad_scene

from gibench.profiles import load_profile
from gibench.scene.builtin import build
from gibench.scene.environment import Environment
from gibench.scene.model import Camera, DirectionalLight, Material, PointLight, Scene
from gibench.techniques.ddgi.placement import make_volume
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.gibs.radii import covering_surfels
from gibench.techniques.gibs.settings import GibsSettings
from gibench.techniques.job import Job, Shot
from gibench.techniques.parts.free_space import free_space
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.parts.reach import light_in_reach
from gibench.techniques.parts.unseen_sky import unseen_sky, wider
from gibench.techniques.registry import find_technique

LOOKING = Camera((0.1, 1.3, 0.9), (0.0, 1.0, -1.0), 70.0)


def room(**more) -> Scene:
    """2 x 2.4 x 2.2 m, closed, with a camera in it."""
    scene, _ = quad_scene(box((-1, 0, -1.1), (1, 2.4, 1.1), inward=True), 2, **more)
    return replace(scene, cameras=(LOOKING,))


def told(scene: Scene, technique: str, variant: str = "tuned", **settings) -> list[str]:
    job = asked(technique, variant, scene, **settings)
    return find_technique(technique).remarks(job, scene, scene.cameras[0])


def asked(technique: str, variant: str, scene: Scene, **settings) -> Job:
    of = find_technique(technique).settings(settings)
    profile, shot = load_profile("vega56"), Shot(64, 36)
    return Job(technique, of, variant, scene.name, profile, 64, shot=shot)


def test_closeness_is_that_of_a_fifth_of_the_surface():
    """Walls 2 m apart are 36 % of the room's surface; 2.2 m apart the next 31 %."""
    assert free_space(room()).closeness == pytest.approx(2.0, rel=1e-3)
    assert free_space(room()).open == 0.0
    lone, _ = quad_scene([((0, 0, 0), (1, 0, 0), (0, 0, -1))], 2)
    assert free_space(lone).closeness == np.inf
    assert free_space(lone).open == 1.0


def test_a_lamp_in_a_closed_room_sends_all_its_light_to_the_walls():
    """4 pi I over the surface, wherever it hangs."""
    lamp = PointLight((0.3, 1.5, -0.2), (2.0, 2.0, 2.0))
    area = 2 * (2 * 2.4 + 2 * 2.2 + 2.4 * 2.2)
    found = free_space(room(lights=(lamp,)))
    assert found.lamps == pytest.approx(4 * np.pi * 2.0 / area, rel=0.05)
    assert found.light == found.lamps
    sun = DirectionalLight((0.0, -1.0, 0.0), (5.0, 5.0, 5.0))
    assert free_space(room(lights=(sun,))).lamps == 0.0


def test_a_sky_above_a_plane(rng):
    """pi L of a constant one; of one bright texel, all of whose light is its half."""
    plane, _ = quad_scene([((-1, 0, 1), (2, 0, 0), (0, 0, -2))], 2, sky=(3.0, 3.0, 3.0))
    found = free_space(plane)
    assert found.sky == pytest.approx(3 * np.pi, rel=0.02)
    assert found.bright_sky == 1.0  # one texel
    pixels = np.zeros((64, 128, 3), np.float32)
    pixels[10, int(rng.integers(128))] = 1e5
    sunny = replace(plane, environment=Environment(pixels))
    polar = np.pi * 10.5 / 64
    solid = np.sin(polar) * np.pi / 64 * 2 * np.pi / 128
    found = free_space(sunny)
    assert found.sky == pytest.approx(1e5 * solid * np.cos(polar), rel=0.02)
    assert found.bright_sky == pytest.approx(solid / (4 * np.pi), rel=0.02)


def test_a_small_lamp_on_the_ceiling():
    """What it sends is pi L times its area, all of it to the walls; it covers as little of the
    sphere as it is small and far."""
    scene = room()
    lamp, _ = quad_scene([((-0.1, 2.39, -0.1), (0.2, 0, 0), (0, 0, 0.2))], 2)
    count = len(scene.positions)
    both = replace(
        scene,
        positions=np.concatenate([scene.positions, lamp.positions]),
        normals=np.concatenate([scene.normals, lamp.normals]),
        uvs=np.concatenate([scene.uvs, lamp.uvs]),
        triangles=np.concatenate([scene.triangles, lamp.triangles + count]).astype(np.int32),
        material_ids=np.r_[scene.material_ids, [1, 1]].astype(np.int32),
        object_ids=np.r_[scene.object_ids, [9, 9]].astype(np.int32),
        materials=(Material("grey", (0.5,) * 3), Material("lamp", (0.0,) * 3, (7.0,) * 3)),
    )
    found = free_space(both)
    area = 2 * (2 * 2.4 + 2 * 2.2 + 2.4 * 2.2) + 0.04
    assert found.emitted == pytest.approx(np.pi * 7 * 0.04 / area, rel=0.1)
    assert 0.04 / (4 * np.pi * 3**2) < found.small_emitters < 0.04 / (4 * np.pi * 0.5**2)


@pytest.mark.parametrize("factor", [1e-3, 2500.0])
def test_a_scene_in_another_unit_is_the_same(factor):
    """Its closeness in that unit, and remarks alike but for lengths."""
    scene, other = build("maze"), scaled(build("maze"), factor)
    one, two = free_space(scene), free_space(other)
    assert two.closeness == pytest.approx(factor * one.closeness, rel=1e-3)
    assert two.lamps == pytest.approx(one.lamps, rel=0.02)
    spec = find_technique("ddgi")
    few = spec.settings({"probes": 30})
    assert len(told(scene, "ddgi", probes=30)) == len(told(other, "ddgi", probes=30)) == 1
    assert few.probes == 30
    assert told(other, "ddgi") == told(scene, "ddgi") == []


def test_what_rays_reach_from_what_a_camera_shows():
    # No light is sent: nothing is missed.
    assert light_in_reach(room(), LOOKING, 1.0, hops=True) == 1.0
    lit = room(lights=(PointLight((0.3, 1.5, -0.2), (2.0, 2.0, 2.0)),))
    assert light_in_reach(lit, LOOKING, 1.0, hops=False) < 0.5
    assert light_in_reach(lit, LOOKING, 1.0, hops=True) == 1.0
    # The back of a lone thing is seen by nothing that the camera sees.
    vase = build("vase")
    assert light_in_reach(vase, vase.cameras[0], 1.8, hops=True) < 0.8
    # A room without light and without a door is not missed.
    rooms = build("two-rooms")
    assert light_in_reach(rooms, rooms.cameras[0], 1.8, hops=True) > 0.95


def test_light_counts_and_not_area():
    """Of a block in an even sky the face that is looked at, by its area; where the sky is above
    alone, the top has all of it, the sides half and the bottom none.
    """
    block, _ = quad_scene(box((-1, 0, -1.1), (1, 2.4, 1.1), inward=False), 2, sky=(2.0, 1.0, 0.5))
    front, side, top = 2 * 2.4, 2.2 * 2.4, 2 * 2.2
    ahead = Camera((0.0, 1.2, 80.0), (0.0, 1.2, 0.0), 10.0)
    even = light_in_reach(block, ahead, 1.0, hops=True)
    assert even == pytest.approx(front / (2 * (front + side + top)), abs=0.01)
    pixels = np.zeros((64, 128, 3), np.float32)
    pixels[:32] = 1.0
    above = Camera((0.0, 80.0, 0.0), (0.0, 0.0, 0.0), 10.0, up=(0.0, 0.0, 1.0))
    found = light_in_reach(replace(block, environment=Environment(pixels)), above, 1.0, hops=True)
    assert found == pytest.approx(top / (top + front + side), abs=0.03)


def test_remarks_name_the_setting_that_ends_them():
    maze = build("maze")
    (one,) = told(maze, "ddgi", probes=30)
    assert "within 2 m" in one and "MiB" in one
    wanted = int(one.split("--probes ")[1].split()[0])
    assert told(maze, "ddgi", probes=wanted) == []
    (hidden,) = told(maze, "gibs", placement="camera")
    assert "--set gibs.placement=rays" in hidden
    assert told(maze, "gibs") == []
    assert told(maze, "gibs", variant="published") == [hidden]
    for technique in ("ddgi", "srp"):
        (lamp,) = told(build("big-hall"), technique)
        assert "emitting surfaces" in lamp and "point lights" in lamp
        assert ("relight_samples=" in lamp and "for the mean" in lamp) == (technique == "srp")
    assert told(maze, "srp") == told(maze, "direct") == []
    # Which path shows more: through the inside, or around the outside.
    for name, path in (("thin-house", "around"), ("vase", "flight")):
        (unseen,) = told(build(name), "gibs")
        assert f"--camera-path {path} " in unseen and " shows all but " in unseen


def test_light_that_all_surfels_together_find_is_noise_and_no_remark():
    """Each meets the lamp seldom; so do all, where they are few."""
    hall = build("big-hall")
    spec, camera = find_technique("gibs"), hall.cameras[0]
    assert told(hall, "gibs") == []
    (noise,) = spec.flaws(asked("gibs", "tuned", hall), hall, camera)
    assert "noise about the right mean; give them as point lights" in noise
    full, dark = told(hall, "gibs", surfels=1000)
    assert "or dark; give them as point lights" in dark
    # There is no room for them to lie everywhere; with what the remark gives there is.
    assert "none beyond 700 of the 1,000" in full
    wanted = int(full.split("gibs.surfels=")[1].split()[0])
    assert told(hall, "gibs", surfels=wanted) == []
    # With a layer and a half nearly all is covered; with less than one much is not.
    once = covering_surfels(hall, camera, GibsSettings()) / 0.7
    assert [one for one in told(hall, "gibs", surfels=int(once)) if "none beyond" in one]
    assert told(hall, "gibs", surfels=int(1.5 * once)) == []
    only_seen = told(hall, "gibs", surfels=1000, placement="camera")
    assert not [one for one in only_seen if "none beyond" in one]
    assert spec.flaws(asked("gibs", "tuned", hall, surfels=1000), hall, camera) == []


@pytest.mark.parametrize("factor", [1e-3, 2500.0])
def test_surfels_that_cover_a_plane_are_its_area_over_theirs(factor):
    """Seen from so high above that all are about as far, whatever the unit."""
    plane, _ = quad_scene([((-1, 0, 1), (2, 0, 0), (0, 0, -2))], 2)
    plane = scaled(plane, factor)
    settings = GibsSettings(radius_share=1e-4, smallest_radius=1e-9)
    camera = Camera((0.0, 50.0 * factor, 0.0), (0.0, 0.0, 0.0), 40.0)
    radius = 50 * 2 * np.tan(np.radians(20)) * 1e-4
    expected = pytest.approx(4 / (np.pi * radius**2), rel=1e-3)
    assert covering_surfels(plane, camera, settings) == expected
    # None is larger than a cell, nor smaller than what is set.
    cell = GibsSettings(radius_share=1.0, grid_cells=20)
    assert covering_surfels(plane, camera, cell) == pytest.approx(4 / (np.pi * 0.1**2), rel=1e-5)
    least = GibsSettings(radius_share=1e-9, smallest_radius=0.01)
    assert covering_surfels(plane, camera, least) == pytest.approx(4 / (np.pi * 8e-4), rel=1e-5)


@pytest.mark.parametrize("technique", ["ddgi", "irradiance-probes", "light-field-probes"])
@pytest.mark.parametrize("factor", [1e-3, 2500.0])
def test_sky_on_the_outside_of_a_model_is_said(factor, technique):
    """With the volume that has probes around it, which is one more layer of the technique's own."""
    block, _ = quad_scene(box((-1, 0, -1.1), (1, 2.4, 1.1), inward=False), 2, sky=(2.0, 1.0, 0.5))
    block = scaled(replace(block, cameras=(LOOKING,)), factor)
    (dark,) = [one for one in told(block, technique) if "the sky's" in one]
    given = dict(one.split()[0].split("=") for one in dark.split(f"--set {technique}.")[1:])
    assert set(given) == {"counts", "origin", "spacing"}
    assert not [one for one in told(block, technique, **given) if "the sky's" in one]
    assert "no setting is known" not in dark
    # A room in it, behind walls thinner than probes tell apart, would get that light, too.
    quads = box((-1, 0, -1.1), (1, 2.4, 1.1), inward=False)
    quads += box((-0.99, 0.01, -1.09), (0.99, 2.39, 1.09), inward=True)
    house, _ = quad_scene(quads, 2, sky=(2.0, 1.0, 0.5))
    house = scaled(replace(house, cameras=(LOOKING,)), factor)
    (both,) = [one for one in told(house, technique) if "the sky's" in one]
    assert "no setting is known to mend both" in both and f"--set {technique}.counts=" in both
    inside = replace(room(), cameras=(LOOKING,))
    assert not [one for one in told(inside, technique) if "the sky's" in one]


@pytest.mark.parametrize("factor", [1e-3, 2500.0])
def test_sky_on_the_outside_of_a_model_is_seen_by_no_probe_in_it(factor):
    """A block's faces are all outside; the volume that the remark gives has probes around it."""
    block, _ = quad_scene(box((-1, 0, -1.1), (1, 2.4, 1.1), inward=False), 2, sky=(2.0, 1.0, 0.5))
    block = scaled(replace(block, cameras=(LOOKING,)), factor)
    volume = make_volume(block, DdgiSettings())
    assert unseen_sky(block, volume, 0.0) == pytest.approx(1.0)
    assert unseen_sky(block, wider(volume), 0.0) == 0.0
    assert not [one for one in told(block, "ddgi", scrolling="true") if "the sky's" in one]
    # Half of what a lamp sends counts as well; a room without a sky has none to miss.
    lamp = PointLight((0.0, 9.0 * factor, 0.0), (3.0, 3.0, 3.0))
    lit = replace(block, lights=(lamp,))
    space = free_space(lit)
    expected = space.sky / (space.sky + space.lamps / 2)
    assert unseen_sky(lit, volume, 0.0) == pytest.approx(expected)
    assert unseen_sky(room(), make_volume(room(), DdgiSettings()), 0.0) == 0.0
    # Far beyond the volume its light has faded.
    beside = Volume((9.0 * factor, 0.0, 0.0), volume.spacing, volume.counts)
    assert unseen_sky(block, beside, 0.0) == pytest.approx(1.0)
