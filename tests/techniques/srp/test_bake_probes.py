from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.tiny_scenes import empty_room, quad_scene, room

from gibench.errors import BadInput
from gibench.rays.embree import EmbreeTracer
from gibench.scene.model import ProbeSettings
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.probes import mean_overlap, place_probes, support_radius, thin
from gibench.techniques.srp.bake.relight import relight_samples
from gibench.techniques.srp.bake.sampling import surface_points
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.voxels import voxelise

OFFSET = 1e-5


def place(scene, lightmap, count, seed=0):
    return place_probes(scene, lightmap, EmbreeTracer(scene.corners), count, 10.0, OFFSET, seed)


@pytest.mark.parametrize("open_top", [False, True])
@pytest.mark.parametrize("count", [3, 27])
def test_probes_lie_in_the_room_and_not_in_the_block(count, open_top):
    scene, lightmap = room(8, open_top)
    probes = place(scene, lightmap, count)
    p = probes.positions
    assert p.shape == (count, 3)
    assert len(np.unique(p, axis=0)) == count
    assert ((p > [-1, 0, -1.1]) & (p < [1, 2.4, 1.1])).all()
    assert not ((p > [-0.3, 0, -0.5]) & (p < [0.4, 0.9, 0.2])).all(axis=1).any()
    wanted = min(10, count)
    assert mean_overlap(probes, lightmap.receivers.position) == pytest.approx(wanted, rel=0.02)


def test_every_receiver_has_a_probe_it_can_use():
    scene, lightmap = room(6)
    for count, seed in ((6, 0), (12, 1), (27, 2)):
        probes = place(scene, lightmap, count, seed)
        tracer = EmbreeTracer(scene.corners)
        settings = SrpBakeSettings(sh_order=0, transport_rays=64)
        worker = TransportBaker(scene, lightmap, probes, settings, tracer, None).worker()
        rows = worker.rows(np.arange(len(lightmap.receivers), dtype=np.int32))
        # Floor texels that lie wholly under the block see nothing but its inside.
        x, y, z = lightmap.receivers.position.T
        half_x, half_z = 1 / 6, 1.1 / 6
        under = (y == 0) & (x - half_x > -0.3) & (x + half_x < 0.4)
        under &= (z - half_z > -0.5) & (z + half_z < 0.2)
        assert under.sum() == 1
        assert np.array_equal(rows.valid > 0, ~under)


def test_two_rooms_behind_a_wall_both_get_probes():
    """Visibility-blind density alone could starve the small room; coverage must not."""
    from support.tiny_scenes import box

    big, small = box((0, 0, 0), (3, 2, 3), True), box((3.2, 0, 0), (3.9, 0.8, 0.8), True)
    scene, lightmap = quad_scene(big + small, 6)
    probes = place(scene, lightmap, 8)
    inside_small = (probes.positions[:, 0] > 3.2).sum()
    assert 1 <= inside_small <= 4


def test_placement_repeats_for_a_seed():
    scene, lightmap = room(4)
    a, b = place(scene, lightmap, 9, 5), place(scene, lightmap, 9, 5)
    assert np.array_equal(a.positions, b.positions)
    assert a.radius == b.radius


def test_given_positions_are_taken_as_they_are():
    given = np.array([[0, 1.5, 0], [0.5, 1.5, 0.5]], np.float32)
    scene, lightmap = empty_room(3, probes=ProbeSettings(2, given))
    probes = place(scene, lightmap, None)
    assert np.array_equal(probes.positions, given)
    # Fewer probes than the overlap: every receiver is reached by all, with weight.
    reach = np.linalg.norm(lightmap.receivers.position[:, None] - given[None], axis=2)
    assert reach.max() < probes.radius
    for wrong in (np.full((2, 3), np.nan, np.float32), np.zeros((0, 3), np.float32)):
        with pytest.raises(BadInput):
            place(replace(scene, probes=ProbeSettings(2, wrong)), lightmap, None)


def test_a_scene_without_an_inside_is_bad_input():
    scene, lightmap = quad_scene([((0, 0, 0), (1, 0, 0), (0, 0, 1))], 2)  # faces down
    with pytest.raises(BadInput, match="fit for a probe"):
        place(scene, lightmap, 5_000_000)


def test_thinning_spreads_the_candidates():
    rng = np.random.default_rng(0)
    # Twice as dense on the left: thinning evens that out.
    points = rng.random((3000, 3)) * [1, 1, 1]
    points = np.concatenate([points, rng.random((3000, 3)) * [0.5, 1, 1]])
    kept = points[thin(points, 64, 0.25)]
    assert len(kept) == 64
    left = (kept[:, 0] < 0.5).sum()
    assert 24 <= left <= 40
    gaps = np.linalg.norm(kept[:, None] - kept[None], axis=2) + np.eye(64) * 9
    random = points[rng.choice(6000, 64, replace=False)]
    random_gaps = np.linalg.norm(random[:, None] - random[None], axis=2) + np.eye(64) * 9
    assert gaps.min(axis=1).min() > 2 * random_gaps.min(axis=1).min()


def test_radius_reaches_the_wanted_overlap():
    rng = np.random.default_rng(1)
    probes, receivers = rng.random((40, 3)), rng.random((500, 3)).astype(np.float32)
    for overlap in (1.0, 10.0, 25.0):
        radius = support_radius(probes.astype(np.float32), receivers, overlap)
        distance = np.linalg.norm(receivers[:, None] - probes[None], axis=2)
        assert (distance < radius).sum(axis=1).mean() == pytest.approx(overlap, rel=0.01)


@pytest.mark.parametrize("longest", [10, 33])
def test_voxels_seal_every_surface(longest):
    from scipy.ndimage import label

    scene, _ = room(2)
    voxels = voxelise(scene, longest)
    regions, count = label(~voxels.full)
    outside, inside = regions[0, 0, 0], _at(voxels, regions, (0.8, 1.8, 0.9))
    block = _at(voxels, regions, (0.05, 0.45, -0.15))
    assert count == 3
    assert len({outside, inside, block, 0}) == 4
    # Points of the surface lie in full voxels, whatever made them.
    points, _ = surface_points(room(3)[1].fragments, 50, np.random.default_rng(longest))
    index = ((points.reshape(-1, 3) - voxels.origin) / voxels.edge).astype(int)
    assert voxels.full[tuple(index.T)].mean() > 0.99


def _at(voxels, regions, point):
    return regions[tuple(((np.asarray(point) - voxels.origin) / voxels.edge).astype(int))]


@pytest.mark.parametrize("count", [1024, 1000, 8000])
def test_relight_samples_hit_the_texel_in_their_direction(count):
    scene, lightmap = room(5, open_top=True)
    probes = ProbeSet(np.array([[0.1, 1.6, 0.3], [-0.7, 0.2, 0.9]], np.float32), 2.0)
    samples = relight_samples(scene, lightmap, probes, EmbreeTracer(scene.corners), 3, count)
    assert samples.texel.shape == (2, count)
    assert samples.basis.shape == (count, 16)
    expected = sh_basis(3, samples.directions) * 4 * np.pi / count
    assert np.allclose(samples.basis, expected, atol=1e-6 / count)
    table = lightmap.receiver_of_texel
    for index, place_ in enumerate(probes.positions):
        texel = samples.texel[index]
        hit = texel >= 0
        assert (samples.directions[texel == -1][:, 1] > 0).all()  # only upwards is open
        assert (texel != -2).all()
        assert 0.02 < (texel == -1).mean() < 0.6
        receiver = table[texel[hit]]
        assert (receiver >= 0).all()
        # The texel's centre lies near the ray: within a texel's half diagonal.
        to = lightmap.receivers.position[receiver] - place_
        d = samples.directions[hit]
        off = np.linalg.norm(to - (to * d).sum(axis=1, keepdims=True) * d, axis=1)
        assert (off < 0.5 * np.hypot(2.4, 2.2) / 5 + 1e-4).all()


def test_probe_behind_everything_sees_black():
    scene, lightmap = empty_room(3)
    outside = ProbeSet(np.array([[0.0, 5.0, 0.0]], np.float32), 1.0)
    samples = relight_samples(scene, lightmap, outside, EmbreeTracer(scene.corners), 1, 400)
    assert set(np.unique(samples.texel)) == {-1, -2}
