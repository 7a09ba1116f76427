"""Glossy reflection of SRP's light of order 1, against float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.srp_pixels import drawn
from support.srp_setups import create
from support.synthetic_bake import random_bake, random_lightmap, random_scene

from gibench.errors import BadInput
from gibench.scene.gloss import GlossMaps, gloss_at
from gibench.techniques.srp import SPEC

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def glossy_scene(rng, maps):
    """Random materials, and images of roughness and metalness on half of the triangles."""
    scene = random_scene(rng, 300)
    materials = tuple(
        replace(m, roughness=float(rng.uniform(0.5, 1)), metalness=float(rng.uniform(0, 1)))
        for m in scene.materials
    )
    scene = replace(scene, materials=materials)
    if not maps:
        return scene
    triangle = np.arange(0, len(scene.triangles), 2, dtype=np.int32)
    images = tuple(
        rng.uniform(0.7, 1, (*shape, 2)).astype(np.float32) for shape in ((3, 5), (8, 4))
    )
    uvs = rng.uniform(-2, 2, (len(triangle), 3, 2)).astype(np.float32)
    image = rng.integers(0, 2, len(triangle)).astype(np.int32)
    return replace(scene, gloss_maps=GlossMaps(images, triangle, image, uvs))


def reflected(signal, normal, view, gloss, albedo):
    """One light from afar by GGX, Schlick's shadowing and Fresnel terms: (3,) in float64."""
    slope = signal[1:] @ LUMINANCE
    light = slope / np.linalg.norm(slope)
    power = np.maximum(2 * light @ signal[1:], 0)
    n_l, n_v = normal @ light, normal @ view
    if n_l <= 0 or n_v <= 0:
        return np.zeros(3)
    half = (light + view) / np.linalg.norm(light + view)
    alpha = max(gloss[0] ** 2, 1e-3)
    facets = alpha**2 / (np.pi * ((normal @ half) ** 2 * (alpha**2 - 1) + 1) ** 2)
    k = alpha / 2
    seen = n_l / (n_l * (1 - k) + k) * n_v / (n_v * (1 - k) + k)
    f0 = 0.04 + (albedo - 0.04) * gloss[1]
    fresnel = f0 + (1 - f0) * (1 - view @ half) ** 5
    return fresnel * facets * seen / (4 * n_l * n_v) * n_l * power


@pytest.mark.parametrize(
    ("variant", "size", "maps"),
    [("published", 7, False), ("tuned", 64, True), ("tuned", 100, False)],
)
def test_light_that_a_glossy_surface_reflects(rng, variant, size, maps):
    scene = glossy_scene(rng, maps)
    lightmap = random_lightmap(rng, scene, 300, 23, 29)
    bake = random_bake(rng, lightmap, order=1, receiver_order=1, samples=20)
    technique = create(bake, scene, lightmap, variant, size, {"gloss": True})
    values = rng.uniform(0, 2, (29, 23, 4, 4)).astype(np.float32)
    values[..., 1:, :] -= 1
    pixels = drawn(technique, size, values)
    found, signal = pixels.found, pixels.signal
    factors = np.array([(m.roughness, m.metalness) for m in scene.materials])
    gloss = factors[scene.material_ids[pixels.triangle]]
    if maps:
        gloss = gloss_at(scene.gloss_maps, gloss, pixels.triangle, pixels.weights)
    slope = signal[:, 1:] @ LUMINANCE
    steep = np.linalg.norm(slope, axis=1)
    # Where the light comes from is known the less the flatter it is; what just faces it, or the
    # camera, reflects or not by rounding.
    lights = slope / np.maximum(steep, 1e-9)[:, None]
    sure = steep > 0.1
    for towards in (lights, pixels.view):
        sure &= np.abs(np.einsum("nx,nx->n", found.normal, towards)) > 0.02
    assert sure.sum() > 20
    wanted = np.array([
        albedo / np.pi * (1 - g[1]) * np.maximum(s[0], 0) + reflected(s, n, v, g, albedo)
        for s, n, v, g, albedo in zip(
            signal[sure], found.normal[sure], pixels.view[sure], gloss[sure], found.albedo[sure],
            strict=True,
        )
    ])  # fmt: skip
    np.testing.assert_allclose(pixels.indirect[sure], wanted, rtol=2e-3, atol=2e-3)


def test_gloss_needs_light_of_order_1():
    with pytest.raises(BadInput, match="gloss needs light of order 1"):
        SPEC.settings({"gloss": True})
