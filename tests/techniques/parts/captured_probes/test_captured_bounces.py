"""Further bounces of probes that are lit once: by random rays against the probes' maps."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from support.captured_oracle import SMALL
from support.ddgi_oracle import bordered
from support.synthetic_bake import random_scene
from support.tiny_scenes import empty_room

from gibench.errors import BadInput
from gibench.rays.embree import EmbreeTracer
from gibench.scene.builtin import build
from gibench.scene.model import PointLight
from gibench.techniques.parts.captured_probes.bounced import (
    Looked,
    RayGather,
    bilateral_weights,
    cosine_directions,
    looked_up,
)
from gibench.techniques.parts.captured_probes.capture import capture, cube_directions
from gibench.techniques.parts.captured_probes.lighting import direct_irradiance, lit_once
from gibench.techniques.parts.captured_probes.maps import texel_directions, wrapped_texels
from gibench.techniques.parts.captured_probes.points import Points, points_of
from gibench.techniques.parts.captured_probes.resample import Resampling, resampled
from gibench.techniques.parts.captured_probes.settings import texel_sharpness
from gibench.techniques.parts.captured_probes.stages import far_plane
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.registry import BakeContext, find_technique


def unit(rng, count):
    d = rng.normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


@pytest.mark.parametrize("side", [4, 6, 16])
def test_neighbours_beyond_an_edge_are_those_of_the_border(side):
    numbers = np.zeros((1, side + 2, side + 2, 1), np.int64)
    numbers[0, 1:-1, 1:-1, 0] = np.arange(side**2).reshape(side, side)
    whole = bordered(numbers)[0, ..., 0]
    found = wrapped_texels(side, 1).reshape(side, side, 9)
    for row in range(side):
        for column in range(side):
            around = whole[row : row + 3, column : column + 3]
            np.testing.assert_array_equal(found[row, column], around.ravel())
    # Two steps: none lies farther off than the widest two texels do inside the map.
    d, two = texel_directions(side), wrapped_texels(side, 2)
    inside = d.reshape(side, side, 3)
    widest = np.einsum("rcx,rcx->rc", inside[:-2, :-2], inside[2:, 2:]).min()
    assert np.einsum("tx,tkx->tk", d, d[two]).min() >= widest - 1e-9


def test_rays_leave_by_the_cosine(rng):
    """Mean 2/3 along the normal and nothing across; second moment 1/2 along it and 1/4 across
    (integrals of cosine over pi), each within six standard errors.
    """
    count, normal = 40_000, unit(rng, 1)
    d = cosine_directions(np.repeat(normal, count, axis=0), rng)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1)
    along = d @ normal[0]
    assert along.min() >= 0
    assert abs(along.mean() - 2 / 3) < 6 * np.sqrt((1 / 2 - 4 / 9) / count)
    assert abs((along**2).mean() - 1 / 2) < 6 * np.sqrt((1 / 3 - 1 / 4) / count)
    across = d - along[:, None] * normal
    assert np.linalg.norm(across.mean(axis=0)) < 6 * np.sqrt(0.5 / count)


@pytest.mark.parametrize("radius", [1, 2])
def test_the_filter_stops_at_edges_and_depths(rng, radius):
    """Each weight in float64 from its formula, texel by texel."""
    side, scene = 10, random_scene(rng, 60)
    position, directions = np.array([0.05, 0.1, 0.0]), cube_directions(16)
    shown = capture(scene, EmbreeTracer(scene.corners), position, directions)
    maps = resampled(shown, Resampling.of(texel_directions(side), directions, 60.0), far=4.0)
    texels, at = points_of(scene, maps)
    distance, near = np.linalg.norm(at.position - position, axis=1), wrapped_texels(side, radius)
    found = bilateral_weights(texels, at, distance, near, side, radius)
    assert len(texels) > 20 and found.shape == (len(texels), (2 * radius + 1) ** 2)
    step = [(r, c) for r in range(-radius, radius + 1) for c in range(-radius, radius + 1)]
    for i, texel in enumerate(texels):
        expected = np.zeros(len(step))
        for k, (down, right) in enumerate(step):
            other = np.flatnonzero(texels == near[texel, k])
            if not len(other):
                continue
            cosine = max(0.0, float(at.normal[i] @ at.normal[other[0]]))
            off = abs(at.geometric[i] @ (at.position[other[0]] - at.position[i])) / distance[i]
            blur = np.exp(-2 * (down**2 + right**2) / radius**2)
            expected[k] = blur * cosine**32 * np.exp(-off / 0.02)
        np.testing.assert_allclose(found[i], expected / expected.sum(), rtol=1e-3, atol=1e-6)


def test_places_are_read_from_probes_that_see_them(rng):
    """Two rooms with a whole wall between them; one sends out 1 everywhere, the other 2. Without
    the test the nearest probe is often the other room's.
    """
    scene, side = build("two-rooms"), 16
    middle = float(np.mean(scene.bounds, axis=0)[0])
    # The right room's probes stand close to the wall.
    volume = Volume((middle - 1.6, 0.7, -1.0), (2.0, 1.0, 2.0), (2, 2, 2))
    tracer, directions = EmbreeTracer(scene.corners), cube_directions(48)
    resampling = Resampling.of(texel_directions(side), directions, 60.0)
    far = far_plane(volume)
    maps = [
        resampled(capture(scene, tracer, p, directions), resampling, far) for p in volume.positions
    ]
    usable = np.flatnonzero([m.back_share <= 0.25 for m in maps])
    radiance = np.zeros((len(maps), side**2, 3), np.float32)
    for number, position in enumerate(volume.positions):
        radiance[number] = 1.0 if position[0] < middle else 2.0
    # Places: what rays from the rooms' middles hit.
    place, facing, expected = [], [], []
    for x, value in ((middle - 1.5, 1.0), (middle + 1.5, 2.0)):
        start = np.repeat([[x, 1.25, 0.1]], 400, axis=0).astype(np.float32)
        hits = tracer.closest(start, d := unit(rng, 400).astype(np.float32))
        corners = scene.corners[hits.triangle].astype(float)
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        front = np.einsum("nx,nx->n", n, d) < 0
        place.append((start + hits.distance[:, None] * d)[front])
        facing.append(n[front])
        expected.append(np.full(front.sum(), value))
    place, facing, expected = (np.concatenate(a) for a in (place, facing, expected))
    assert len(place) > 700
    looked = Looked(
        volume.positions[usable],
        usable,
        np.stack([m.moments for m in maps]),
        side,
        RayGather(1, 0, 0.01, far),
    )
    tree = cKDTree(looked.positions)
    found = looked_up(looked, tree, radiance, place.astype(float), facing)
    np.testing.assert_allclose(found, np.repeat(expected[:, None], 3, axis=1), rtol=1e-5)
    _, nearest = tree.query(place)
    across = (volume.positions[usable][nearest][:, 0] < middle) != (expected == 1.0)
    assert across.sum() > 20


def test_the_second_bounce_is_that_of_rays_traced_to_their_ends(rng):
    """In a room with a lamp: the maps' second bounce against rays whose ends are lit exactly."""
    scene, _ = empty_room(side=4)
    lights = (PointLight((0.3, 1.4, 0.2), (3.0, 2.0, 1.0)),)
    tracer, side = EmbreeTracer(scene.corners), 32
    volume = find_technique("light-field-probes").settings({"counts": "3x2x2"}).volume(scene)
    directions, far = cube_directions(64), far_plane(volume)
    resampling = Resampling.of(texel_directions(side), directions, texel_sharpness(side))
    maps = [
        resampled(capture(scene, tracer, p, directions), resampling, far) for p in volume.positions
    ]
    usable, how = np.ones(len(maps), bool), RayGather(2, 2, 0.01, far)
    lit = [
        lit_once(
            scene, lights, tracer, maps, volume, usable, side, bounces, 0.01, None, how
        ).radiance
        for bounces in (1, 2)
    ]
    later = (lit[1] - lit[0])[0].mean(axis=0)
    texels, at = points_of(scene, maps[0])
    assert len(texels) == side**2
    rays, expected = 16, np.zeros((side**2, 3))
    for _ in range(rays):
        d = cosine_directions(at.normal, rng)
        start = at.position + 1e-4 * at.geometric
        hits = tracer.closest(start.astype(np.float32), d.astype(np.float32))
        corners = scene.corners[hits.triangle].astype(float)
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        there = Points(start + hits.distance[:, None] * d, n, n)
        albedo = np.array([m.base_color for m in scene.materials])[
            scene.material_ids[hits.triangle]
        ]
        sent = albedo / np.pi * direct_irradiance(scene, lights, tracer, there)
        expected += maps[0].albedo * sent / rays
    assert later.min() > 0.01
    np.testing.assert_allclose(later, expected.mean(axis=0), rtol=0.05)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"gather": "luck"}, "gather is 'luck'"),
        ({"gather": "rays"}, "relit gather from irradiance"),
        ({"gather_rays": 0}, "gather_rays is 0"),
        ({"denoise": -1}, "denoise is -1"),
        ({"denoise": 9, "map_texels": 8}, "denoise is 9"),
    ],
)
def test_nonsense_gets_one_clear_line(values, message):
    with pytest.raises(BadInput, match=message) as caught:
        find_technique("light-field-probes").settings(values)
    assert "\n" not in str(caught.value)


def test_what_is_gathered_is_in_the_lights_key_and_not_in_the_maps(tmp_path):
    scene, lightmap = empty_room(side=2)
    spec = find_technique("light-field-probes")

    def keys(**settings):
        chosen = spec.settings({**SMALL, **settings})
        return [one.key for one in spec.stages(BakeContext(scene, lightmap, chosen, tmp_path))]

    maps, light, _ = keys(update="static")
    for changed in ({"gather": "irradiance"}, {"gather_rays": 3}, {"denoise": 0}):
        other = keys(update="static", **changed)
        assert other[0] == maps and other[1] != light
    assert (
        keys(update="static", gather="irradiance", denoise=0)[1]
        == keys(update="static", gather="irradiance")[1]
    )
    assert keys(update="relit") == keys(update="relit", denoise=0)
