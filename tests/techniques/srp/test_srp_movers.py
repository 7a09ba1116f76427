"""SRP where something moves: blocked relight rays, the probes' light on what moves, the bake."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.launches import run_pass
from support.made import check_memory
from support.moving_scenes import (
    LEFT,
    RIGHT,
    UNDER_THE_LAMP,
    furnished_room,
    jump,
    shaded_room,
)
from support.shading_oracle import direct_irradiance, open_device
from support.srp_setups import SETTINGS, VARIANTS, create
from support.synthetic_bake import random_bake, random_lightmap
from support.tiny_scenes import box, quad_scene

from gibench.errors import BadInput
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.rays.embree import EmbreeTracer
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import Turn
from gibench.techniques.parts.conformance.synthetic import random_motion
from gibench.techniques.parts.frame_passes import frame_passes
from gibench.techniques.parts.octahedral_maps import octahedral_decode
from gibench.techniques.registry import BakeContext
from gibench.techniques.srp import SPEC
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.conform_oracle import LitPoints, probe_light, randomise
from gibench.techniques.srp.probe_light import DEPTH_SIDE, probe_depths
from gibench.techniques.srp.resting import resting_lightmap, resting_scene
from gibench.techniques.srp.turns import ProbeTurns

SIZES = [(7, "published"), (64, "wide"), (100, "simt"), (16, "tuned")]


def moving_room(rng, order=3, samples=90, variant="tuned", size=64, settings=None):
    """The furnished room with its boxes moving, and random probes, on a device."""
    scene = furnished_room()
    motion = MovingObjects.of(
        scene,
        [
            random_motion(n, rng, low=(-0.5, -0.1, -0.5), high=(0.5, 0.6, 0.5))
            for n in (LEFT, RIGHT)
        ],
    )
    lightmap = random_lightmap(rng, scene, 40, 20, 10)
    bake = random_bake(rng, lightmap, order=order, samples=samples)
    positions = rng.uniform((-1.8, 0.2, -1.3), (1.8, 1.8, 1.3), (11, 3)).astype(np.float32)
    bake = replace(bake, probes=ProbeSet(positions, 1.3))
    return (
        scene,
        motion,
        bake,
        create(bake, scene, lightmap, variant, size, settings, motion=motion),
    )


@pytest.mark.parametrize(("size", "variant"), SIZES)
def test_the_probes_light_anywhere(rng, size, variant):
    """Against float64. Left out: points where all probes in reach together weigh under a
    thousandth, of which single precision knows no three digits."""
    order = int(rng.integers(0, 8))
    _, _, bake, technique = moving_room(rng, order, 40, variant, size)
    radiance, maps = randomise(technique, bake, rng)
    points = LitPoints.at_random(technique, rng, (-2, 0, -1.5), (4, 2, 1.5))
    technique.device.enqueue(points.launch, size)
    found = technique.device.read(points.light)
    expected, weights, told = points.expected(bake, maps, radiance)
    assert told.mean() > 0.8 and (weights[told] == 0).any()
    np.testing.assert_allclose(found[told], expected[told], rtol=0, atol=2e-4 * expected.max())


def hits_of(scene, motion, bake, reach, frame):
    """The relight rays (p, s) that what moves blocks, what they hit, and which of that is sure."""
    there = motion.scene_in(scene, frame)
    moving = np.flatnonzero(motion.triangles)
    tracer = EmbreeTracer(there.corners[moving])
    probes, samples = reach.shape
    origins = np.repeat(bake.probes.positions, samples, axis=0)
    directions = np.tile(bake.relight.directions, (probes, 1))
    answers, rng = [], np.random.default_rng(3)
    for k in range(9):
        off = 2e-4 * rng.normal(size=directions.shape) * (k > 0)
        turned = (directions + off).astype(np.float32)
        hit = tracer.closest(origins, turned, np.ascontiguousarray(reach.ravel()))
        answers.append(hit)
    first = answers[0]
    sure = np.all([one.triangle == first.triangle for one in answers], axis=0)
    # A hit just before or behind what the ray met when it was baked.
    free = tracer.closest(origins, directions)
    with np.errstate(invalid="ignore"):  # a ray that escapes and meets nothing that moves
        sure &= ~(np.abs(free.distance - reach.ravel()) < 1e-3)
    triangle = np.where(first.triangle >= 0, moving[np.maximum(first.triangle, 0)], -1)
    return there, triangle, first, sure, directions


@pytest.mark.parametrize(("size", "variant"), SIZES)
@pytest.mark.parametrize("bounces", [True, False])
def test_what_blocked_rays_see(rng, size, variant, bounces):
    """Against float64 and Embree, but for rays near an edge of what moves or of a shadow."""
    scene, motion, bake, technique = moving_room(rng, 3, 90, variant, size, {"bounces": bounces})
    reach = rng.uniform(0.3, 3.0, (11, 90)).astype(np.float32)
    reach[rng.random(reach.shape) < 0.3] = np.inf
    technique.device.write(technique.movers.reach, reach)
    radiance, maps = randomise(technique, bake, rng)
    prepared = prepare_passes(technique, size)
    for frame in (1, 3):
        technique.begin_frame(frame)
        for item in prepared:
            if item.name in ("move_vertices", "refit_leaves", "refit_nodes", "refit_movers",
                             "blocked_rays"):  # fmt: skip
                for launch in item.launches:
                    launch.enqueue(technique.device.queue)
        found = technique.device.read(technique.movers.blocked).reshape(-1, 4)
        there, triangle, hit, sure, directions = hits_of(scene, motion, bake, reach, frame)
        blocked = triangle >= 0
        assert sure.mean() > 0.9 and 0.02 < blocked.mean() < 0.9
        np.testing.assert_array_equal(found[sure, 3] > 0, blocked[sure])
        assert not found[sure & ~blocked, :3].any()
        mine = np.flatnonzero(blocked & sure)
        corners = there.corners[triangle[mine]].astype(np.float64)
        u, v = hit.u[mine].astype(np.float64), hit.v[mine].astype(np.float64)
        weights = np.stack([1 - u - v, u, v], axis=1)
        position = np.einsum("nc,ncx->nx", weights, corners)
        geometric = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        geometric /= np.linalg.norm(geometric, axis=1, keepdims=True)
        normal = np.einsum(
            "nc,ncx->nx", weights, there.normals[there.triangles[triangle[mine]]].astype(np.float64)
        )
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        front = np.einsum("nx,nx->n", geometric, directions[mine]) < 0
        assert not found[mine[~front], :3].any()
        lit = direct_irradiance(there, frame, position, normal, geometric)
        irradiance, told = lit.irradiance, lit.certain & front
        if bounces:
            light, heavy = probe_light(bake, maps, radiance, position, normal)
            irradiance = irradiance + light
            told &= heavy > 1e-3
        albedo = np.array(
            [there.materials[m].base_color for m in there.material_ids[triangle[mine]]]
        )
        expected = albedo / np.pi * irradiance
        assert told.sum() > 10
        # As kernels shade points a little off the surface, they err near the lamp (0.6 m away).
        np.testing.assert_allclose(
            found[mine[told], :3], expected[told], rtol=1e-3, atol=2e-3 * expected[told].max()
        )


@pytest.mark.parametrize(("size", "variant"), SIZES)
def test_the_probes_take_what_blocked_rays_see(rng, size, variant):
    scene, _, bake, technique = moving_room(rng, 4, 90, variant, size)
    device, texels = technique.device, 200
    radiance = rng.uniform(0, 3, (texels, 3)).astype(np.float32)
    values = device.read(technique.variant.radiance)
    values[:texels, :3] = radiance
    device.write(technique.variant.radiance, values)
    blocked = rng.uniform(0, 3, (11, 90, 4)).astype(np.float32)
    blocked[..., 3] = rng.random((11, 90)) < 0.4
    device.write(technique.movers.blocked, blocked)
    run_pass(technique, "probe_update", size)
    relight = bake.relight
    seen = np.where(
        (relight.texel >= 0)[..., None],
        radiance[np.maximum(relight.texel, 0)],
        scene.environment.radiance(relight.directions),
    )
    seen[relight.texel == -2] = 0
    seen = np.where(blocked[..., 3:] > 0, blocked[..., :3], seen)
    assert ((relight.texel == -2) & (blocked[..., 3] > 0)).any()
    expected = np.einsum("psk,sj->pjk", seen, relight.basis.astype(np.float64))
    found = technique.variant.probe_radiance()
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-6 * np.abs(expected).max())


def test_how_far_a_probe_sees_in_a_box():
    scene, _ = quad_scene(box((-1, -1, -1), (1, 1, 1), inward=True), 2)
    probes = ProbeSet(np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.1]], np.float32), 1.0)
    found = probe_depths(probes, EmbreeTracer(scene.corners), 10.0)
    fine = 4 * DEPTH_SIDE
    at = (np.arange(fine) + 0.5) / fine * 2 - 1
    x, y = np.meshgrid(at, at)
    d = octahedral_decode(np.stack([x.ravel(), y.ravel()], axis=1))
    for number, position in enumerate(probes.positions.astype(np.float64)):
        with np.errstate(divide="ignore"):
            walls = np.where(
                d > 0, (1 - position) / d, np.where(d < 0, (-1 - position) / d, np.inf)
            )
        distance = walls.min(axis=1).reshape(DEPTH_SIDE, 4, DEPTH_SIDE, 4)
        inner = found[number, 1:-1, 1:-1]
        np.testing.assert_allclose(inner[..., 0], distance.mean(axis=(1, 3)), rtol=1e-5)
        np.testing.assert_allclose(inner[..., 1], (distance**2).mean(axis=(1, 3)), rtol=1e-5)
    # Beyond an edge the map goes on mirrored.
    np.testing.assert_array_equal(found[:, 0, 1:-1], found[:, 1, -2:0:-1])
    np.testing.assert_array_equal(found[:, 1:-1, -1], found[:, -2:0:-1, -2])
    sky = probe_depths(probes, EmbreeTracer(scene.corners + 100.0), 10.0)
    assert np.all(sky[..., 0] == 10.0)


def test_what_moves_is_no_part_of_the_bake():
    scene = furnished_room()
    lightmap = unwrap(scene, 200)
    moving = scene.object_numbers() == 1
    rests, there = resting_scene(scene, moving), resting_lightmap(lightmap, moving)
    low, high = rests.bounds
    np.testing.assert_array_equal([low, high], [scene.bounds[0], scene.bounds[1]])
    tracer = EmbreeTracer(rests.corners)
    origins = np.tile(np.float32([-0.9, 1.5, -0.5]), (200, 1))
    directions = np.random.default_rng(0).normal(size=(200, 3)).astype(np.float32)
    hit = tracer.closest(origins, directions).triangle
    assert (hit >= 0).all() and not moving[hit].any()
    assert np.isnan(there.triangle_uvs[moving]).all()
    np.testing.assert_array_equal(there.triangle_uvs[~moving], lightmap.triangle_uvs[~moving])
    assert not moving[there.fragments.triangle].any()
    assert np.diff(there.fragments.start).min() > 0
    kept = np.isin(lightmap.receivers.texel, there.receivers.texel)
    mover = MovingObjects.of(scene, [Turn(LEFT, (0, 1, 0))])
    np.testing.assert_array_equal(kept, ~mover.receivers(lightmap))
    with pytest.raises(BadInput, match="all of the scene 'test' moves"):
        resting_scene(scene, np.ones(len(scene.triangles), bool))


def in_the_shade(tmp_path, variant, jumps):
    """The room with the plate, which moves or rests where it goes, and the technique."""
    scene = shaded_room()
    lightmap = unwrap(scene, 240)
    motion = MovingObjects.of(scene, [jump("plate", UNDER_THE_LAMP, 24)])
    settings = SPEC.settings(
        {**SETTINGS, "transport_rays": 64, "relight_samples": 256, "probes": 12}
    )
    if jumps:
        context = BakeContext(scene, lightmap, settings, tmp_path, moving=motion.triangles)
    else:
        scene, lightmap = motion.scene_in(scene, 24), motion.lightmap_in(scene, lightmap, 24)
        context = BakeContext(scene, lightmap, settings, tmp_path)
    bake = SPEC.bake(context)
    values = {"transport_rays": 64, "relight_samples": 256, "probes": 12, "sh_order": 2}
    technique = create(bake, scene, lightmap, variant, 64, values, motion=motion if jumps else None)
    return technique, lightmap, motion


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_plate_under_the_lamp_darkens_the_room(tmp_path, variant):
    """Nearly as if it had been baked there; its own receivers are lit by the probes."""
    technique, lightmap, motion = in_the_shade(tmp_path, variant, jumps=True)
    prepared = prepare_passes(technique, 64)
    found = []
    for frame in range(48):
        enqueue_frame(technique, prepared, frame)
        if frame in (23, 47):
            found.append(technique.indirect_irradiance().astype(np.float64))
    lit, shaded = found
    baked, _, _ = in_the_shade(tmp_path, variant, jumps=False)
    prepared = prepare_passes(baked, 64)
    for frame in range(24, 48):
        enqueue_frame(baked, prepared, frame)
    expected = baked.indirect_irradiance().astype(np.float64)
    on_plate = motion.receivers(lightmap)
    assert 3 < on_plate.sum() < 40 and lit.shape == (len(on_plate), 3)
    room = ~on_plate
    assert shaded[room].mean() < 0.8 * lit[room].mean()
    assert shaded[room].mean() == pytest.approx(expected[room].mean(), rel=0.25)
    apart = np.linalg.norm(shaded[room] - expected[room])
    assert apart < 0.6 * np.linalg.norm(lit[room] - expected[room])
    assert (lit[on_plate] > 0).any() and np.isfinite(shaded).all()
    shares = technique.device.read(technique.movers.blocked)[..., 3].mean()
    assert 0.001 < shares < 0.3
    assert any("baked without the objects that move" in note for note in technique.notes())


def test_its_passes_and_memory_where_something_moves(tmp_path):
    technique, lightmap, motion = in_the_shade(tmp_path, "tuned", jumps=True)
    names = [item.name for item in frame_passes(technique)]
    assert names[:7] == [
        "move_vertices", "refit_leaves", "refit_nodes", "lightmap_update", "refit_movers",
        "blocked_rays", "probe_update",
    ]  # fmt: skip
    assert {
        "movers_nodes", "movers_triangles", "mover_triangle_slots", "mover_node_slots", "blocked",
        "relight_towards", "relight_reach", "probe_position", "probe_depth", "moving_vertices",
    } <= set(technique.device.memory.allocated)  # fmt: skip
    settings = SPEC.settings({"probes": 12, "relight_samples": 256, "sh_order": 2})
    check_memory(SPEC, technique, settings, "tuned", 64, len(lightmap.receivers), motion)


def test_probes_near_the_camera_take_more_turns(rng):
    device, probes = open_device(), 41
    positions = rng.uniform(-5, 5, (probes, 3)).astype(np.float32)
    turns = ProbeTurns(device, positions, 1.5, "nearest")
    distance = np.linalg.norm(positions.astype(np.float64), axis=1)
    slower = 1 + distance / 1.5
    last, taken = np.full(probes, -np.inf), np.zeros(probes, int)
    for frame in range(200):
        turns.begin_frame(frame, (0.0, 0.0, 0.0))
        told = device.read(turns.state)
        assert told[0] == turns.count() == 11
        assert np.array_equal(told[1:12], turns.chosen) and np.all(np.diff(turns.chosen) > 0)
        # The most overdue: none that is left out waits longer, by its own measure.
        overdue = (frame - last) / slower
        left = np.setdiff1d(np.arange(probes), turns.chosen)
        assert overdue[turns.chosen].min() >= overdue[left].max() - 1e-9
        last[turns.chosen] = frame
        taken[turns.chosen] += 1
        assert frame < 3 or np.isfinite(last).all()
    order = np.argsort(distance)
    assert taken[order[:10]].min() >= taken[order[-10:]].max()
    assert taken[order[0]] > 1.3 * taken[order[-1]]
