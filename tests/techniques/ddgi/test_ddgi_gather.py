"""The probes' light at receivers and at the camera's pixels, against float64 NumPy."""

import numpy as np
import pytest
from support.ddgi_oracle import (
    SMALL,
    VARIANTS,
    bias_of,
    create,
    gather,
    randomise,
    state_of,
    surface,
)
from support.launches import run_pass
from support.pairwise import pairwise
from support.shading_oracle import render
from support.synthetic_bake import random_lightmap, random_scene

from gibench.rays.embree import EmbreeTracer
from gibench.techniques.parts.camera_table import camera_table


@pytest.fixture(scope="module")
def scene():
    return random_scene(np.random.default_rng(7), 80)


@pytest.mark.parametrize(
    ("more", "storage", "variant", "size"),
    pairwise(
        [
            {},
            {"gamma": 1.0, "normal_bias": 0.4},
            {"average": "encoded"},
            {"average": "encoded", "gamma": 3.3},
        ],
        ["fp16", "fp32"],
        VARIANTS,
        [7, 64],
        more={0: [{"gamma": 3.3}]},
    ),
)
def test_gather_at_receivers(scene, variant, storage, size, more):
    rng = np.random.default_rng(3)
    lightmap = random_lightmap(rng, scene, 300, 20, 20)
    # The volume is smaller than the scene: some receivers lie outside it.
    place = {"origin": "-0.6,-0.5,-0.4", "spacing": "0.3,0.4,0.5"}
    settings = {**SMALL, **place, "storage": storage, **more}
    technique = create(scene, settings, variant, size, lightmap)
    randomise(technique, rng, states=(0, 2, 3, 3, 3))
    technique.probes.scroll_to((0.7, 0.1, -0.4))
    s = state_of(technique)
    r = lightmap.receivers
    normal = r.normal.astype(np.float64)
    bias = bias_of(s, normal, normal)
    expected, certain = gather(s, r.position.astype(np.float64), bias, normal)
    found = technique.indirect_irradiance()
    assert certain.mean() > 0.9
    np.testing.assert_allclose(found[certain], expected[certain], rtol=1e-3, atol=1e-5)
    assert (expected == 0).all(axis=1).any()
    assert (expected > 0).mean() > 0.4


@pytest.mark.parametrize("size", [7, 64])
def test_application(scene, size):
    rng = np.random.default_rng(size)
    technique = create(scene, SMALL, image=(21, 19), size=size)
    randomise(technique, rng, states=(0, 3, 3))
    technique.begin_frame(40)
    run_pass(technique, "camera", size)
    run_pass(technique, "application", size)
    found = technique.device.read(technique.scene.image)
    s, camera = state_of(technique), scene.cameras[0]
    view = render(scene, 40, 21, 19)
    # The indirect part, from the pixels' own rays.
    eye, forward, right, up = camera_table(camera, 21, 19).astype(np.float64).reshape(4, 3)
    y, x = np.divmod(np.arange(21 * 19), 21)
    d = forward + ((x + 0.5) / 21 * 2 - 1)[:, None] * right + (1 - (y + 0.5) / 19 * 2)[:, None] * up
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    origin = np.broadcast_to(eye, d.shape).astype(np.float32)
    hits = EmbreeTracer(scene.corners).closest(origin, d.astype(np.float32))
    hit = np.flatnonzero(hits.triangle >= 0)
    f = surface(scene, hits.triangle[hit], *(a[hit].astype(np.float64) for a in (hits.u, hits.v)))
    bias = bias_of(s, f.geometric, -d[hit])
    irradiance, inside = gather(s, f.position, bias, f.normal)
    front = np.einsum("ij,ij->i", f.geometric, d[hit]) < 0
    indirect, certain = np.zeros((399, 3)), view.certain.ravel()
    indirect[hit] = np.where(front[:, None], f.albedo / np.pi * irradiance, 0)
    certain[hit] &= inside
    expected = view.direct.reshape(-1, 3) + indirect
    assert certain.mean() > 0.8
    assert indirect[certain].max() > 0.1
    np.testing.assert_allclose(
        found.reshape(-1, 3)[certain], expected[certain], rtol=2e-3, atol=2e-5
    )
    images = technique.images()
    np.testing.assert_array_equal(images["frame"], found)
    np.testing.assert_allclose(
        images["frame"], images["direct only"] + images["indirect only"], rtol=1e-5, atol=1e-6
    )
