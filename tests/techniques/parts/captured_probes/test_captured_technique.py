"""Irradiance probes and light field probes: what they converge to, leak and follow."""

from dataclasses import replace

import numpy as np
import pytest
from support.captured_oracle import NAMES, SMALL, VARIANTS, create
from support.made import check_memory
from support.synthetic_bake import random_scene
from support.tiny_scenes import empty_room

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.builtin import build
from gibench.scene.model import Camera, Material, PointLight
from gibench.techniques.registry import find_technique

SHOWN = ["camera", "application"]
RELIT = ["probe_relight", "filter_irradiance", "filter_distance", "border_copy"]
# Enough to tell rooms apart; a third of a second to bake.
ROOMS = {"map_texels": 16, "capture_texels": 64, "relit_share": 0.5}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("captured")


@pytest.fixture(scope="module")
def soup():
    return random_scene(np.random.default_rng(5), 60)


def frames(technique, count, size=64, first=0):
    prepared = prepare_passes(technique, size)
    assert all(p.problem is None for p in prepared)
    for frame in range(first, first + count):
        enqueue_frame(technique, prepared, frame)
    return prepared


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("update", ["static", "relit"])
def test_memory_passes_and_notes(soup, cache, name, variant, update):
    settings = {**SMALL, "update": update}
    technique = create(name, soup, settings, cache, variant)
    spec = find_technique(name)
    least, held = check_memory(spec, technique, spec.settings(settings), variant, 64, 50)
    assert 0.5 * held < least < held
    before = technique.device.memory.total_bytes
    assert technique.indirect_irradiance().shape == (50, 3)
    assert technique.device.memory.total_bytes == before
    own = [p for p in RELIT if p != "filter_distance" or name == "light-field-probes"]
    names = [p.name for p in frames(technique, 1)]
    assert names == (own if update == "relit" else []) + SHOWN
    assert technique.counts() == {"probes": 12, "receivers": 50}
    told = " ".join(technique.notes())
    assert "its captured cube took" in told
    # Its lights move, which is said where the probes do not follow.
    assert ("lit once" in told) == (update == "static")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("update", ["static", "relit"])
def test_variants_show_the_same(soup, cache, name, update):
    found = []
    for variant in (*VARIANTS, "tuned"):
        technique = create(name, soup, {**SMALL, "update": update}, cache, variant)
        frames(technique, 7)
        found.append({**technique.images(), "receivers": technique.indirect_irradiance()})
    published, tuned, again = found
    assert set(tuned) == {"frame", "direct only", "indirect only", "receivers"}
    assert tuned["indirect only"].max() > 0
    for title, image in tuned.items():
        np.testing.assert_array_equal(image, again[title])
        np.testing.assert_allclose(published[title], image, rtol=3e-3, atol=1e-3 * image.max())


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("variant", VARIANTS)
def test_bounces_accumulate_over_frames(cache, name, variant):
    """In a closed room of albedo 0.5 and emission 1: irradiance 2 pi, halving what is missing with
    every round of the probes.
    """
    scene, lightmap = empty_room(side=3)
    glowing = (Material("glowing", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)),)
    camera = (Camera((0.0, 1.2, 0.9), (0.0, 1.2, 0.0), 70.0),)
    scene = replace(scene, materials=glowing, cameras=camera)
    settings = {**SMALL, "relit_share": 1.0, "storage": "fp32"}
    technique = create(name, scene, settings, cache, variant, lightmap=lightmap)
    for frame in range(4):
        frames(technique, 1, first=frame)
        expected = 2 * np.pi * (1 - 0.5 ** (frame + 1))
        np.testing.assert_allclose(technique.indirect_irradiance(), expected, rtol=1e-3)
    frames(technique, 12)
    np.testing.assert_allclose(technique.indirect_irradiance(), 2 * np.pi, rtol=1e-3)
    image = technique.images()["frame"]
    assert image.mean() == pytest.approx(2.0, rel=2e-3)


@pytest.mark.parametrize("name", NAMES)
def test_relit_and_settled_is_what_is_lit_once_with_any_bounces(cache, name):
    """Two ways of one light: kernels frame by frame, NumPy and Embree in the bake."""
    scene, lightmap = empty_room(side=4)
    lamp = (PointLight((0.3, 2.0, 0.2), (3.0, 2.0, 1.0)),)
    scene = replace(scene, lights=lamp, cameras=(Camera((0.0, 1.2, 0.9), (0.0, 1.2, 0.0)),))
    shared = {**SMALL, "bounces": "any", "storage": "fp32", "map_texels": 8}
    lit = {"update": "static", **({"gather": "irradiance"} if name == NAMES[1] else {})}
    once = create(name, scene, {**shared, **lit}, cache, lightmap=lightmap)
    relit = create(name, scene, shared, cache, lightmap=lightmap)
    frames(once, 1)
    frames(relit, 90)
    expected = once.indirect_irradiance()
    assert expected.mean() > 0.1
    np.testing.assert_allclose(relit.indirect_irradiance(), expected, rtol=0.01, atol=2e-3)


def shares(technique, receivers):
    """Mean irradiance in the room with the lamp, and in the other over it."""
    found = technique.indirect_irradiance().mean(axis=1).astype(np.float64)
    x = receivers.position[:, 0]
    lit, dark = found[x < 0].mean(), found[x > 0].mean()
    return lit, dark / lit


def two_rooms(scene):
    """Receivers all over the surface."""
    rng = np.random.default_rng(0)
    c = scene.corners.astype(np.float64)
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    area = np.linalg.norm(normal, axis=1)
    chosen = rng.choice(len(c), 600, p=area / area.sum())
    _, base = empty_room(side=10)
    place = np.einsum("nk,nkd->nd", rng.dirichlet((1, 1, 1), 600), c[chosen])
    facing = (normal / area[:, None])[chosen]
    receivers = replace(
        base.receivers, position=place.astype(np.float32), normal=facing.astype(np.float32)
    )
    return replace(base, receivers=receivers)


@pytest.mark.parametrize("update", ["static", "relit"])
def test_light_leaks_without_visibility_and_not_with_it(cache, update):
    """A whole wall between the rooms; equal bounces. Path-traced, the dark room is black."""
    scene = build("two-rooms")
    lightmap, leaks = two_rooms(scene), {}
    for name in NAMES:
        settings = {**ROOMS, "update": update, "bounces": "any"}
        technique = create(name, scene, settings, cache, lightmap=lightmap, image=(4, 4))
        frames(technique, 1 if update == "static" else 40)
        lit, leaks[name] = shares(technique, lightmap.receivers)
        assert lit > 1
    assert leaks["irradiance-probes"] > 0.05
    assert leaks["light-field-probes"] < 0.01


def test_dark_because_of_visibility_and_not_for_want_of_energy(cache):
    """Path-traced, the dark room has 12.2 % of the lit one's light through the gap
    (``gibench experiment light-field``).
    """
    scene = build("two-rooms-gap")
    lightmap = two_rooms(scene)
    settings = {**ROOMS, "update": "static"}
    technique = create("light-field-probes", scene, settings, cache, lightmap=lightmap)
    _, share = shares(technique, lightmap.receivers)
    assert share == pytest.approx(0.122, rel=0.15)


@pytest.mark.parametrize("name", NAMES)
def test_light_follows_a_lamp_that_goes_out_and_comes_elsewhere(cache, name):
    scene, lightmap = empty_room(side=4)
    camera = (Camera((0.0, 1.2, 0.9), (0.0, 1.2, 0.0)),)
    settings = {**SMALL, "relit_share": 0.5, "storage": "fp32"}

    def lamp(x):
        return replace(scene, lights=(PointLight((x, 1.6, 0.0), (2.0, 2.0, 2.0)),), cameras=camera)

    moving = replace(
        scene,
        lights=(PointLight((0.0, 1.6, 0.0), (2.0, 2.0, 2.0), orbit_radius=0.6, period_frames=200),),
        cameras=camera,
    )
    technique = create(name, moving, settings, cache, lightmap=lightmap)
    prepared = prepare_passes(technique, 64)
    for _ in range(60):
        enqueue_frame(technique, prepared, 0)
    for _ in range(60):
        enqueue_frame(technique, prepared, 100)  # on the other side
    there = create(name, lamp(-0.6), settings, cache, lightmap=lightmap)
    frames(there, 60)
    found, expected = technique.indirect_irradiance(), there.indirect_irradiance()
    np.testing.assert_allclose(found, expected, rtol=5e-3, atol=1e-3 * expected.max())
