"""Rays per second on the real Sponza: Embree and the device, two threads each, in alternation.

Run with ``pytest tests/benchmarks/bench_rays.py --benchmark-enable -s``. The first test prints the
medians of alternating rounds, which is what to quote; the others keep pytest-benchmark's history.
"""

import os
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gibench.device import Device
from gibench.profiles import load_profile
from gibench.rays.bvh import build_bvh
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.rays.embree import EmbreeTracer

SCENES = Path(
    os.environ.get("GIBENCH_SCENES", Path(__file__).resolve().parents[3] / "shared" / "scenes")
)
ROUNDS = 7
SUN = np.array([0.25, 1.0, 0.15])


@pytest.fixture(scope="module")
def corners():
    path = SCENES / "sponza_crytek" / "sponza.obj"
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    mesh = trimesh.load(path, force="mesh", process=False, skip_materials=True)
    found = np.asarray(mesh.triangles, np.float32)
    return found[np.linalg.norm(normals_of(found), axis=1) > 0]


@pytest.fixture(scope="module")
def tracers(corners):
    device = Device(load_profile("radeon560"))
    tree = DeviceBvh.upload(device, build_bvh(corners))
    packets = DeviceTracer(device, tree, name="packets", packets=True)
    return EmbreeTracer(corners, threads=2), DeviceTracer(device, tree), packets


def normals_of(corners):
    c = corners.astype(np.float64)
    return np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])


def surface(corners, n, rng):
    normal = normals_of(corners)
    area = np.linalg.norm(normal, axis=1)
    i = rng.choice(len(corners), n, p=area / area.sum())
    u = rng.random((n, 2))
    u = np.where(u.sum(axis=1, keepdims=True) > 1, 1 - u, u)
    c = corners[i].astype(np.float64)
    point = c[:, 0] + (c[:, 1] - c[:, 0]) * u[:, :1] + (c[:, 2] - c[:, 0]) * u[:, 1:]
    return point, normal[i] / area[i, None]


def incoherent(corners, n=524_288):
    """Cosine-distributed rays from random points of the surface."""
    rng = np.random.default_rng(1)
    point, normal = surface(corners, n, rng)
    d = rng.normal(size=(n, 3))
    d = normal + d / np.linalg.norm(d, axis=1, keepdims=True)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return (point + 1e-4 * normal).astype(np.float32), d.astype(np.float32)


def primary(width=1334, height=750):
    """A camera in the nave, rays row by row."""
    eye, target = np.array([-8.0, 2.0, -0.3]), np.array([4.0, 3.0, 0.4])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    tan = np.tan(np.radians(30.0))
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * tan * width / height
    y = (1 - (np.arange(height) + 0.5) / height * 2) * tan
    d = forward + x[None, :, None] * right + y[:, None, None] * up
    d = d.reshape(-1, 3).astype(np.float32)
    return np.broadcast_to(eye.astype(np.float32), d.shape).copy(), d


def shadow(corners, embree):
    """Rays towards the sun from what the camera sees, in the camera's order."""
    o, d = primary()
    hits = embree.closest(o, d)
    found = hits.triangle >= 0
    normal = normals_of(corners)[hits.triangle[found]]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= -np.sign((normal * d[found]).sum(1))[:, None]
    point = o[found] + d[found].astype(np.float64) * hits.distance[found, None] + 1e-3 * normal
    point = point[(normal @ SUN) > 0]
    sun = np.broadcast_to((SUN / np.linalg.norm(SUN)).astype(np.float32), point.shape)
    return point.astype(np.float32), sun.copy()


def rays_of(kind, corners, embree):
    if kind == "incoherent":
        return incoherent(corners)
    return primary() if kind == "primary" else shadow(corners, embree)


@pytest.mark.slow
def test_the_device_reaches_half_of_embrees_rate(corners, tracers):
    """Incoherent rays, both on two threads, in one run."""
    embree, device, packets = tracers
    ratios = {}
    for kind in ("incoherent", "primary", "shadow"):
        o, d = rays_of(kind, corners, embree)
        for query in ("closest", "occluded"):
            times = np.empty((ROUNDS, 3))
            for r in range(ROUNDS):
                start = time.perf_counter()
                getattr(embree, query)(o, d)
                times[r, 0] = time.perf_counter() - start
                getattr(device, query)(o, d)
                times[r, 1] = device.kernel_seconds
                getattr(packets, query)(o, d)
                times[r, 2] = packets.kernel_seconds
            host, dev, together = np.median(times, axis=0)
            ratios[kind, query] = host / dev
            print(
                f"{kind} {query}: Embree {len(o) / host / 1e6:.2f} Mrays/s, "
                f"device {len(o) / dev / 1e6:.2f}, ratio {host / dev:.2f}; "
                f"packets {len(o) / together / 1e6:.2f}, ratio {host / together:.2f}"
            )
    assert ratios["incoherent", "closest"] >= 0.5
    assert ratios["incoherent", "occluded"] >= 0.5


@pytest.mark.parametrize("query", ["closest", "occluded"])
@pytest.mark.parametrize("kind", ["incoherent", "primary", "shadow"])
@pytest.mark.parametrize("which", ["embree", "device", "packets"])
def test_rate(benchmark, corners, tracers, which, kind, query):
    embree = tracers[0]
    o, d = rays_of(kind, corners, embree)
    tracer = dict(zip(("embree", "device", "packets"), tracers, strict=True))[which]
    benchmark.group = f"{kind} {query}"
    benchmark.extra_info["rays"] = len(o)
    benchmark.pedantic(getattr(tracer, query), args=(o, d), rounds=3, warmup_rounds=1)


def test_build(benchmark, corners):
    bvh = benchmark.pedantic(build_bvh, args=(corners,), rounds=1)
    assert bvh.triangle_count == len(corners)
