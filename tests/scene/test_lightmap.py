"""Conservative raster, texture averages and the atlas."""

from __future__ import annotations

import os
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gibench.errors import BadInput
from gibench.scene.builtin import build
from gibench.scene.lightmap import Lightmap
from gibench.scene.lightmap.albedo import bilinear, mean_texture
from gibench.scene.lightmap.atlas import closest_point, unwrap
from gibench.scene.lightmap.charts import flatten, triangle_areas
from gibench.scene.lightmap.raster import clip, covered_texels, doubled_areas
from gibench.scene.model import Material, Scene, Texture


def quad(width=1.0, depth=1.0, **changes) -> Scene:
    """A horizontal rectangle that faces up, its texture and lightmap coordinates over all of it."""
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    scene = Scene(
        name="quad",
        positions=np.stack([uv[:, 0] * width, 0 * uv[:, 0], -uv[:, 1] * depth], 1),
        normals=np.tile(np.float32([0, 1, 0]), (4, 1)),
        uvs=uv,
        triangles=np.array([(0, 1, 2), (0, 2, 3)], np.int32),
        material_ids=np.zeros(2, np.int32),
        object_ids=np.zeros(2, np.int32),
    )
    return replace(scene, **changes)


def surface_points(scene: Scene, count: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Random triangles (by area) and barycentric coordinates."""
    area = triangle_areas(scene.corners.astype(np.float64))
    triangle = rng.choice(len(area), count, p=area / area.sum())
    b = rng.dirichlet([1, 1, 1], count)
    return triangle, b


def texel_of(lightmap: Lightmap, triangle, b) -> np.ndarray:
    uv = np.einsum("mk,mki->mi", b, lightmap.triangle_uvs[triangle].astype(np.float64))
    cell = np.floor(uv).astype(np.int64)
    return cell[:, 1] * lightmap.width + cell[:, 0]


@pytest.mark.parametrize(("spread", "size"), [(30.0, 30.0), (200.0, 1.5), (8.0, 0.05)])
def test_pieces_add_up_and_stay_in_their_texels(rng, spread, size):
    uvs = rng.uniform(0, spread, (500, 1, 2)) + rng.uniform(-size, size, (500, 3, 2))
    area = np.zeros(500)
    for pieces in clip(uvs, batch=1000):
        corners = pieces.barycentric @ uvs[pieces.triangle]
        assert (corners[..., 0] >= pieces.x[:, None] - 1e-9).all()
        assert (corners[..., 0] <= pieces.x[:, None] + 1 + 1e-9).all()
        assert (corners[..., 1] >= pieces.y[:, None] - 1e-9).all()
        assert (corners[..., 1] <= pieces.y[:, None] + 1 + 1e-9).all()
        area += np.bincount(pieces.triangle, np.abs(doubled_areas(corners)) / 2, 500)
    true = np.abs(doubled_areas(uvs)) / 2
    # At most 1e-6 of a texel is dropped per texel on the outline.
    np.testing.assert_allclose(area, true, rtol=1e-5, atol=1e-6 * (4 * size + 8))


def test_covered_texels_equal_dense_sampling(rng):
    uvs = rng.uniform(0, 6, (40, 3, 2))
    found = {(t, x, y) for part in covered_texels(uvs) for t, x, y in zip(*part, strict=True)}
    b = rng.dirichlet([0.7, 0.7, 0.7], (40, 20_000))
    points = np.floor(np.einsum("tnk,tki->tni", b, uvs)).astype(int)
    sampled = {(t, x, y) for t in range(40) for x, y in np.unique(points[t], axis=0)}
    assert sampled <= found
    # What sampling missed is small.
    assert len(found - sampled) < 0.1 * len(found)


def test_touching_is_not_covering():
    uvs = np.array([[(1.0, 1.0), (2.0, 1.0), (1.0, 2.0)]])
    cells = [(int(x), int(y)) for _, xs, ys in covered_texels(uvs) for x, y in zip(xs, ys)]  # noqa: B905
    assert cells == [(1, 1)]


def test_quad_with_its_own_coordinates_has_the_texels_one_expects():
    uv = quad().uvs
    lightmap = unwrap(quad(lightmap_uvs=uv), 100)
    assert (lightmap.width, lightmap.height) == (10, 10)
    np.testing.assert_array_equal(lightmap.receivers.texel, np.arange(100))
    y, x = np.divmod(np.arange(100), 10)
    expected = np.stack([(x + 0.5) / 10, 0 * x, -(y + 0.5) / 10], 1)
    np.testing.assert_allclose(lightmap.receivers.position, expected, atol=1e-6)
    np.testing.assert_allclose(lightmap.receivers.area, 0.01, rtol=1e-5)
    np.testing.assert_allclose(lightmap.receivers.normal, np.tile([0, 1, 0], (100, 1)), atol=1e-6)
    np.testing.assert_allclose(lightmap.receivers.albedo, 0.8, rtol=1e-6)


def test_unwrapped_quad_keeps_its_shape():
    lightmap = unwrap(quad(3.0, 1.0), 300)
    assert len(lightmap.receivers) == 300
    uv = lightmap.triangle_uvs[0].astype(np.float64)
    sides = np.linalg.norm(uv - np.roll(uv, 1, axis=0), axis=1)
    true = np.linalg.norm(quad(3.0).corners[0] - np.roll(quad(3.0).corners[0], 1, axis=0), axis=1)
    np.testing.assert_allclose(sides / true, sides[0] / true[0], rtol=1e-4)
    assert lightmap.receivers.area.sum() == pytest.approx(3.0, rel=1e-6)


@pytest.fixture(scope="module")
def hall() -> tuple[Scene, Lightmap]:
    scene = build("hall")
    return scene, unwrap(scene, 20_000)


def test_every_surface_point_has_a_valid_texel(rng, hall):
    scene, lightmap = hall
    triangle, b = surface_points(scene, 200_000, rng)
    assert (lightmap.receiver_of_texel[texel_of(lightmap, triangle, b)] >= 0).all()


def test_receivers_average_the_surface_of_their_texel(rng, hall):
    """Random surface points, binned by texel, give back area, normal and albedo."""
    scene, lightmap = hall
    count, points = len(lightmap.receivers), 2_000_000
    triangle, b = surface_points(scene, points, rng)
    owner = lightmap.receiver_of_texel[texel_of(lightmap, triangle, b)]
    hits = np.bincount(owner, minlength=count)
    surface = float(lightmap.receivers.area.sum(dtype=np.float64))
    expected = lightmap.receivers.area / surface * points
    z = (hits - expected) / np.sqrt(np.maximum(expected, 1))
    assert np.abs(z).max() < 7 and 0.9 < z[expected > 20].std() < 1.1
    normal = np.einsum("mk,mki->mi", b, scene.normals[scene.triangles[triangle]])
    mean = np.stack([np.bincount(owner, normal[:, i], count) for i in range(3)], 1)
    many = hits > 60
    mean = mean[many] / np.linalg.norm(mean[many], axis=1, keepdims=True)
    aligned = (mean * lightmap.receivers.normal[many]).sum(1)
    assert np.quantile(aligned, 0.001) > 0.98


def test_positions_lie_on_their_fragments(hall):
    scene, lightmap = hall
    fragments, receivers = lightmap.fragments, lightmap.receivers
    owner = np.repeat(np.arange(len(receivers)), np.diff(fragments.start))
    near = closest_point(fragments.corners.astype(float), receivers.position[owner].astype(float))
    far = np.linalg.norm(near - receivers.position[owner], axis=1)
    assert np.minimum.reduceat(far, fragments.start[:-1]).max() < 2e-6
    total = np.add.reduceat(fragments.area.astype(np.float64), fragments.start[:-1])
    np.testing.assert_allclose(total, receivers.area, rtol=1e-5)
    plane = scene.corners[fragments.triangle].astype(float)
    off = closest_point(plane, fragments.corners[:, 0].astype(float)) - fragments.corners[:, 0]
    assert np.abs(off).max() < 2e-6
    unit = np.linalg.norm(receivers.normal, axis=1)
    np.testing.assert_allclose(unit, 1, atol=1e-5)


def test_closest_point_against_dense_sampling(rng):
    corners, points = rng.normal(size=(50, 3, 3)), rng.normal(size=(50, 3))
    b = rng.dirichlet([0.5, 0.5, 0.5], 20_000)
    sampled = np.linalg.norm(np.einsum("nk,tki->tni", b, corners) - points[:, None], axis=2).min(1)
    found = np.linalg.norm(closest_point(corners, points) - points, axis=1)
    assert (found <= sampled + 1e-9).all()
    assert (found >= sampled - 0.05).all()


@pytest.mark.parametrize("padding", [1, 2])
def test_charts_keep_their_distance(padding):
    scene = build("hall")
    lightmap = unwrap(scene, 8_000, padding=padding)
    area = triangle_areas(scene.corners.astype(np.float64)).sum()
    charts = flatten(scene, area / 8_000)
    label = np.full(lightmap.width * lightmap.height, -1)
    fragments = lightmap.fragments
    owner = np.repeat(lightmap.receivers.texel, np.diff(fragments.start))
    label[owner] = charts.chart[fragments.triangle]
    # No texel is shared: the last chart written is the only one.
    np.testing.assert_array_equal(label[owner], charts.chart[fragments.triangle])
    image = np.pad(label.reshape(lightmap.height, lightmap.width), 2 * padding, constant_values=-1)
    for dy in range(-2 * padding, 2 * padding + 1):
        for dx in range(-2 * padding, 2 * padding + 1):
            other = np.roll(image, (dy, dx), (0, 1))
            assert not ((image >= 0) & (other >= 0) & (image != other)).any()
    # Each chart's border lies inside the atlas.
    edge = label.reshape(lightmap.height, lightmap.width)
    assert (edge[:padding] < 0).all() and (edge[-padding:] < 0).all()
    assert (edge[:, :padding] < 0).all() and (edge[:, -padding:] < 0).all()


@pytest.mark.parametrize("shape", [(5, 7), (64, 48), (300, 200)])
def test_texture_average_against_brute_force(rng, shape):
    pixels = rng.uniform(0, 1, (*shape, 3)).astype(np.float32)
    uvs = rng.uniform(-2, 2, (12, 1, 2)) + rng.uniform(-0.3, 0.3, (12, 3, 2))
    b = rng.dirichlet([1, 1, 1], 200_000)
    shares = []
    for triangle, mean in zip(uvs, mean_texture(pixels, uvs), strict=True):
        brute = bilinear(pixels.astype(np.float64), b @ triangle).mean(axis=0)
        # White noise, the worst of images: what is left is the outline, where the average takes or
        # leaves a pixel of standard deviation 0.29.
        covered = abs(doubled_areas(triangle[None])[0]) / 2 * shape[0] * shape[1]
        shares.append(np.abs(mean - brute) / (0.02 + 0.3 / np.sqrt(1 + covered)))
    # Noise: of some thousand triangles one is a little further off, but never most of a dozen.
    assert np.sqrt(np.mean(np.square(shares))) < 0.6 and np.max(shares) < 1.4


def test_slivers_average_all_they_cross():
    ramp = np.tile(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], (64, 1, 3))
    thin = np.array([[(0.1, 0.5), (0.7, 0.5), (0.7, 0.5001)], [(0.1, 0.5), (0.7, 0.5), (0.4, 0.7)]])
    # The mean of a linear image is its value at the centroid.
    expected = (thin[..., 0].mean(axis=1) * 64 - 0.5) / 63
    np.testing.assert_allclose(mean_texture(ramp, thin)[:, 0], expected, atol=0.01)


def test_chequered_quad_averages_to_grey_or_shows_its_squares():
    pixels = np.zeros((64, 64, 3), np.float32)
    pixels[:32, :32] = pixels[32:, 32:] = 1.0
    textured = {
        "materials": (Material("chequer", (1.0, 0.5, 0.25), emission=(3.0, 2.0, 1.0), texture=0),),
        "textures": (Texture("chequer", pixels),),
        "lightmap_uvs": quad().uvs,
    }
    coarse = unwrap(quad(**textured), 1)
    np.testing.assert_allclose(coarse.receivers.albedo, [[0.5, 0.25, 0.125]], atol=0.01)
    np.testing.assert_allclose(coarse.receivers.emission, [[3, 2, 1]])
    fine = unwrap(quad(**textured), 16)
    red = fine.receivers.albedo[:, 0].reshape(4, 4)
    # Row 0 of the image is v = 1; row 0 of the atlas is v = 0.
    assert red[3, 0] > 0.9 and red[0, 3] > 0.9 and red[0, 0] < 0.1 and red[3, 3] < 0.1


def test_same_input_same_lightmap(hall):
    a, b = hall[1], unwrap(build("hall"), 20_000)
    assert a.content_hash() == b.content_hash()
    for name in ("texel", "position", "normal", "albedo", "emission", "area"):
        np.testing.assert_array_equal(getattr(a.receivers, name), getattr(b.receivers, name))
    np.testing.assert_array_equal(a.fragments.start, b.fragments.start)


@pytest.mark.parametrize(
    ("uvs", "words"),
    [
        (quad().uvs * 1.5, "leave"),
        (quad().uvs * np.nan, "NaN"),
        (np.float32([(0, 0), (1, 0), (1, 1), (1, 0)]), "overlap|cover"),
        (np.float32([(0, 0), (1, 0), (0, 1), (0.9, 0.05)]), "overlap"),
    ],
)
def test_unusable_lightmap_coordinates_are_replaced(uvs, words, caplog):
    if "cover" in words:
        uvs = np.zeros((4, 2), np.float32)
    lightmap = unwrap(quad(lightmap_uvs=uvs), 400)
    assert re.search(words, caplog.text)
    assert len(lightmap.receivers) == pytest.approx(400, rel=0.01)
    assert lightmap.receivers.area.sum() == pytest.approx(1.0, rel=1e-6)


def test_good_lightmap_coordinates_are_kept(caplog):
    lightmap = unwrap(quad(lightmap_uvs=0.25 + 0.5 * quad().uvs), 2500)
    assert caplog.text == ""
    assert len(lightmap.receivers) == pytest.approx(2500, rel=0.02)
    np.testing.assert_allclose(
        lightmap.triangle_uvs[0] / lightmap.triangle_uvs[0].max() * 0.75,
        0.25 + 0.5 * quad().uvs[[0, 1, 2]],
        atol=1e-5,
    )


def test_odd_input_is_refused_or_survived():
    with pytest.raises(BadInput):
        unwrap(quad(), 0)
    with pytest.raises(BadInput):
        unwrap(quad(), 10, padding=-1)
    with pytest.raises(BadInput):
        unwrap(quad(positions=np.zeros((4, 3), np.float32)), 10)
    one = unwrap(quad(), 1)
    assert len(one.receivers) == 1 and one.receivers.area[0] == pytest.approx(1.0)
    # A triangle without area among good ones has no place; the rest is complete.
    broken = quad(
        triangles=np.array([(0, 1, 2), (0, 2, 3), (1, 1, 2)], np.int32),
        material_ids=np.zeros(3, np.int32),
        object_ids=np.zeros(3, np.int32),
    )
    lightmap = unwrap(broken, 100)
    assert np.isnan(lightmap.triangle_uvs[2]).all()
    assert lightmap.receivers.area.sum() == pytest.approx(1.0, rel=1e-6)


def test_fewer_receivers_than_charts_are_refused_with_the_least_that_works():
    """400 small squares, each a chart of at least one texel."""
    side = 20
    corner = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 1, 2)
    at = corner + 0.4 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    count = len(at)
    base = 4 * np.arange(count)[:, None, None]
    scene = quad(
        positions=np.stack([at[..., 0], 0 * at[..., 0], -at[..., 1]], -1)
        .reshape(-1, 3)
        .astype(np.float32),
        normals=np.tile(np.float32([0, 1, 0]), (4 * count, 1)),
        uvs=np.tile(quad().uvs, (count, 1)),
        triangles=(base + np.array([(0, 1, 2), (0, 2, 3)])).reshape(-1, 3).astype(np.int32),
        material_ids=np.zeros(2 * count, np.int32),
        object_ids=np.zeros(2 * count, np.int32),
    )
    for receivers in (1, 50, 190):
        with pytest.raises(BadInput, match=f"{receivers} receivers are too few .*; ask for 400 or"):
            unwrap(scene, receivers)
    assert len(unwrap(scene, 400).receivers) == 400
    assert len(unwrap(scene, 250).receivers) == 400


def scenes_folder() -> Path:
    named = os.environ.get("GIBENCH_SCENES")
    if named:
        return Path(named)
    beside = Path(__file__).resolve().parents[3] / "shared" / "scenes"
    return beside if beside.is_dir() else Path("/work/shared/scenes")


@pytest.mark.slow
def test_real_sponza_meets_its_receivers(rng):
    path = scenes_folder() / "sponza_crytek" / "sponza.obj"
    if not path.is_file():
        pytest.skip(f"the real Sponza is not at {path}; set GIBENCH_SCENES")
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(path, force="mesh", process=False, skip_materials=True)
    positions = np.asarray(mesh.vertices, np.float32)
    triangles = np.asarray(mesh.faces, np.int32)
    area = triangle_areas(positions[triangles].astype(np.float64))
    triangles = triangles[area > 0]
    normals = np.array(mesh.vertex_normals, np.float32)
    normals[~(np.linalg.norm(normals, axis=1) > 0.5)] = (0, 1, 0)
    none = np.zeros(len(triangles), np.int32)
    uvs = np.zeros((len(positions), 2), np.float32)
    scene = Scene("sponza", positions, normals, uvs, triangles, none, none)
    start = time.perf_counter()
    lightmap = unwrap(scene, 246_325)
    print(f"\nSponza: {len(lightmap.receivers)} receivers in {time.perf_counter() - start:.1f} s")
    assert len(lightmap.receivers) == pytest.approx(246_325, rel=0.01)
    assert lightmap.receivers.area.sum(dtype=np.float64) == pytest.approx(area.sum(), rel=1e-4)
    triangle, b = surface_points(scene, 300_000, rng)
    texel = texel_of(lightmap, triangle, b)
    share = (lightmap.receiver_of_texel[texel] >= 0).mean()
    assert share > 0.99999
