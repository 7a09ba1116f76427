"""Surfaces shaded with normal maps: direct light in the camera's pass, SRP's light of order 1."""

from __future__ import annotations

import numpy as np
import pytest
from support.glow_scenes import bumpy
from support.normal_map_oracle import mapped
from support.shading_oracle import direct_irradiance
from support.srp_pixels import drawn
from support.srp_setups import VARIANTS, create
from support.synthetic_bake import random_bake, random_lightmap, random_scene

from gibench.errors import BadInput
from gibench.techniques.srp import SPEC


@pytest.mark.parametrize(("variant", "size"), [("published", 7), ("tuned", 64), ("tuned", 100)])
def test_light_at_the_mapped_normal(rng, variant, size):
    """Where each pixel's ray hits is taken from what the camera's pass keeps of it."""
    scene = bumpy(random_scene(rng), rng)
    lightmap = random_lightmap(rng, scene, 300, 23, 29)
    bake = random_bake(rng, lightmap, order=1, receiver_order=1, samples=20)
    technique = create(bake, scene, lightmap, variant, size, {"normal_maps": True})
    values = rng.uniform(0, 2, (29, 23, 4, 4)).astype(np.float32)
    values[..., 1:, :] -= 1
    pixels = drawn(technique, size, values)
    found = pixels.found
    bent = np.array([
        mapped(scene, t, w, n, g)
        for t, w, n, g in zip(
            pixels.triangle, pixels.weights, found.normal, found.geometric, strict=True
        )
    ])  # fmt: skip
    # A normal at a right angle to the triangle's falls to either side of the rule by rounding.
    sure = np.abs(np.einsum("nx,nx->n", bent, found.geometric)) > 0.02
    gradient = np.einsum("nx,nxc->nc", bent - found.normal, pixels.signal[:, 1:])
    wanted = found.albedo / np.pi * np.maximum(pixels.signal[:, 0] + gradient, 0)
    np.testing.assert_allclose(pixels.indirect[sure], wanted[sure], rtol=0, atol=5e-3)
    assert np.abs(bent - found.normal).max(axis=1)[sure].max() > 0.2
    lit = direct_irradiance(scene, 3, found.position, bent, found.geometric)
    wanted = found.emission + found.albedo / np.pi * lit.irradiance
    certain = sure & lit.certain
    assert certain.mean() > 0.6
    scale = 1 + np.abs(wanted).max(axis=1, keepdims=True)
    got = pixels.direct / scale
    np.testing.assert_allclose(got[certain], (wanted / scale)[certain], rtol=0, atol=5e-3)


@pytest.mark.parametrize("variant", VARIANTS)
def test_without_maps_nothing_differs(variant):
    """A scene without normal maps takes the lookup of irradiance alone, asked or not."""
    rng = np.random.default_rng(6)
    scene = random_scene(rng, 12)
    lightmap = random_lightmap(rng, scene, 100, 19, 17)
    bake = random_bake(rng, lightmap, order=1, receiver_order=1, samples=20)
    asked = create(bake, scene, lightmap, variant, 64, {"normal_maps": True})
    plain = create(bake, scene, lightmap, variant, 64)
    assert asked._application.program == plain._application.program
    assert asked.notes()[1:] == ["the scene has no normal maps to shade with"]
    assert len(plain.notes()) == 1


def test_scalar_light_knows_no_other_normal():
    with pytest.raises(
        BadInput, match=r"order 1 at the receivers; add --set srp\.receiver_order=1"
    ):
        SPEC.settings({"normal_maps": True})
    assert SPEC.settings({"normal_maps": True, "receiver_order": 1}).normal_maps
