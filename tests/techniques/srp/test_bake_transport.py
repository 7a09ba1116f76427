"""Transport against float64 evaluation of eq. 4.12 of Bennett 2019, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from support.tiny_scenes import empty_room, quad_scene, room
from support.vector_widths import widths

from gibench.rays.embree import EmbreeTracer
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.transport import CHUNK_RAYS, TransportBaker
from gibench.techniques.srp.bake.visibility import visibility_tables
from gibench.techniques.srp.bake.weights import spatial_weight
from gibench.techniques.srp.conform_bake_oracle import brute_force

PROBES = np.array(
    [[-0.8, 0.4, -0.8], [0.7, 0.3, 0.8], [0.0, 1.7, 0.1], [0.75, 1.5, -0.9], [-0.7, 2.1, 0.7]],
    np.float32,
)


def baker_of(
    scene,
    lightmap,
    probes,
    visibility="exact",
    seed=0,
    vector=None,
    chunk_rays=CHUNK_RAYS,
    **settings,
):
    settings = SrpBakeSettings(**{"least_valid": 0.0, **settings}, visibility=visibility)
    tracer = EmbreeTracer(scene.corners, threads=1)
    tables = None
    if visibility == "cached":
        tables = visibility_tables(scene, lightmap, probes, tracer, 1e-5, seed)
    return TransportBaker(
        scene, lightmap, probes, settings, tracer, tables, seed, chunk_rays, vector=vector
    )


@pytest.mark.parametrize(
    ("vector", "order", "rays", "open_top"),
    widths(
        (None, 7, 256, False),
        (16, 7, 200, True),
        (4, 2, 77, True),
        (1, 0, 1, False),
        (8, 5, 130, True),
    ),
)
def test_transport_is_the_direct_evaluation_in_float64(order, rays, vector, open_top):
    scene, lightmap = room(4, open_top)
    probes = ProbeSet(PROBES, 2.4)
    baker = baker_of(
        scene, lightmap, probes, vector=vector, sh_order=order, transport_rays=rays, seed=order
    )
    chosen = np.random.default_rng(rays).choice(len(lightmap.receivers), 24, replace=False)
    receivers = np.sort(chosen).astype(np.int32)
    worker = baker.worker()
    rows = worker.rows(receivers)
    sample = worker.primary_rays(receivers)
    matrix = rows.matrix.reshape(len(receivers), len(rows.probes), -1)
    got = np.zeros((len(receivers), len(PROBES), (order + 1) ** 2))
    got[:, rows.probes] = matrix
    compared = 0
    for i, receiver in enumerate(receivers):
        direct = brute_force(
            scene,
            probes,
            lightmap.receivers.position[receiver].astype(np.float64),
            sample.origins[i],
            sample.directions[i],
            order,
        )
        if direct is None:
            continue
        compared += 1
        expected, valid = direct
        assert rows.valid[i] == valid
        assert np.abs(got[i] - expected).max() <= 1e-5 * max(np.abs(expected).max(), 1.0)


@pytest.mark.parametrize(
    ("vector", "order", "rays", "open_top"),
    widths((None, 4, 256, False), (16, 2, 77, True), (4, 0, 1, False), (1, 3, 130, True)),
)
def test_order_1_is_the_direct_evaluation_in_float64(rng, order, rays, vector, open_top):
    """Equation 8 of Silvennoinen and Lehtinen 2017, convolved with the cosine."""
    scene, lightmap = room(4, open_top)
    probes = ProbeSet(PROBES, 2.4)
    baker = baker_of(
        scene, lightmap, probes, vector=vector, sh_order=order, transport_rays=rays,
        receiver_order=1, seed=int(rng.integers(1000)),
    )  # fmt: skip
    chosen = rng.choice(len(lightmap.receivers), 10, replace=False)
    receivers = np.sort(chosen).astype(np.int32)
    worker = baker.worker()
    rows = worker.rows(receivers)
    sample = worker.primary_rays(receivers)
    got = np.zeros((len(receivers), 4, len(PROBES), (order + 1) ** 2))
    got[:, :, rows.probes] = rows.matrix.reshape(len(receivers), 4, len(rows.probes), -1)
    compared = 0
    for i, receiver in enumerate(receivers):
        direct = brute_force(
            scene, probes, lightmap.receivers.position[receiver].astype(np.float64),
            sample.origins[i], sample.directions[i], order,
            normal=lightmap.receivers.normal[receiver].astype(np.float64),
        )  # fmt: skip
        if direct is None:
            continue
        compared += 1
        expected, valid = direct
        assert rows.valid[i] == valid
        assert np.abs(got[i] - expected).max() <= 1e-5 * max(np.abs(expected).max(), 1.0)
    assert compared


def test_rays_of_order_1_are_distributed_by_its_weight():
    """Density (1 + 2 c) / 4 pi: E[c] = 7/12, E[c^2] = 5/12, E[direction] = 7/12 normal."""
    scene, lightmap = room(4)
    worker = baker_of(
        scene, lightmap, ProbeSet(PROBES, 2.0), transport_rays=4096, receiver_order=1
    ).worker()
    receivers = np.arange(0, len(lightmap.receivers), 29, dtype=np.int32)
    rays = worker.primary_rays(receivers)
    normal = lightmap.receivers.normal[receivers].astype(np.float64)
    cosine = np.einsum("nsx,nx->ns", rays.directions, normal)
    assert cosine.min() >= 0
    assert np.allclose((rays.directions.astype(np.float64) ** 2).sum(axis=2), 1, atol=1e-5)
    assert np.allclose(cosine.mean(axis=1), 7 / 12, atol=2e-3)
    assert np.allclose((cosine**2).mean(axis=1), 5 / 12, atol=2e-3)
    assert np.allclose(rays.directions.mean(axis=1), 7 / 12 * normal, atol=4e-3)


def test_uniform_radiance_in_order_1():
    """pi L at a receiver's own normal n, exactly; at any other normal m the order-1 irradiance of a
    lit hemisphere, pi L (1 + n m) / 2, within what the rays' noise leaves.
    """
    scene, lightmap = empty_room(4)
    baker = baker_of(
        scene, lightmap, ProbeSet(PROBES, 3.0), sh_order=1, transport_rays=1024, receiver_order=1
    )
    rows = baker.worker().rows(np.arange(0, len(lightmap.receivers), 7, dtype=np.int32))
    light = np.zeros((len(rows.probes), 4))
    light[:, 0] = 0.7 * np.sqrt(4 * np.pi)
    found = (rows.matrix.astype(np.float64) @ light.ravel()).reshape(-1, 4)
    normal = lightmap.receivers.normal[::7]
    assert np.allclose(found[:, 0], np.pi * 0.7, rtol=2e-6)
    assert np.allclose(found[:, 1:], np.pi * 0.7 / 2 * normal, atol=0.01)


def test_order_1_beside_the_scalar_at_the_geometric_normal():
    """Under a sky of radiance a + b d, d the direction, an open receiver's irradiance is
    pi a + 2 pi / 3 b n; order 1 makes 7 pi / 12 of the latter, as it lacks the cosine's higher
    orders, and exactly that.
    """
    floor = [((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))]
    scene, lightmap = quad_scene(floor, 2, sky=(1.0, 1.0, 1.0))
    probes = ProbeSet(np.array([[0.2, 0.1, 0.5], [-0.5, 0.3, 0.8]], np.float32), 3.0)
    a, b = 1.3, np.array([0.4, -0.2, 0.7])
    light = np.array([a * np.sqrt(4 * np.pi), *(np.sqrt(4 * np.pi / 3) * b[[1, 2, 0]])])
    expected = {0: [np.pi * a + 2 * np.pi / 3 * b[2]]}
    # Of a + b d over the hemisphere, half its integral with the direction.
    x, y, z = np.pi / 3 * b
    expected[1] = [np.pi * a + 7 * np.pi / 12 * b[2], x, y, z + np.pi / 2 * a]
    for order, values in expected.items():
        baker = baker_of(
            scene, lightmap, probes, sh_order=1, transport_rays=4096, receiver_order=order
        )
        rows = baker.worker().rows(np.arange(4, dtype=np.int32))
        found = rows.matrix.astype(np.float64) @ np.concatenate([light, light])
        assert np.allclose(found.reshape(4, -1), values, atol=6e-3)


def test_rays_are_cosine_weighted_and_start_all_over_the_texel():
    scene, lightmap = room(4)
    worker = baker_of(scene, lightmap, ProbeSet(PROBES, 2.0), transport_rays=4096).worker()
    receivers = np.arange(0, len(lightmap.receivers), 13, dtype=np.int32)
    rays = worker.primary_rays(receivers)
    normal = lightmap.receivers.normal[receivers].astype(np.float64)
    cosine = np.einsum("nsx,nx->ns", rays.directions, normal)
    assert cosine.min() >= 0
    # With density cos / pi: E[cos] = 2/3, E[cos^2] = 1/2, E[direction] = 2/3 normal.
    assert np.allclose(cosine.mean(axis=1), 2 / 3, atol=2e-3)
    assert np.allclose((cosine**2).mean(axis=1), 1 / 2, atol=2e-3)
    assert np.allclose(rays.directions.mean(axis=1), 2 / 3 * normal, atol=4e-3)
    centre = lightmap.receivers.position[receivers]
    assert np.allclose(rays.origins.mean(axis=1), centre, atol=2e-3)
    # Uniform on a rectangle a x b: E|x - centre|^2 = (a^2 + b^2) / 12; here from the fragments.
    spread = ((rays.origins - centre[:, None]) ** 2).sum(axis=2).mean(axis=1)
    start = lightmap.fragments.start[receivers]
    corner = lightmap.fragments.corners[start].astype(np.float64)
    diagonal = ((corner[:, 2] - corner[:, 0]) ** 2).sum(axis=1)
    assert np.allclose(spread, diagonal / 12, rtol=0.02)


@pytest.mark.parametrize("visibility", ["exact", "cached"])
@pytest.mark.parametrize("order", [0, 3, 7])
def test_uniform_radiance_in_a_closed_room_gives_pi_l(order, visibility):
    scene, lightmap = empty_room(4)
    probes = ProbeSet(PROBES, 3.0)
    baker = baker_of(scene, lightmap, probes, visibility, sh_order=order, transport_rays=64)
    rows = baker.worker().rows(np.arange(len(lightmap.receivers), dtype=np.int32))
    assert (rows.valid == 64).all()
    c = (order + 1) ** 2
    light = np.zeros((len(rows.probes), c))
    light[:, 0] = 0.7 * np.sqrt(4 * np.pi)  # the projection of the constant 0.7
    irradiance = rows.matrix.astype(np.float64) @ light.ravel()
    assert np.allclose(irradiance, np.pi * 0.7, rtol=2e-6)


def test_sky_over_a_plane_is_the_projection_of_the_cosine():
    """An unobstructed receiver that looks up z: alpha_j sums to the cosine lobe's coefficients,
    pi, 2 pi / 3, pi / 4 and 0 for degrees 0 to 3 times sqrt((2 l + 1) / 4 pi) (Ramamoorthi and
    Hanrahan 2001, eq. 8)."""
    floor = [((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))]
    scene, lightmap = quad_scene(floor, 2, sky=(1.0, 1.0, 1.0))
    probes = ProbeSet(np.array([[0.2, 0.1, 0.5], [-0.5, 0.3, 0.8]], np.float32), 3.0)
    for visibility in ("exact", "cached"):
        baker = baker_of(scene, lightmap, probes, visibility, sh_order=3, transport_rays=4096)
        rows = baker.worker().rows(np.arange(4, dtype=np.int32))
        total = rows.matrix.reshape(4, 2, 16).sum(axis=1)
        expected = np.zeros(16)
        for degree, lobe in enumerate((np.pi, 2 * np.pi / 3, np.pi / 4, 0.0)):
            zonal = np.sqrt((2 * degree + 1) / (4 * np.pi))
            expected[degree * (degree + 1)] = lobe * zonal
        assert np.allclose(total, expected, atol=4e-3)


def test_only_valid_samples_are_averaged():
    """A probe that sees half of what the receiver sees leaves the mean over that half."""
    scene, lightmap = empty_room(4)
    screen = [((-0.9, 0.0, 0.0), (0.0, 2.4, 0.0), (0.0, 0.0, 1.1))]
    behind = [((-0.9, 0.0, 0.0), (0.0, 0.0, 1.1), (0.0, 2.4, 0.0))]
    quads_scene, lightmap = quad_scene(_quads_of(scene) + screen + behind, 4)
    probes = ProbeSet(PROBES[:1], 4.0)
    rows = (
        baker_of(quads_scene, lightmap, probes, transport_rays=256)
        .worker()
        .rows(np.arange(len(lightmap.receivers), dtype=np.int32))
    )
    partly = (rows.valid > 0) & (rows.valid < 256)
    assert partly.sum() > 20
    irradiance = rows.matrix[:, 0].astype(np.float64) * np.sqrt(4 * np.pi)
    assert np.allclose(irradiance[rows.valid > 0], np.pi, rtol=2e-6)
    assert not rows.matrix[rows.valid == 0].any()


def _quads_of(scene):
    corners = scene.positions.reshape(-1, 4, 3).astype(float)
    return [(tuple(c[0]), tuple(c[1] - c[0]), tuple(c[3] - c[0])) for c in corners]


def test_cached_visibility_agrees_with_exact():
    scene, lightmap = room(16, open_top=True)
    probes = ProbeSet(PROBES, 2.4)
    receivers = np.arange(0, len(lightmap.receivers), 5, dtype=np.int32)
    exact, cached = (
        baker_of(scene, lightmap, probes, v, transport_rays=256).worker()
        for v in ("exact", "cached")
    )
    a, b = exact.rows(receivers), cached.rows(receivers)
    assert cached.clock.counts["visibility rays"] < 0.5 * exact.clock.counts["visibility rays"]
    decisions = exact.decisions(receivers)
    assert (decisions != cached.decisions(receivers)).mean() < 1e-3
    # The Monte Carlo error itself, from another sample set.
    other = baker_of(scene, lightmap, probes, transport_rays=256, seed=9).worker().rows(receivers)
    noise = np.linalg.norm(other.matrix - a.matrix)
    assert np.linalg.norm(b.matrix - a.matrix) < 0.05 * noise


def test_chunks_and_workers_do_not_change_a_bit():
    scene, lightmap = room(4)
    probes = ProbeSet(PROBES, 2.0)
    receivers = np.arange(len(lightmap.receivers), dtype=np.int32)
    rows = [
        baker_of(scene, lightmap, probes, transport_rays=60, chunk_rays=n).worker().rows(receivers)
        for n in (1, 1000, 1 << 19)
    ]
    assert np.array_equal(rows[0].matrix, rows[1].matrix)
    assert np.array_equal(rows[0].matrix, rows[2].matrix)
    other = baker_of(scene, lightmap, probes, transport_rays=60, seed=1).worker().rows(receivers)
    assert not np.array_equal(rows[0].matrix, other.matrix)


def test_receivers_with_hardly_a_valid_sample_stay_dark():
    scene, lightmap = room(4)
    probes = ProbeSet(PROBES[:2], 2.6)
    receivers = np.arange(len(lightmap.receivers), dtype=np.int32)
    every = baker_of(scene, lightmap, probes, transport_rays=64).worker().rows(receivers)
    cut = baker_of(scene, lightmap, probes, transport_rays=64, least_valid=0.5).worker()
    few = every.valid < 32
    assert 0 < few.sum() < len(receivers)
    rows = cut.rows(receivers)
    assert np.array_equal(rows.valid, np.where(few, 0, every.valid))
    assert np.array_equal(rows.matrix, np.where(few[:, None], 0, every.matrix))


def test_weight_function():
    t = np.array([0.0, 0.25, 0.5, 1.0, 1.2])
    assert np.allclose(spatial_weight(t), [1.0, 2 / 64 - 3 / 16 + 1, 0.5, 0.0, 0.0])
