"""The built-in scenes: their sizes, their geometry, their receivers."""

from __future__ import annotations

from collections import Counter
from functools import lru_cache

import numpy as np
import pytest
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from gibench.errors import BadInput
from gibench.scene import builtin
from gibench.scene.lightmap import Lightmap
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.lightmap.charts import triangle_areas
from gibench.scene.model import DirectionalLight, Scene

# Triangles, probes, receivers (Bennett 2019, table 6.2).
SIZES = {
    "cornell-box": (94, 27, 40_564),
    "blue-orange-box": (96, 20, 50_784),
    "bumpy-box": (94, 27, 20_000),
    "glossy-box": (68, 27, 20_000),
    "sharp-bounce": (62, 12, 12_000),
    "two-rooms": (56, 40, 20_000),
    "two-rooms-gap": (64, 40, 20_000),
    "hall": (28_862, 108, 103_605),
    "atrium": (260_000, 160, 437_557),
    "hall-door": (28_874, 108, 20_000),
    # Generated kinds: they say nothing of probes (gibench/scene/defaults.py does).
    "church": (3_320, 100, 20_000),
    "maze": (680, 27, 28_000),
    "street": (1_044, 27, 20_000),
    "thin-house": (3_090, 100, 20_000),
    "big-hall": (696, 27, 20_000),
    "vase": (1_440, 27, 20_000),
}
KINDS = ("church", "maze", "street", "thin-house", "big-hall", "vase")
SUNLESS = ("sharp-bounce", "two-rooms", "two-rooms-gap", "maze", "big-hall")
# Those of many receivers: the atrium takes most of a minute on a busy core. Lightmaps of the hall
# are looked at in test_lightmap.py, of fewer.
UNWRAPPED = [
    pytest.param(name, marks=[pytest.mark.slow] if name in ("atrium", "hall", "hall-door") else [])
    for name in SIZES
]


@lru_cache
def built(name: str) -> Scene:
    return builtin.build(name)


@lru_cache(maxsize=1)
def unwrapped(name: str) -> Lightmap:
    return unwrap(built(name), built(name).receivers)


def face_normals(scene: Scene) -> np.ndarray:
    c = scene.corners.astype(np.float64)
    n = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def embree(scene: Scene) -> rtcore_scene.EmbreeScene:
    traced = rtcore_scene.EmbreeScene()
    TriangleMesh(traced, np.ascontiguousarray(scene.corners))
    return traced


def test_names():
    assert set(builtin.names()) == set(SIZES)
    with pytest.raises(BadInput, match="cornell-box"):
        builtin.build("sibenik")


@pytest.mark.parametrize("name", SIZES)
def test_sizes(name):
    scene = built(name)
    triangles, probes, receivers = SIZES[name]
    exact = triangles < 100
    assert len(scene.triangles) == pytest.approx(triangles, rel=0 if exact else 0.03)
    assert scene.probes.count == probes
    assert scene.receivers == receivers


@pytest.mark.parametrize("name", SIZES)
def test_scene_is_sound(name):
    scene = built(name)
    assert np.isfinite(scene.positions).all() and np.isfinite(scene.uvs).all()
    assert scene.triangles.max() < len(scene.positions)
    assert triangle_areas(scene.corners.astype(np.float64)).min() > 1e-10
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-5)
    agree = np.einsum("tci,ti->tc", scene.normals[scene.triangles], face_normals(scene))
    assert agree.min() > 0.2
    assert set(scene.material_ids) <= set(range(len(scene.materials)))
    np.testing.assert_array_equal(
        np.unique(scene.object_ids), np.arange(scene.object_ids.max() + 1)
    )
    for material in scene.materials:
        albedo = np.array(material.base_color)
        if material.texture >= 0:
            albedo = albedo * scene.textures[material.texture].pixels
        assert albedo.min() > 0.01 and albedo.max() <= 0.9
    assert len(scene.cameras) >= 2


@pytest.mark.parametrize("name", SIZES)
def test_same_scene_every_time(name):
    assert builtin.build(name).content_hash() == built(name).content_hash()


@pytest.mark.parametrize("name", [n for n in SIZES if n not in SUNLESS])
def test_sun_moves_and_reaches_the_scene(rng, name):
    """Every frame differs, and over the swing the sun lights a fair part of the surface."""
    scene = built(name)
    traced, normals = embree(scene), face_normals(scene)
    area = triangle_areas(scene.corners.astype(np.float64))
    chosen = rng.choice(len(area), 20_000, p=area / area.sum())
    b = rng.dirichlet([1, 1, 1], len(chosen))
    points = np.einsum("mk,mki->mi", b, scene.corners[chosen]) + 1e-3 * normals[chosen]
    period = next(x.period_frames for x in scene.lights if isinstance(x, DirectionalLight))
    directions, shares = [], []
    for frame in range(0, period, period // 8):
        (sun,) = scene.lights_at(frame)
        towards = -np.array(sun.direction)
        directions.append(tuple(sun.direction))
        facing = normals[chosen] @ towards > 0
        rays = np.tile(towards, (len(points), 1)).astype(np.float32)
        free = traced.run(points.astype(np.float32), rays, query="INTERSECT") < 0
        shares.append((facing & free).mean())
    assert len({tuple(np.round(d, 6)) for d in directions}) >= 5
    assert min(shares) > 0.01 and np.ptp(shares) > 0.002


@pytest.mark.parametrize("name", SIZES)
def test_cameras_see_fronts_only(rng, name):
    scene = built(name)
    traced, normals = embree(scene), face_normals(scene)
    for camera in scene.cameras:
        eye = np.array(camera.position)
        axis = np.array(camera.target) - eye
        axis /= np.linalg.norm(axis)
        spread = np.tan(np.radians(camera.fov_degrees) / 2)
        rays = axis + rng.uniform(-spread, spread, (20_000, 3))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        hit = traced.run(np.tile(eye, (len(rays), 1)).astype(np.float32), rays.astype(np.float32))
        seen = hit >= 0
        assert seen.mean() > 0.4
        facing = (normals[hit[seen]] * rays[seen]).sum(axis=1) < 0
        assert facing.mean() > 0.9999


@pytest.mark.parametrize("name", UNWRAPPED)
def test_receivers(rng, name):
    """Their number within 1 %, their area that of the surface, none inside a wall."""
    scene, lightmap = built(name), unwrapped(name)
    receivers = lightmap.receivers
    assert len(receivers) == pytest.approx(scene.receivers, rel=0.01)
    surface = triangle_areas(scene.corners.astype(np.float64)).sum()
    assert receivers.area.sum(dtype=np.float64) == pytest.approx(surface, rel=1e-4)
    assert np.isfinite(lightmap.triangle_uvs).all()
    low, high = scene.bounds
    start = receivers.position + 1e-4 * np.linalg.norm(high - low) * receivers.normal
    traced, normals = embree(scene), face_normals(scene)
    backs = np.zeros(len(receivers))
    for _ in range(16):
        ray = rng.normal(size=start.shape)
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True) + receivers.normal
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        hit = traced.run(start.astype(np.float32), ray.astype(np.float32))
        seen = np.flatnonzero(hit >= 0)
        backs[seen] += (normals[hit[seen]] * ray[seen]).sum(axis=1) > 0
    # A single ray in sixteen may slip through an edge; two tell of a wall.
    assert np.count_nonzero(backs >= 2) == 0
    assert np.count_nonzero(backs) <= 1e-4 * len(receivers)


def test_curtains_are_closed():
    """Every edge of a cloth is shared by exactly two triangles that run along it oppositely."""
    scene = built("atrium")
    cloth = [i for i, m in enumerate(scene.materials) if m.name.endswith("cloth")]
    chosen = scene.triangles[np.isin(scene.material_ids, cloth)]
    assert len(chosen) > 10_000
    weld = {}
    ids = [
        weld.setdefault(tuple(np.round(p, 5)), len(weld)) for p in scene.positions[chosen.ravel()]
    ]
    corners = np.array(ids).reshape(-1, 3)
    edges = Counter()
    for a, b in ((0, 1), (1, 2), (2, 0)):
        edges.update(zip(corners[:, a].tolist(), corners[:, b].tolist(), strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def test_coloured_walls_of_the_boxes():
    for name, left, right in (("cornell-box", 0, 1), ("blue-orange-box", 2, 0)):
        materials = {m.name: np.array(m.base_color) for m in built(name).materials}
        assert np.argmax(materials["left"]) == left
        assert np.argmax(materials["right"]) == right
