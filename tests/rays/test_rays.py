"""Both tracers against float64 brute force and against each other, on easy and hard rays."""

import numpy as np
import pytest
from support.rays_oracle import (
    AGREE,
    UNEXPLAINED,
    box,
    closest_float64,
    cosine_rays,
    differences,
    hard_rays,
    lifted,
    slivers,
    soup,
    sphere,
)

from gibench.device import Device
from gibench.errors import CannotRun
from gibench.profiles import load_profile
from gibench.rays.bvh import build_bvh
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.rays.embree import EmbreeTracer
from gibench.rays.tracer import Hits


def device_tracer(corners, profile="iphone7", **options):
    device = Device(load_profile(profile))
    return DeviceTracer(device, DeviceBvh.upload(device, build_bvh(corners)), **options)


# Rays aimed at nothing in particular: nothing but chance brings them within rounding of an edge.
PLAIN = ("random", "outside", "axis-parallel", "one zero component")
TRACERS = {"embree": EmbreeTracer, "device": device_tracer}


@pytest.fixture(params=sorted(TRACERS))
def tracer_of(request):
    return TRACERS[request.param]


def scene(name, rng):
    return {
        "soup": lambda: soup(300, rng),
        "box": lambda: np.concatenate([box((-1, -2, -3), (4, 3, 2)), box((0, -2, 0), (1, 1, 1))]),
        "slivers": lambda: slivers(200, rng),
        "one": lambda: soup(1, rng),
    }[name]()


@pytest.mark.parametrize("name", ["soup", "box", "slivers", "one"])
def test_closest_is_the_brute_force_one(rng, tracer_of, name):
    corners = scene(name, rng)
    tracer = tracer_of(corners)
    for kind, (o, d) in hard_rays(corners, 700, rng).items():
        got = tracer.closest(o, d)
        triangle, t, u, v = closest_float64(corners, o, d)
        why = differences(corners, o, d, got, Hits(triangle, t, u, v))
        assert not np.any(why == UNEXPLAINED), (kind, np.flatnonzero(why == UNEXPLAINED)[:5])
        if kind in PLAIN:
            assert np.count_nonzero(why) <= 1, kind
        if name == "slivers":
            continue  # barycentrics across 1 mm are worth little; the point they give is tested
        same = (got.triangle == triangle) & (triangle >= 0)
        if kind == "random":
            np.testing.assert_allclose(got.u[same], u[same], atol=2e-3)
            np.testing.assert_allclose(got.v[same], v[same], atol=2e-3)


def test_barycentrics_give_the_hit_point(rng, tracer_of):
    corners = soup(2000, rng)
    o, d = hard_rays(corners, 5000, rng)["random"]
    hits = tracer_of(corners).closest(o, d)
    hit = hits.triangle >= 0
    assert hit.mean() > 0.2
    c = corners[hits.triangle[hit]].astype(np.float64)
    u, v = hits.u[hit, None].astype(np.float64), hits.v[hit, None].astype(np.float64)
    there = c[:, 0] * (1 - u - v) + c[:, 1] * u + c[:, 2] * v
    along = o[hit] + d[hit].astype(np.float64) * hits.distance[hit, None]
    length = np.linalg.norm(d[hit], axis=1) * hits.distance[hit]
    assert (np.linalg.norm(there - along, axis=1) <= 1e-4 * np.maximum(length, 1.0)).mean() > 0.999
    assert np.all(np.isinf(hits.distance[~hit])) and np.all(hits.triangle[~hit] == -1)


@pytest.mark.parametrize("size", [32, 96, 160])
def test_device_agrees_with_embree(rng, size):
    """A hundred thousand rays of every kind, at sizes that do not divide their number."""
    corners = np.concatenate([soup(6000, rng, size=0.3), box((0, 0, 0), (10, 10, 10))])
    embree, device = EmbreeTracer(corners), device_tracer(corners, workgroup_size=size)
    kinds = hard_rays(corners, 2501, rng)
    for kind in ("from surfaces", "from corners"):
        kinds[f"{kind}, lifted"] = (lifted(*kinds[kind], 1e-3), kinds[kind][1])
    for kind, (o, d) in kinds.items():
        a, b = embree.closest(o, d), device.closest(o, d)
        why = differences(corners, o, d, a, b)
        assert not np.any(why == UNEXPLAINED), (kind, np.flatnonzero(why == UNEXPLAINED)[:5])
        if kind in PLAIN:
            assert np.count_nonzero(why != AGREE) <= 1, kind
        if kind == "grazing" or "lifted" in kind:
            assert np.count_nonzero(why != AGREE) <= 0.03 * len(o)
        assert np.array_equal(b.triangle >= 0, device.occluded(o, d)), kind
        assert np.array_equal(a.triangle >= 0, embree.occluded(o, d)), kind
        assert not np.any(b.distance == 0.0), kind  # Embree's interval includes 0, ours does not


def test_occluded_is_closest_within_the_distance(rng, tracer_of):
    corners = soup(3000, rng)
    tracer = tracer_of(corners)
    o, d = cosine_rays(corners, 20_000, rng)
    free = tracer.closest(o, d)
    limit = rng.uniform(0.0, 6.0, len(o)).astype(np.float32)
    hits = tracer.closest(o, d, limit)
    expected = free.distance < limit
    assert 0.1 < expected.mean() < 0.9
    assert np.array_equal(hits.triangle >= 0, expected)
    assert np.array_equal(hits.distance[expected], free.distance[expected])
    assert np.array_equal(tracer.occluded(o, d, limit), expected)
    assert np.array_equal(tracer.occluded(o, d, 2.5), free.distance < 2.5)


def test_the_interval_ends_before_its_limit(tracer_of):
    corners = np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]]], np.float32)
    o = np.array([[0.25, 0.25, 0.0], [0.25, 0.25, 1.5]], np.float32)
    d = np.array([[0, 0, 2], [0, 0, 2]], np.float32)
    tracer = tracer_of(corners)
    # The processor's approximate reciprocal decides the last bit of Embree's distance: 0.5 on Intel
    # and Zen 4, the number before it on Zen 3. That very distance is where the interval must end.
    met, missed = tracer.closest(o, d).distance
    assert missed == np.inf
    assert met == pytest.approx(0.5, rel=2.0**-23)
    assert tracer.closest(o, d, float(met)).triangle.tolist() == [-1, -1]
    assert not tracer.occluded(o, d, np.full(2, met, np.float32)).any()
    assert tracer.occluded(o, d, 0.50001).tolist() == [True, False]


def test_the_device_leaves_out_distance_zero():
    corners = np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]]], np.float32)
    o, d = np.array([[0.25, 0.25, 1.0]], np.float32), np.array([[0, 0.5, 2]], np.float32)
    tracer = device_tracer(corners)
    assert tracer.closest(o, d).triangle.tolist() == [-1]
    assert tracer.occluded(o, d).tolist() == [False]


def test_both_sides_are_hit(tracer_of):
    corners = np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]]], np.float32)
    o = np.array([[0.2, 0.3, 0], [0.2, 0.3, 2]], np.float32)
    d = np.array([[0, 0, 1], [0, 0, -1]], np.float32)
    hits = tracer_of(corners).closest(o, d)
    assert hits.triangle.tolist() == [0, 0]
    np.testing.assert_allclose(hits.u, 0.2, atol=1e-6)
    np.testing.assert_allclose(hits.v, 0.3, atol=1e-6)


@pytest.mark.parametrize("corners", [box((-1, -1, -1), (1, 1, 1)), sphere(40, 81)])
@pytest.mark.parametrize("aim", ["corners", "edges"])
def test_no_ray_slips_out_of_a_closed_mesh(rng, tracer_of, corners, aim):
    """Rays aimed at corners and along edges, where two or more triangles meet."""
    tracer = tracer_of(corners)
    c = corners.astype(np.float64)
    n = 40_000
    at = c[rng.integers(0, len(c), n)]
    k = rng.integers(0, 3, n)
    w = np.zeros((n, 1)) if aim == "corners" else rng.choice([0.25, 0.5, rng.random()], (n, 1))
    target = at[np.arange(n), k] * w + at[np.arange(n), (k + 1) % 3] * (1 - w)
    start = rng.uniform(-0.5, 0.5, (n, 3))
    start[: n // 4] = 0.0  # exactly symmetric, so that edge functions vanish exactly
    o, d = start.astype(np.float32), (target - start).astype(np.float32)
    slipped = np.count_nonzero(tracer.closest(o, d).triangle < 0)
    assert np.count_nonzero(~tracer.occluded(o, d)) == slipped
    # Embree's edge functions are fused, so their signs are consistent along an edge but not always
    # around a corner: measured here, 0.26 % of rays aimed at the corners of a sphere slip through.
    allowed = 0.01 * n if isinstance(tracer, EmbreeTracer) and aim == "corners" else 0
    assert slipped <= allowed


def test_no_rays_and_no_triangles(tracer_of):
    none = np.zeros((0, 3), np.float32)
    tracer = tracer_of(box())
    assert [len(a) for a in tracer.closest(none, none)] == [0, 0, 0, 0]
    assert len(tracer.occluded(none, none)) == 0
    empty = tracer_of(np.zeros((0, 3, 3), np.float32))
    o, d = np.zeros((5, 3), np.float32), np.ones((5, 3), np.float32)
    assert empty.closest(o, d).triangle.tolist() == [-1] * 5
    assert not empty.occluded(o, d).any()


def test_lengths_must_match(tracer_of):
    tracer = tracer_of(box())
    with pytest.raises(ValueError, match="3 origins but 2 directions"):
        tracer.closest(np.zeros((3, 3), np.float32), np.ones((2, 3), np.float32))
    with pytest.raises(ValueError, match="2 maximal distances"):
        tracer.occluded(
            np.zeros((3, 3), np.float32), np.ones((3, 3), np.float32), np.ones(2, np.float32)
        )


def test_chunks_do_not_change_the_answer(rng):
    corners = soup(500, rng)
    o, d = cosine_rays(corners, 5001, rng)
    limit = rng.uniform(1, 20, 5001).astype(np.float32)
    whole = device_tracer(corners).closest(o, d, limit)
    parts = device_tracer(corners, chunk_rays=1024).closest(o, d, limit)
    assert all(np.array_equal(a, b) for a, b in zip(whole, parts, strict=True))


def test_every_byte_is_counted(rng):
    corners = soup(500, rng)
    device = Device(load_profile("iphone7"))
    bvh = build_bvh(corners)
    tree = DeviceBvh.upload(device, bvh)
    assert device.memory.total_bytes == bvh.nbytes == sum(a.value.nbytes for a in tree.args)
    tracer = DeviceTracer(device, tree, chunk_rays=1000)
    assert device.memory.total_bytes == bvh.nbytes + 1000 * (12 + 12 + 4 + 16 + 1)
    tracer.release()
    assert device.memory.total_bytes == bvh.nbytes


def test_a_workgroup_the_profile_forbids_is_refused():
    with pytest.raises(CannotRun, match="work-group size 33"):
        device_tracer(box(), workgroup_size=33)


@pytest.mark.parametrize("name", ["soup", "box", "slivers"])
def test_packets_hit_what_single_rays_hit(rng, name):
    """Hard rays (most packets fall apart) and fans of coherent ones, at a count 16 divides not."""
    corners = scene(name, rng)
    single, packets = device_tracer(corners), device_tracer(corners, packets=True)
    kinds = {
        kind: rays for kind, rays in hard_rays(corners, 2501, rng).items() if "from" not in kind
    }
    kinds["fans"] = fans(corners, 500, rng)
    for kind, (o, d) in kinds.items():
        a, b = single.closest(o, d), packets.closest(o, d)
        why = differences(corners, o, d, a, b)
        assert not np.any(why == UNEXPLAINED), (kind, np.flatnonzero(why == UNEXPLAINED)[:5])
        if kind in (*PLAIN, "fans"):
            assert np.count_nonzero(why != AGREE) <= 2, kind
        assert np.array_equal(b.triangle >= 0, packets.occluded(o, d)), kind
        limit = rng.uniform(0.0, 1.0, len(o)).astype(np.float32)
        near = packets.closest(o, d, limit)
        assert np.array_equal(near.triangle >= 0, b.distance < limit), kind
        assert np.array_equal(packets.occluded(o, d, limit), b.distance < limit), kind


def fans(corners, count, rng):
    """Packets of 16 rays from one point within one narrow cone: what packets are for."""
    low, high = corners.min((0, 1)), corners.max((0, 1))
    eye = rng.uniform(low, high, (count, 1, 3)) + np.zeros((1, 16, 1))
    towards = rng.normal(size=(count, 1, 3)) + 0.01 * rng.normal(size=(count, 16, 3))
    return eye.reshape(-1, 3).astype(np.float32), towards.reshape(-1, 3).astype(np.float32)


def test_packets_leave_no_gap_in_a_closed_mesh(rng):
    corners = sphere(40, 81)
    tracer = device_tracer(corners, packets=True)
    corner = corners.reshape(-1, 3)[rng.integers(0, 3 * len(corners), 2000)]
    target = np.repeat(corner, 16, axis=0).astype(np.float64)
    target[rng.random(len(target)) < 0.5] += 1e-3 * rng.normal(size=3)
    d = target.astype(np.float32)
    o = np.zeros_like(d)
    assert np.all(tracer.closest(o, d).triangle >= 0)
    assert tracer.occluded(o, d).all()
