"""What of a receiver's light probes can reconstruct: the operator norm of what they lose."""

from __future__ import annotations

import numpy as np
from support.tiny_scenes import quad_scene, room

from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.operator_norm import cosine_vector, operator_norm
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sh import sh_basis


def test_the_cosine_vector_against_quadrature():
    nodes, weights = np.polynomial.legendre.leggauss(64)
    azimuth = (np.arange(128) + 0.5) / 128 * 2 * np.pi
    z, phi = (grid.ravel() for grid in np.meshgrid(nodes, azimuth, indexing="ij"))
    r = np.sqrt(1 - z**2)
    directions = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
    solid_angle = np.repeat(weights, 128) * 2 * np.pi / 128
    normal = np.array([0.48, -0.6, 0.64])
    cosine = np.maximum(directions @ normal, 0.0)
    integral = (sh_basis(9, directions) * (solid_angle * cosine)[:, None]).sum(axis=0)
    np.testing.assert_allclose(cosine_vector(normal[None])[0], integral, atol=2e-3)


def open_ground():
    return quad_scene([((-1.0, 0.0, -1.0), (0.0, 0.0, 2.0), (2.0, 0.0, 0.0))], 3)


def test_under_an_open_sky_a_probe_loses_nothing_a_receiver_would_use():
    """Everything is infinitely far: the round trip is a projection to order 7 and back."""
    scene, lightmap = open_ground()
    probes = ProbeSet(np.array([[0.0, 0.4, 0.0]], np.float32), 4.0)
    settings = SrpBakeSettings(sh_order=7, transport_rays=4096, visibility="exact")
    norms = operator_norm(scene, lightmap, probes, settings, directions=20_000)
    coarse = SrpBakeSettings(sh_order=0, transport_rays=4096, visibility="exact")
    assert norms.max() < 0.12
    assert operator_norm(scene, lightmap, probes, coarse, directions=4000).min() > 0.4


def test_more_probes_and_higher_orders_reconstruct_more():
    scene, lightmap = room()
    places = np.array([[-0.5, 0.8, -0.5], [0.5, 1.6, 0.5], [-0.5, 1.6, 0.6], [0.6, 0.7, -0.6]])
    few = ProbeSet(places[:1].astype(np.float32), 4.0)
    many = ProbeSet(places.astype(np.float32), 4.0)
    settings = [SrpBakeSettings(sh_order=o, transport_rays=512, visibility="exact") for o in (1, 5)]
    low, high = (operator_norm(scene, lightmap, many, s, 1024).mean() for s in settings)
    alone = operator_norm(scene, lightmap, few, settings[1], 1024).mean()
    assert high < low
    assert high < alone
