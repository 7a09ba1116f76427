"""Every technique under materials that change: lamps are switched, walls painted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.made import made
from support.shading_oracle import open_device
from support.tiny_scenes import box, quad_scene

from gibench.conform import recolour
from gibench.device import list_devices
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.colours import Colours
from gibench.scene.model import Camera
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.parts.conformance.case import Bench
from gibench.techniques.parts.material_table import material_table
from gibench.techniques.parts.recolouring import Shares
from gibench.techniques.registry import BakeContext, find_technique, techniques
from gibench.techniques.technique import KnowsItsCover

SMALL = {
    "counts": "2x2x2", "rays": 96, "fixed_rays": 16, "hysteresis": 0.8, "surfels": 1500,
    "links": 30, "caches": 80, "relaxation": 1, "capture_texels": 12, "map_texels": 6,
    "relit_share": 1.0, "probes": 4, "relight_samples": 64, "transport_rays": 32,
    "cluster_size": 32, "sh_order": 2,
    "placement_chance": 1.0, "radius_share": 0.4, "grid_cells": 6, "rays_per_surfel": 8.0,
}  # fmt: skip
FRAMES = {"ddgi": 40, "gibs": 120}
# How near it comes to the room's light, and how dark a room is that was lit, as a share of that.
NEAR = {"ddgi": (0.03, 0.02), "gibs": (0.1, 0.1), "surfel-cache": (0.02, 1e-3), "srp": (0.08, 1e-5)}
# Light is linear in emission; what gathers over frames has not forgotten the light before.
LINEAR = {"ddgi": 0.03, "gibs": 0.1}
# Emission and albedo of all walls, from key to key: lit, doubled, switched off, painted.
KEYS = ((1.0, 0.5), (2.0, 0.5), (0.0, 0.5), (1.0, 0.2))


def furnace():
    """A closed room of one material, whose light is the same everywhere and in all directions:
    irradiance pi emission / (1 - albedo)."""
    scene, lightmap = quad_scene(box((-1, -1, -1), (1, 1, 1), inward=True), 4)
    camera = Camera((0.9, 0.9, 0.9), (0.0, 0.0, 0.0), fov_degrees=110)
    walls = replace(scene.materials[0], name="walls", emission=(1.0,) * 3)
    return replace(scene, materials=(walls,), cameras=(camera,)), lightmap


def set_up(name, scene, lightmap, changes, cache):
    spec = find_technique(name)
    known = {k: v for k, v in SMALL.items() if hasattr(spec.settings_type, k)}
    settings = spec.settings(known)
    baked = spec.bake(BakeContext(scene, lightmap, settings, cache))
    motion = MovingObjects.of(scene, changes)
    return made(spec, open_device(), scene, lightmap, settings, baked, "tuned", 64, 32, 24,
                scene.cameras[0], 3, None, motion)  # fmt: skip


@pytest.mark.parametrize("name", [n for n in techniques() if n != "direct"])
def test_switched_walls_light_a_closed_room(name, tmp_path):
    scene, lightmap = furnace()
    count = FRAMES.get(name, 20)
    emission, albedo = zip(*KEYS, strict=True)
    keyed = Colours(
        "walls", tuple(count * n for n in range(len(KEYS))),
        tuple((a,) * 3 for a in albedo), tuple((e,) * 3 for e in emission),
        of_material=True, step=True,
    )  # fmt: skip
    technique = set_up(name, scene, lightmap, [keyed], tmp_path)
    prepared = prepare_passes(technique, 64)
    found = []
    for frame in range(count * len(KEYS)):
        enqueue_frame(technique, prepared, frame)
        if (frame + 1) % count == 0:
            e = emission[frame // count]
            direct = technique.images()["direct only"]
            np.testing.assert_allclose(direct, np.full_like(direct, e), rtol=1e-6)
            light = np.array(technique.indirect_irradiance(), np.float64)
            if isinstance(technique, KnowsItsCover):
                light = light[technique.covered()]
            assert len(light) > 20
            found.append(light)
    near, dark = NEAR.get(name, (0.01, 1e-5))
    lit = np.pi * KEYS[1][0] / (1 - KEYS[1][1])
    for light, (e, a) in zip(found, KEYS, strict=True):
        assert light.mean() == pytest.approx(np.pi * e / (1 - a), rel=near, abs=dark * lit)
    assert found[1].mean() == pytest.approx(2 * found[0].mean(), rel=LINEAR.get(name, 2e-3))


def test_direct_light_shows_what_walls_send_out():
    scene, lightmap = furnace()
    spec = find_technique("direct")
    keyed = Colours("walls", (0, 10), (), ((1.0, 0.0, 3.0), (5.0, 2.0, 0.0)), of_material=True)
    motion = MovingObjects.of(scene, [keyed])
    technique = made(spec, open_device(), scene, lightmap, spec.settings({}), None, "tuned", 64,
                     32, 24, scene.cameras[0], motion=motion)  # fmt: skip
    prepared = prepare_passes(technique, 64)
    for frame in (3, 10, 0):
        enqueue_frame(technique, prepared, frame)
        image = technique.device.read(technique.scene.image)
        np.testing.assert_allclose(
            image, np.broadcast_to(keyed.at(frame)[1], image.shape), rtol=1e-6
        )


@pytest.mark.parametrize("size", [7, 64, 100])
@pytest.mark.parametrize("kind", recolour.KINDS)
def test_recolour_is_the_sum_of_shares(rng, kind, size):
    for off in recolour.recoloured(Bench(list_devices()[0]), rng, size, kind):
        assert off < 1


def test_a_surfel_or_captured_texel_keeps_its_image(rng):
    """Its share is its albedo over the material's; without an image, in all channels alike."""
    scene, _ = furnace()
    motion = MovingObjects.of(
        scene, [Colours("walls", (0, 2), ((0.2, 0.4, 0.8),) * 2, ((3.0,) * 3,) * 2, True)]
    )
    changing = motion.materials
    triangle = np.array([0, -1, 5, 7], np.int32)
    albedo = np.array([[0.5] * 3, [0.1] * 3, [0.25] * 3, [0.5] * 3])
    shares = Shares.of_triangles(scene, changing, triangle, albedo, np.ones((4, 3)))
    assert shares.places.tolist() == [0, 2, 3]
    np.testing.assert_allclose(shares.shares[:, :3], [[1] * 3, [0.5] * 3, [1] * 3])
    np.testing.assert_allclose(shares.shares[:, 3], [1, 0.5, 1])
    assert not shares.rest.any()
    table = material_table(changing.materials_in(scene, 0))[shares.rows]
    np.testing.assert_allclose(table[:, :3], [[0.2, 0.4, 0.8]] * 3)
