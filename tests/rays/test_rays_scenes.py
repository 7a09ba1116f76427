"""Both tracers on the real scenes: a million rays of every kind on Sponza."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from support.rays_oracle import (
    AGREE,
    REASONS,
    UNEXPLAINED,
    areas_of,
    cosine_rays,
    differences,
    hard_rays,
    lifted,
)

from gibench.device import Device
from gibench.profiles import load_profile
from gibench.rays.bvh import build_bvh
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.rays.embree import EmbreeTracer

SCENES = Path(
    os.environ.get("GIBENCH_SCENES", Path(__file__).resolve().parents[3] / "shared" / "scenes")
)


def corners_of(file):
    path = SCENES / file
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    mesh = trimesh.load(path, force="mesh", process=False, skip_materials=True)
    corners = np.asarray(mesh.triangles, np.float32)
    return corners[areas_of(corners)[0] > 0]


def compare(corners, rays_of_a_kind, rng):
    """Trace every kind by both; differences counted by kind and reason, printed (pytest -s)."""
    device = Device(load_profile("radeon560"))
    tracer = DeviceTracer(device, DeviceBvh.upload(device, build_bvh(corners)))
    packets = DeviceTracer(device, tracer.device_bvh, name="packets", packets=True)
    embree = EmbreeTracer(corners)
    kinds = hard_rays(corners, rays_of_a_kind, rng)
    # Most rays that start on a surface are excused for hitting it; a millimetre on, none is.
    for kind in ("from surfaces", "from corners"):
        kinds[f"{kind}, lifted"] = (lifted(*kinds[kind], 1e-3), kinds[kind][1])
    kinds["cosine"] = cosine_rays(corners, rays_of_a_kind, rng)
    counts = {}
    for kind, (o, d) in kinds.items():
        a, b = embree.closest(o, d), tracer.closest(o, d)
        why = differences(corners, o, d, a, b)
        counts[kind] = np.bincount(why, minlength=len(REASONS))
        listed = ", ".join(f"{n} {REASONS[i]}" for i, n in enumerate(counts[kind]) if n)
        print(f"{kind}: {listed}")
        assert np.array_equal(b.triangle >= 0, tracer.occluded(o, d)), kind
        together = differences(corners, o, d, b, packets.closest(o, d))
        assert not np.any(together == UNEXPLAINED), kind
        assert np.array_equal(a.triangle >= 0, embree.occluded(o, d)), kind
    return counts


@pytest.mark.parametrize(
    "file", ["cornell_box/mcguire/CornellBox-Sphere.obj", "sponza_crytek/sponza.obj"]
)
def test_hard_rays_agree(rng, file):
    counts = compare(corners_of(file), 2000, rng)
    assert not any(c[UNEXPLAINED] for c in counts.values())


@pytest.mark.slow
def test_a_million_rays_agree_on_sponza(rng):
    each = 75_000
    counts = compare(corners_of("sponza_crytek/sponza.obj"), each, rng)
    assert sum(int(c.sum()) for c in counts.values()) >= 1_000_000
    assert not any(c[UNEXPLAINED] for c in counts.values())
    # Aimed at nothing in particular, they differ about never.
    for kind in ("random", "outside", "one zero component", "cosine"):
        assert each - counts[kind][AGREE] <= 30, kind
