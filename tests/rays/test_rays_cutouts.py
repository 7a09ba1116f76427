"""Masked leaves against the same holes cut in the mesh, for every tracer."""

import numpy as np
import pytest
from support.cut_scenes import layers, leaves

from gibench.device import Device
from gibench.profiles import load_profile
from gibench.rays.bvh import build_bvh
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.rays.embree import EmbreeTracer, scene_tracer


def on_device(packets, size):
    def made(corners, cutouts):
        device = Device(load_profile("iphone7"))
        packed = None if cutouts is None else cutouts.packed(len(corners))
        tree = DeviceBvh.upload(device, build_bvh(corners), cutouts=packed)
        return DeviceTracer(device, tree, workgroup_size=size, packets=packets)

    return made


TRACERS = {
    "embree": lambda corners, cutouts: EmbreeTracer(corners, cutouts=cutouts),
    "single 64": on_device(False, 64),
    "single 32": on_device(False, 32),
    "packets 64": on_device(True, 64),
    "packets 128": on_device(True, 128),
}


@pytest.fixture(params=sorted(TRACERS))
def tracer_of(request):
    return TRACERS[request.param]


def bundles(rng, count):
    """Rays in all directions, and bundles of sixteen that start and head alike."""
    origins = rng.uniform(0.02, 0.98, (count, 3))
    directions = rng.normal(size=(count, 3))
    bundle = np.repeat(rng.uniform(0.02, 0.98, (count // 16, 3)), 16, axis=0)
    aim = np.repeat(rng.normal(size=(count // 16, 3)), 16, axis=0)
    origins = np.concatenate((origins, bundle))
    directions = np.concatenate((directions, aim + rng.normal(size=aim.shape) * 0.03))
    return origins.astype(np.float32), directions.astype(np.float32)


def near_an_edge(scene, o, d, cutouts):
    """Rays that pass a leaf within rounding of an edge of its texels, judged in float64."""
    found = np.zeros(len(o), bool)
    for row, triangle in enumerate(cutouts.triangle):
        a, b, c = scene.corners[triangle].astype(np.float64)
        n = np.cross(b - a, c - a)
        with np.errstate(all="ignore"):
            t = ((a - o) @ n) / (d @ n)
        p = o + t[:, None] * d - a
        u = np.cross(p, c - a) @ n / (n @ n)
        v = np.cross(b - a, p) @ n / (n @ n)
        inside = (u > -1e-3) & (v > -1e-3) & (u + v < 1 + 1e-3) & (t > -1e-3)
        uv = cutouts.uvs[row].astype(np.float64)
        at = (1 - u - v)[:, None] * uv[0] + u[:, None] * uv[1] + v[:, None] * uv[2]
        image = cutouts.images[cutouts.image[row]]
        at = at * image.shape[::-1]
        off = np.abs(at - np.round(at)).min(axis=1) < 2e-3
        grazing = np.abs(d @ n) < 0.02 * np.linalg.norm(n) * np.linalg.norm(d, axis=1)
        edge = np.minimum(np.minimum(u, v), 1 - u - v)
        found |= inside & (off | grazing | (np.abs(edge) < 1e-4) | (np.abs(t) < 1e-3))
    return found


@pytest.mark.parametrize("repeat", [1, 3])
def test_a_mask_is_a_hole_in_the_mesh(rng, tracer_of, repeat):
    both = leaves(rng, count=8, repeat=repeat)
    masked, meshed = both.masked, both.meshed
    tracer, truth = tracer_of(masked.corners, masked.cutouts), EmbreeTracer(meshed.corners)
    o, d = bundles(rng, 16000)
    sure = ~near_an_edge(masked, o, d, masked.cutouts)
    assert sure.mean() > 0.5
    got, expected = tracer.closest(o, d), truth.closest(o, d)
    leaf = np.append(both.leaf_of[0], -2)[got.triangle]
    of_mesh = np.append(both.leaf_of[1], -2)[expected.triangle]
    other = np.flatnonzero(sure & (leaf != of_mesh))
    # What lies closer behind a hole than a ray steps past it is passed as well.
    assert len(other) <= 3
    np.testing.assert_allclose(got.distance[other], expected.distance[other], atol=1e-4)
    sure[other] = False
    assert (leaf[sure] >= 0).mean() > 0.04
    np.testing.assert_allclose(got.distance[sure], expected.distance[sure], rtol=1e-4, atol=1e-5)
    there = masked.corners[got.triangle[sure]].astype(np.float64)
    u, v = got.u[sure, None], got.v[sure, None]
    point = there[:, 0] * (1 - u - v) + there[:, 1] * u + there[:, 2] * v
    np.testing.assert_allclose(point, (o + got.distance[:, None] * d)[sure], atol=2e-5)
    for limit in (np.inf, 0.4, rng.uniform(0.05, 0.6, len(o)).astype(np.float32)):
        blocked = tracer.occluded(o, d, limit)
        np.testing.assert_array_equal(blocked[sure], truth.occluded(o, d, limit)[sure])
        nearest = tracer.closest(o, d, limit)
        np.testing.assert_array_equal(nearest.triangle[sure] >= 0, blocked[sure])


@pytest.mark.parametrize("gap", [1e-5, 0.01])
def test_many_holes_in_a_row(rng, tracer_of, gap):
    """A hundred layers are passed one by one, wherever the same texel is a hole in each."""
    mask = np.array([[True, False], [False, True]])
    corners, cutouts = layers(100, mask, gap)
    tracer = tracer_of(corners, cutouts)
    at = rng.uniform(0.02, 0.98, (500, 2))
    at = at[(np.abs(at - 0.5) > 1e-2).all(axis=1) & (np.abs(at[:, 0] - at[:, 1]) > 1e-2)]
    o = np.column_stack((at, np.full(len(at), -0.5))).astype(np.float32)
    d = np.broadcast_to(np.array((0, 0, 1), np.float32), o.shape)
    hits = tracer.closest(o, d)
    there = (at[:, 0] < 0.5) == (at[:, 1] > 0.5)  # row 0 is the top
    np.testing.assert_array_equal(hits.triangle // 2, np.where(there, 0, 100))
    np.testing.assert_allclose(hits.distance, np.where(there, 0.5, 0.5 + 100 * gap), rtol=1e-5)
    np.testing.assert_array_equal(tracer.occluded(o, d, 0.5 + 99.5 * gap), there)


def test_whole_triangles_are_hit_as_before(rng):
    """Beside cut-outs nothing moves: hits of whole triangles are the same to the bit."""
    both = leaves(rng)
    o, d = bundles(rng, 4000)
    walls = EmbreeTracer(both.masked.corners[:12])
    got, plain = scene_tracer(both.masked).closest(o, d), walls.closest(o, d)
    wall = got.triangle < 12
    for a, b in zip(got, plain, strict=True):
        np.testing.assert_array_equal(a[wall], b[wall])
    assert (got.distance <= plain.distance).all()


def test_the_rule_on_host_and_device(rng):
    """Each texel's middle, images repeating, with coordinates below 0."""
    mask = rng.random((7, 5)) < 0.5
    corners, cutouts = layers(1, mask, 1.0)
    shift = np.float32([-3, 2])
    moved = type(cutouts)(cutouts.images, cutouts.triangle, cutouts.image, cutouts.uvs + shift)
    rows, columns = np.indices(mask.shape).reshape(2, -1)
    at = np.column_stack(((columns + 0.51) / 5, 1 - (rows + 0.51) / 7))
    o = np.column_stack((at, np.full(len(at), -1))).astype(np.float32)
    d = np.broadcast_to(np.array((0, 0, 1), np.float32), o.shape)
    for name, made in TRACERS.items():
        hit = made(corners, moved).closest(o, d).triangle
        np.testing.assert_array_equal(hit < 2, mask.reshape(-1), err_msg=name)
