"""The patches that compression is judged under."""

from __future__ import annotations

import numpy as np
import pytest
from support.tiny_scenes import room

from gibench.rays.embree import EmbreeTracer
from gibench.techniques.srp.bake.data import ProbeSet, RelightSamples
from gibench.techniques.srp.bake.expected_light import SKY_COLUMNS, SKY_ROWS, expected_light
from gibench.techniques.srp.bake.relight import relight_samples
from gibench.techniques.srp.bake.sh import sh_basis


@pytest.fixture(scope="module")
def setting():
    scene, lightmap = room(10)
    rng = np.random.default_rng(11)
    positions = rng.uniform([-0.7, 0.3, -0.7], [0.7, 2.1, 0.7], (5, 3)).astype(np.float32)
    tracer = EmbreeTracer(scene.corners)
    relight = relight_samples(scene, lightmap, ProbeSet(positions, 1.0), tracer, 3, 300)
    return lightmap, relight


def test_every_relight_ray_is_in_one_patch_of_its_side(setting):
    lightmap, relight = setting
    patch = expected_light(lightmap, relight).patch
    assert np.array_equal(patch < 0, relight.texel == -2)
    hit = relight.texel >= 0
    assert hit.any()
    normals = lightmap.receivers.normal[lightmap.receiver_of_texel[relight.texel[hit]]]
    for one in np.unique(patch[hit]):
        facing = normals[patch[hit] == one]
        axis = np.abs(facing[0]).argmax()
        assert (np.abs(facing).argmax(axis=1) == axis).all()
        assert (np.sign(facing[:, axis]) == np.sign(facing[0, axis])).all()


def test_columns_add_up_to_what_the_probes_see(rng, setting):
    """Patches of random radiance: by columns, and by every ray on its own in float64."""
    lightmap, relight = setting
    light = expected_light(lightmap, relight)
    probes = np.sort(rng.choice(5, 3, replace=False)).astype(np.int32)
    shine = rng.random(light.patch.max() + 1)
    seen = np.unique(light.patch[probes])
    seen = seen[seen >= 0]
    columns = light.columns(probes)
    assert columns.shape == (3 * 16, len(seen))
    rays = np.where(light.patch[probes] >= 0, shine[light.patch[probes]], 0.0)
    expected = rays @ relight.basis.astype(np.float64)
    found = (columns.astype(np.float64) @ shine[seen]).reshape(3, 16)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_the_sky_is_cut_into_cells_of_equal_size(setting):
    lightmap, _ = setting
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((20_000, 3))
    directions = (directions / np.linalg.norm(directions, axis=1)[:, None]).astype(np.float32)
    escaped = np.full((1, len(directions)), -1, np.int32)
    sky = RelightSamples(directions, sh_basis(0, directions).astype(np.float32), escaped)
    patch = expected_light(lightmap, sky).patch[0]
    count = np.unique(patch, return_counts=True)[1]
    cells = SKY_ROWS * SKY_COLUMNS
    assert len(count) == cells
    # Binomial: 156 +- 12.5 of 20 000 in each of 128 cells.
    assert np.abs(count - len(directions) / cells).max() < 5.5 * np.sqrt(len(directions) / cells)


def test_probes_that_see_nothing_give_no_columns(setting):
    lightmap, relight = setting
    black = RelightSamples(relight.directions, relight.basis, np.full_like(relight.texel, -2))
    assert expected_light(lightmap, black).columns(np.array([0, 2], np.int32)).shape == (32, 0)
