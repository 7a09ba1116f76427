"""Gloss of captured probes: prefiltered radiance, where it is looked up, what of it goes on."""

from dataclasses import replace

import numpy as np
import pytest
from support.captured_oracle import (
    NAMES,
    SMALL,
    VARIANTS,
    create,
    expected_image,
    lobes_of,
    prefiltered,
    randomise,
    seen,
    table,
    weights,
    within_reach,
)
from support.ddgi_oracle import bordered
from support.launches import run_pass
from support.synthetic_bake import random_scene
from support.tiny_scenes import empty_room
from support.vector_widths import widths

from gibench.device import Device
from gibench.rays.embree import EmbreeTracer
from gibench.scene.model import Camera, Material
from gibench.techniques.parts.captured_probes import lobes
from gibench.techniques.parts.captured_probes.maps import texel_solid_angles

IMAGE = (48, 32)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("captured")


@pytest.fixture(scope="module")
def soup():
    scene = random_scene(np.random.default_rng(5), 60)
    rng = np.random.default_rng(6)
    glossy = [
        replace(m, roughness=float(rng.random()), metalness=float(rng.random()))
        for m in scene.materials
    ]
    return replace(scene, materials=tuple(glossy))


@pytest.mark.parametrize("width", widths(1, 8))
@pytest.mark.parametrize(("size", "side", "steps"), [(1, 6, 2), (7, 10, 3), (64, 16, 5)])
def test_prefilter(rng, soup, cache, monkeypatch, width, size, side, steps):
    """Each step of each probe that is relit, with true borders; the others are left alone."""
    monkeypatch.setattr(Device, "vector_width", property(lambda self: width))
    settings = {**SMALL, "map_texels": side, "storage": "fp32", "gloss_steps": steps}
    technique = create("light-field-probes", soup, settings, cache, size=size)
    held, device = technique.probes, technique.device
    probes = np.array([7, 0, 11, 4, 3], np.int32)
    device.write(held.capture["relit"], probes)
    count = technique._passes.schedule.each_frame
    radiance = np.zeros(held.capture["radiance"].shape)
    radiance[:, :, : side**2] = rng.uniform(0, 3, (5, 3, side**2))
    device.write(held.capture["radiance"], radiance)
    run_pass(technique, "prefilter", size)
    run_pass(technique, "border_copy", size)
    given = radiance[:count, :, : side**2].transpose(0, 2, 1)
    expected = prefiltered(given, side, steps)
    on_host = lobes.prefiltered(given.astype(np.float32), side, steps)
    others = np.setdiff1d(np.arange(12), probes[:count])
    for found, own, host in zip(lobes_of(technique), expected, on_host, strict=True):
        np.testing.assert_array_equal(found, bordered(found))
        inner = found[probes[:count], 1:-1, 1:-1].reshape(own.shape)
        np.testing.assert_allclose(inner, own, rtol=2e-4)
        np.testing.assert_allclose(host, own, rtol=2e-4)
        assert not found[others].any()


def test_prefiltered_maps_keep_energy(rng):
    """Light of one colour stays as it is. Of any other a map holds, over the whole sphere, what the
    radiance does: 3 % for a texel alone, as maps of half the side are sums over other points; less
    where texels differ at random.
    """
    side, steps = 64, 5
    assert lobes.lobe_sides(side, steps) == (64, 32, 16, 8, 8)
    constant = np.tile(rng.uniform(1, 2, 3), (1, side**2, 1)).astype(np.float32)
    for own in lobes.prefiltered(constant, side, steps):
        np.testing.assert_allclose(own, np.broadcast_to(constant[0, 0], own.shape), rtol=1e-5)
    sky = np.zeros((40, side**2, 3), np.float32)
    sky[np.arange(39), rng.integers(0, side**2, 39)] = rng.uniform(0.5, 2, (39, 3))
    sky[39] = rng.uniform(0, 1, (side**2, 3))
    whole = np.einsum("t,ptc->pc", texel_solid_angles(side), sky)
    for own in lobes.prefiltered(sky, side, steps):
        angle = texel_solid_angles(int(np.sqrt(own.shape[1])))
        kept = np.einsum("t,ptc->pc", angle, own)
        np.testing.assert_allclose(kept, whole, rtol=0.03)
        np.testing.assert_allclose(kept[39], whole[39], rtol=0.005)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("variant", "size", "storage"), [("published", 7, "fp32"), ("tuned", 64, "fp16")]
)
def test_application(rng, soup, cache, name, variant, size, storage):
    settings = {**SMALL, "map_texels": 8, "gloss_steps": 3, "storage": storage}
    technique = create(name, soup, settings, cache, variant, size, image=IMAGE)
    randomise(technique, rng)
    held, device = technique.probes, technique.device
    rows = [
        bordered(rng.uniform(0.1, 2, (12, side + 2, side + 2, 4))).reshape(-1, 4)
        for side in lobes.lobe_sides(8, 3)
    ]
    device.write(held.lobes, np.concatenate(rows))
    found = technique.images()["indirect only"].reshape(-1, 3)
    expected, certain = expected_image(technique, soup, IMAGE)
    assert certain.sum() > 60 and (expected[certain] > 0.05).any()
    off = np.abs(found - expected)[certain].max(axis=1)
    np.testing.assert_allclose(found[certain], expected[certain], rtol=5e-3, atol=5e-3)
    assert np.median(off) < 1e-4


@pytest.mark.parametrize("update", ["static", "relit"])
def test_a_mirror_shows_the_wall_that_it_faces(cache, update):
    """In a room that is its own box, walls of metal that glow each in its colour: every pixel shows
    what its mirrored ray hits, but for the blur of a texel at the walls' edges.
    """
    scene, lightmap = empty_room(side=2)
    colours = np.linspace(1, 2, 18).reshape(6, 3)[[3, 0, 5, 1, 4, 2]]
    metal = tuple(
        Material(f"wall {i}", (1.0, 1.0, 1.0), tuple(c), roughness=0.0, metalness=1.0)
        for i, c in enumerate(colours.tolist())
    )
    assert len(scene.triangles) == 12
    camera = (Camera((0.3, 1.1, 0.8), (-0.4, 1.3, -0.6), 75.0),)
    ids = np.repeat(np.arange(6, dtype=np.int32), 2)
    scene = replace(scene, materials=metal, material_ids=ids, cameras=camera)
    settings = {**SMALL, "map_texels": 48, "capture_texels": 64, "bounces": "1", "update": update,
                "gloss_steps": 4, "relit_share": 1.0}  # fmt: skip
    technique = create("light-field-probes", scene, settings, cache, lightmap=lightmap, image=IMAGE)
    if update == "relit":
        technique.begin_frame(0)
        for name in ("probe_relight", "filter_irradiance", "filter_distance", "prefilter"):
            run_pass(technique, name, 64)
        run_pass(technique, "border_copy", 64)
    found = technique.images()["indirect only"].reshape(-1, 3)
    certain, d, at, _ = seen(scene, IMAGE)
    mirrored = d - 2 * np.einsum("nx,nx->n", d, at.normal)[:, None] * at.normal
    tracer = EmbreeTracer(scene.corners)

    def walls(start, along):
        return tracer.closest(start.astype(np.float32), along.astype(np.float32)).triangle // 2

    off = at.position + 1e-4 * at.geometric
    hits = tracer.closest(off.astype(np.float32), mirrored.astype(np.float32))
    place = at.position + hits.distance[:, None] * mirrored
    wall = hits.triangle // 2
    # Well within a wall as the probes see it: so is all around.
    for centre in technique.probes.baked.volume.positions:
        start = np.broadcast_to(centre, place.shape)
        d_own = place - centre
        d_own /= np.linalg.norm(d_own, axis=1, keepdims=True)
        for shift in np.vstack([np.eye(3), -np.eye(3)]) * 0.15:
            certain &= walls(start, d_own + shift) == wall
    assert certain.mean() > 0.1 and len(np.unique(wall[certain])) >= 3
    facing = np.abs(np.einsum("nx,nx->n", d, at.normal))
    expected = colours[wall] * table(facing, np.zeros(len(d))).sum(axis=1)[:, None]
    np.testing.assert_allclose(found[certain], expected[certain], rtol=4e-3)


@pytest.mark.parametrize("variant", VARIANTS)
def test_no_surface_sends_out_more_than_falls_on_it(soup, cache, variant):
    """Where light is 1 from all sides: white surfaces that are no metal send out 1, whatever their
    roughness, and no other more.
    """
    white = [
        replace(m, base_color=(1.0, 1.0, 1.0), texture=-1, metalness=0.0 if i else 0.7)
        for i, m in enumerate(soup.materials)
    ]
    scene = replace(soup, materials=tuple(white))
    settings = {**SMALL, "gloss_steps": 4, "storage": "fp32"}
    technique = create("irradiance-probes", scene, settings, cache, variant, image=IMAGE)
    held, device = technique.probes, technique.device
    data = device.read(held.placed.data)
    data[:, 3] = 3
    device.write(held.placed.data, data)
    device.write(held.irradiance, np.full(held.irradiance.shape, np.pi))
    device.write(held.lobes, np.ones(held.lobes.shape))
    found = technique.images()["indirect only"].reshape(-1, 3)
    certain, _, at, materials = seen(scene, IMAGE)
    certain &= within_reach(technique, at.position, at.geometric)
    certain &= weights(technique, at.position, at.geometric).sum(axis=1) > 0
    plain = np.array([m.metalness == 0 for m in materials])
    assert (certain & plain).sum() > 30
    np.testing.assert_allclose(found[certain & plain], 1.0, rtol=1e-4)
    assert found.max() <= 1.0 + 1e-4


@pytest.mark.parametrize("name", NAMES)
def test_gloss_is_off_unless_asked_for(soup, cache, name):
    """And then there is a pass more, two buffers more, and another image."""
    images = {}
    for steps in (0, 4):
        technique = create(name, soup, {**SMALL, "gloss_steps": steps}, cache, image=IMAGE)
        names = [p.name for p in technique.passes()]
        assert ("prefilter" in names) == (steps > 0)
        assert ("lobe_maps" in technique.device.memory.allocated) == (steps > 0)
        technique.begin_frame(0)
        for one in names[:-2]:
            run_pass(technique, one, 64)
        images[steps] = technique.images()["indirect only"]
    assert np.abs(images[0] - images[4]).max() > 1e-3
