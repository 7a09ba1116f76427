"""The bake of captured probes: maps, capture, resampling by sharpness, light that is lit once."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import dblquad
from support import ddgi_oracle as octahedral
from support.captured_oracle import NAMES, SMALL, filtered_moments
from support.shading_oracle import bilinear
from support.shading_oracle import direct_irradiance as traced_irradiance
from support.synthetic_bake import random_scene
from support.tiny_scenes import box, empty_room, quad_scene

from gibench.bake.run import BakeReport, run_bake
from gibench.rays.embree import EmbreeTracer
from gibench.scene.environment import Environment
from gibench.scene.glow import Glow
from gibench.scene.model import Material
from gibench.techniques.parts.captured_probes import lighting, maps
from gibench.techniques.parts.captured_probes.capture import capture, cube_directions
from gibench.techniques.parts.captured_probes.points import Points
from gibench.techniques.parts.captured_probes.resample import Resampling, resampled
from gibench.techniques.parts.captured_probes.settings import texel_sharpness
from gibench.techniques.registry import BakeContext, find_technique
from gibench.work import Serial

ANYWHERE = 200


def unit(rng, count=ANYWHERE):
    d = rng.normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


# -- octahedral maps -------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [4, 6, 8, 16, 32, 64, 128])
def test_borders_and_lookups_are_those_of_the_map(rng, side):
    values = rng.random((2, side**2, 3))
    whole = np.zeros((2, side + 2, side + 2, 3))
    whole[:, 1:-1, 1:-1] = values.reshape(2, side, side, 3)
    expected = octahedral.bordered(whole)
    np.testing.assert_array_equal(maps.bordered(values, side), expected)
    d = unit(rng)
    place, share = maps.bilinear(d, side)
    found = np.einsum("nk,nkc->nc", share, values[0][place])
    np.testing.assert_allclose(found, octahedral.lookup(expected[0], d), rtol=1e-9)
    np.testing.assert_allclose(
        maps.texel_directions(side), octahedral.texel_directions(side), atol=1e-12
    )


def test_texels_solid_angles_are_those_of_their_squares():
    """By numerical integration of the map's area over the sphere, where it has no edge inside."""
    side = 8
    angles = maps.texel_solid_angles(side)
    assert angles.sum() == pytest.approx(4 * np.pi)

    def density(y, x):
        z = 1 - abs(x) - abs(y)
        fold = [(1 - abs(y)) * np.sign(x), (1 - abs(x)) * np.sign(y)] if z < 0 else [x, y]
        return (fold[0] ** 2 + fold[1] ** 2 + z**2) ** -1.5

    for row, column in ((4, 4), (5, 4), (7, 7), (1, 2)):
        low = np.array([column, row]) / side * 2 - 1
        high = low + 2 / side
        true, _ = dblquad(density, low[0], high[0], low[1], high[1])
        assert angles[row * side + column] == pytest.approx(true, rel=0.01)


def test_the_sharpness_left_unset_halves_at_a_texels_edge():
    side = 64
    half_width = np.sqrt(4 * np.pi / side**2) / 2
    assert np.cos(half_width) ** texel_sharpness(side) == pytest.approx(0.5, rel=0.01)
    assert texel_sharpness(128) == pytest.approx(7230, rel=1e-3)


# -- capture ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [2, 5, 16])
def test_a_cubes_texels_cover_the_sphere(side):
    d = cube_directions(side)
    assert d.shape == (6 * side**2, 3)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1)
    assert len(np.unique(np.round(d, 9), axis=0)) == len(d)
    # A cube's texel has the solid angle of its square, seen aslant and from afar.
    weight = (1 / np.abs(d).max(axis=1)) ** -3
    np.testing.assert_allclose(weight @ d / weight.sum(), 0, atol=1e-12)
    second = (weight[:, None] * d).T @ d / weight.sum()
    np.testing.assert_allclose(second, np.eye(3) / 3, atol=1e-12)


def test_a_captured_cube_shows_what_is_there(rng):
    scene = random_scene(rng, 80)
    directions = cube_directions(20)
    found = capture(scene, EmbreeTracer(scene.corners), np.array([0.1, -0.2, 0.05]), directions)
    seen = found.triangle >= 0
    assert 0.1 < seen.mean() < 1 and 0 < found.back_share < 1
    at = octahedral.surface(
        scene, found.triangle[seen], *found.barycentric[seen].astype(np.float64).T
    )
    front = np.einsum("nx,nx->n", at.geometric, directions[seen]) < 0
    np.testing.assert_array_equal(found.front[seen], front)
    reached = np.array([0.1, -0.2, 0.05]) + found.distance[seen, None] * directions[seen]
    np.testing.assert_allclose(reached, at.position, atol=1e-5)
    # Textures here are of linear values, the frame's of 8 bits.
    np.testing.assert_allclose(found.albedo[seen][front], at.albedo[front], atol=0.02)
    np.testing.assert_allclose(found.emission[seen][front], at.emission[front], atol=1e-6)
    assert not found.albedo[~found.front].any() and not found.emission[seen][~front].any()
    sky = scene.environment.radiance(directions[~seen])
    np.testing.assert_allclose(found.emission[~seen], sky, rtol=1e-6)
    assert np.isinf(found.distance[~seen]).all()


def test_what_glows_by_an_image_is_captured_point_by_point(rng):
    """By the image, repeating and bilinear, in float64."""
    scene = random_scene(rng, 60)
    pixels = rng.uniform(0, 5, (6, 4, 3)).astype(np.float32)
    triangle = np.arange(0, 60, 2, dtype=np.int32)
    uvs = rng.uniform(-1, 2, (30, 3, 2)).astype(np.float32)
    scene = replace(scene, glow=Glow((pixels,), triangle, np.zeros(30, np.int32), uvs))
    found = capture(scene, EmbreeTracer(scene.corners), np.zeros(3), cube_directions(16))
    mine = found.front & (found.triangle % 2 == 0)
    assert mine.sum() > 20
    u, v = found.barycentric[mine].astype(np.float64).T
    corners = uvs[found.triangle[mine] // 2].astype(np.float64)
    at = np.einsum("nk,nkx->nx", np.stack([1 - u - v, u, v], axis=1), corners)
    expected = bilinear(pixels, at[:, 0] * 4 - 0.5, (1 - at[:, 1]) * 6 - 0.5, wrap=True)
    np.testing.assert_allclose(found.emission[mine], expected, rtol=1e-4, atol=1e-4)


# -- resampling ------------------------------------------------------------------------------------


@pytest.mark.parametrize("sharpness", [0.0, 0.5, 1.0, 8.0, 60.0, 700.0, 20000.0])
def test_resampling_is_the_sharpness_weighted_mean(rng, sharpness):
    """Of all captured texels, in float64: what is left out weighs a ten-thousandth."""
    sources, targets = cube_directions(12), maps.texel_directions(8)
    values = rng.uniform(0, 1, (len(sources), 3)).astype(np.float32)
    dot = np.maximum(targets @ sources.T, 0)
    # Over the nearest's, as the largest powers are no numbers any more.
    closest = dot.max(axis=1)[:, None]
    weight = (np.maximum(dot, 1e-300) / closest) ** sharpness * (dot > 1e-9)
    expected = weight @ values / weight.sum(axis=1, keepdims=True)
    made = Resampling.of(targets, sources, sharpness)
    np.testing.assert_allclose(made.apply(values), expected, atol=3e-4)
    in_parts = replace(made, held=None)
    np.testing.assert_allclose(in_parts.apply(values), made.apply(values), atol=1e-6)
    np.testing.assert_allclose(dot[np.arange(64), made.nearest], closest[:, 0], rtol=1e-12)


def test_a_map_shows_the_front_that_weighs_most_and_means_of_all(rng):
    scene, position = random_scene(rng, 60), np.array([0.05, 0.1, 0.0])
    directions = cube_directions(10)
    captured = capture(scene, EmbreeTracer(scene.corners), position, directions)
    resampling = Resampling.of(maps.texel_directions(6), directions, 40.0)
    found = resampled(captured, resampling, far=2.0)
    weight = np.maximum(maps.texel_directions(6) @ directions.T, 0) ** 40
    weight[weight < 1e-4 * weight.max(axis=1)[:, None]] = 0
    weight /= weight.sum(axis=1, keepdims=True)
    strongest = np.where(captured.front, weight, 0)
    for texel in range(36):
        if strongest[texel].max() == 0:
            assert found.triangle[texel] == -1
        elif captured.front[resampling.nearest[texel]]:
            assert found.triangle[texel] == captured.triangle[resampling.nearest[texel]]
        else:
            # Of several as near, by the symmetry of both maps, any: weights are kept as float32.
            tied = strongest[texel] >= (1 - 1e-6) * strongest[texel].max()
            assert found.triangle[texel] in captured.triangle[tied]
    near = np.minimum(captured.distance / 2.0, 1.0)
    moments = np.stack([near, near**2], axis=1)
    np.testing.assert_allclose(found.moments, weight @ moments, atol=2e-4)
    np.testing.assert_allclose(found.albedo, weight @ captured.albedo, atol=2e-4)
    np.testing.assert_allclose(found.emission, weight @ captured.emission, atol=1e-3)
    assert found.captured_bytes == captured.nbytes > 600 * 4


# -- light once lit --------------------------------------------------------------------------------


def test_direct_light_is_that_of_every_kind_of_light(rng):
    scene = random_scene(rng, 70)
    weights = rng.dirichlet((1, 1, 1), 300)
    triangle = rng.integers(0, 70, 300)
    at = octahedral.surface(scene, triangle, weights[:, 1], weights[:, 2])
    points = Points(at.position, at.geometric, at.normal)
    expected = traced_irradiance(scene, 0, at.position, at.normal, at.geometric)
    found = lighting.direct_irradiance(
        scene, scene.lights_at(0), EmbreeTracer(scene.corners), points
    )
    sure = expected.certain
    assert sure.mean() > 0.7
    np.testing.assert_allclose(found[sure], expected.irradiance[sure], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("side", [8, 16, 32])
def test_irradiance_of_known_radiance(rng, side):
    """Constant a: pi a. Linear a + b . w: pi a + 2 pi / 3 b . n. One texel of solid angle A and
    radiance L: A L max(0, n . w).
    """
    d = maps.texel_directions(side)
    a, b = rng.uniform(1, 2, 3), rng.uniform(-1, 1, (3, 3))
    constant = np.tile(a, (1, side**2, 1)).astype(np.float32)
    found = lighting.filtered_irradiance(constant, side)
    np.testing.assert_allclose(found, np.pi * constant, rtol=1e-5)
    linear = (a + d @ b)[None].astype(np.float32)
    expected = np.pi * a + 2 * np.pi / 3 * d @ b
    found = lighting.filtered_irradiance(linear, side)[0]
    np.testing.assert_allclose(found, expected, atol=8.0 / side**2 * np.abs(expected).max())
    delta, texel = np.zeros((1, side**2, 3), np.float32), rng.integers(0, side**2)
    delta[0, texel] = a
    angle = maps.texel_solid_angles(side)[texel]
    expected = angle * a * np.maximum(0, d @ d[texel])[:, None]
    found = lighting.filtered_irradiance(delta, side)[0]
    np.testing.assert_allclose(found, expected, atol=8.0 / side**2 * expected.max())


def test_irradiance_is_that_of_the_published_grid_of_angles(rng):
    """Anonymous 2022, listing 4.2: 500 steps of azimuth by 125 of the zenith, each weighed by
    cos sin, the radiance map looked up bilinearly. Within 1 % of the brightest texel at 32 texels.
    """
    side, step = 32, 2 * np.pi / 500
    d = maps.texel_directions(side)
    window = np.where(d @ unit(rng, 1)[0] > 0.95, 10.0, 0.1)
    radiance = np.stack([1 + d @ rng.uniform(-0.5, 0.5, 3), rng.random(side**2), window], axis=1)
    found = lighting.filtered_irradiance(radiance[None].astype(np.float32), side)[0]
    zenith, azimuth = np.meshgrid(np.arange(125) * step, np.arange(500) * step)
    t, p = zenith.ravel(), azimuth.ravel()
    for texel in rng.integers(0, side**2, 6):
        right = np.cross([0.0, 1.0, 0.0], n := d[texel])
        right /= np.linalg.norm(right)
        tangent = np.stack([np.cos(p) * np.sin(t), np.sin(p) * np.sin(t), np.cos(t)], axis=1)
        place, share = maps.bilinear(tangent @ np.stack([right, np.cross(n, right), n]), side)
        seen = np.einsum("nk,nkc->nc", share, radiance[place])
        # The listing's figure is irradiance over pi.
        expected = np.pi**2 * (seen * (np.cos(t) * np.sin(t))[:, None]).mean(axis=0)
        off = np.abs(found[texel] - expected) / found.max(axis=0)
        assert off.max() < 0.01


@pytest.mark.parametrize("sharpness", [1.0, 30.0, 500.0])
def test_distances_are_filtered_by_their_lobe(rng, sharpness):
    moments = rng.uniform(0, 1, (3, 64, 2)).astype(np.float32)
    found = lighting.filtered_moments(moments, 8, sharpness)
    np.testing.assert_allclose(found, filtered_moments(moments, 8, sharpness), atol=3e-4)


def furnace(bounces, **more):
    """Albedo 0.5, emission 1: after n bounces irradiance is pi (1 + 1/2 + ... + 1/2^(n-1))."""
    scene, lightmap = empty_room(side=3)
    glowing = (Material("glowing", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)),)
    settings = {**SMALL, "update": "static", "bounces": bounces, **more}
    return replace(scene, materials=glowing), lightmap, settings


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("bounces", "sum_of"), [("1", 1.0), ("2", 1.5), ("3", 1.75), ("any", 2.0)])
def test_a_furnace_bounce_by_bounce(name, bounces, sum_of, tmp_path):
    scene, lightmap, settings = furnace(bounces)
    spec = find_technique(name)
    chosen = spec.settings(settings)
    baked = spec.bake(BakeContext(scene, lightmap, chosen, tmp_path))
    np.testing.assert_allclose(baked.irradiance, np.pi * sum_of, rtol=1e-3)
    # As published: one bounce without visibility, any number with it.
    published = {"irradiance-probes": 1, "light-field-probes": None}[name]
    assert spec.settings({**settings, "bounces": "auto"}).bounce_count == published
    assert spec.settings({"update": "relit"}).bounce_count is None


def test_what_lies_in_a_block_sees_backs_and_does_not_count(tmp_path):
    quads = box((-2, 0, -2), (2, 2, 2), True) + box((-1.9, 0.1, -1.9), (-1.1, 1.9, -1.1), False)
    scene, lightmap = quad_scene(quads, 2)
    settings = {"counts": "4x2x4", "capture_texels": 8, "map_texels": 4}
    for threshold, out in ((0.25, 2), (1.0, 0)):
        spec = find_technique("light-field-probes")
        chosen = spec.settings({**settings, "backface_threshold": threshold})
        baked = spec.bake(BakeContext(scene, lightmap, chosen, tmp_path))
        assert np.count_nonzero(~baked.usable) == out
    within = (np.abs(baked.volume.positions[:, [0, 2]] + 1.5) < 0.1).all(axis=1)
    assert within.sum() == 2
    np.testing.assert_array_equal(np.array([m.back_share for m in baked.maps]) == 1, within)


# -- stages ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_stages_resume_and_their_copies_bake_the_same(name, tmp_path):
    scene, lightmap, settings = furnace("2")
    scene = replace(scene, environment=Environment.constant((0.2, 0.3, 0.4)))
    spec = find_technique(name)
    stages = spec.stages(BakeContext(scene, lightmap, spec.settings(settings), tmp_path))
    assert [one.name for one in stages] == ["captured-maps", f"{name}-light", f"{name}-probes"]
    assert len(stages[0].pieces) == 12
    first = run_bake(stages, tmp_path / "one")
    (light,) = tmp_path.glob(f"one/{name}-light-*/*.bin")
    (lost,) = tmp_path.glob("one/captured-maps-*/probe-00007.bin")
    light.unlink(), lost.unlink()
    report = BakeReport()
    again = run_bake(pickle.loads(pickle.dumps(stages)), tmp_path / "one", Serial(), report)
    told = report.stages["captured-maps"]
    assert (told.baked, told.loaded) == (1, 11)
    np.testing.assert_array_equal(first.irradiance, again.irradiance)
    assert (first.distance is None) == (name == "irradiance-probes")


def test_techniques_share_their_maps(tmp_path):
    scene, lightmap = empty_room(side=2)
    keys = []
    for name in NAMES:
        spec = find_technique(name)
        chosen = spec.settings({**SMALL, "update": "static"})
        stages = spec.stages(BakeContext(scene, lightmap, chosen, tmp_path))
        keys.append([one.key for one in stages])
    assert keys[0][0] == keys[1][0] and keys[0][1] != keys[1][1]


@pytest.mark.parametrize("name", NAMES)
def test_a_key_holds_what_a_stage_depends_on_and_no_more(name, tmp_path):
    scene, lightmap = empty_room(side=2)
    spec = find_technique(name)

    def keys(scene=scene, **settings):
        chosen = spec.settings({**SMALL, "update": "static", **settings})
        return [one.key for one in spec.stages(BakeContext(scene, lightmap, chosen, tmp_path))[:2]]

    maps_key, light_key = keys()
    lamp = replace(scene, lights=random_scene(np.random.default_rng(0)).lights)
    assert keys(lamp)[0] == maps_key and keys(lamp)[1] != light_key
    assert keys(bounces="4")[0] == maps_key and keys(bounces="4")[1] != light_key
    for changed in ({"sharpness": 3.0}, {"map_texels": 4}, {"counts": "2x2x2"}):
        assert keys(**changed)[0] != maps_key
