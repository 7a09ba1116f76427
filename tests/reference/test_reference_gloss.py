"""The truth of gloss: in a furnace, and of a light that it can be told from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.reference_scenes import quad, scene_of

from gibench.errors import BadInput
from gibench.reference.glossy import reference_gloss, reference_lobe
from gibench.scene.environment import Environment
from gibench.scene.model import Camera, Material


def floor_of(material):
    corners = quad((-5, 0, -5), (0, 0, 10), (10, 0, 0))
    return scene_of(np.array(corners), 0, [material])


def reflected_share(n_v, alpha, f0):
    """Reflectance times cosine over all directions, by quadrature over the hemisphere."""
    mu = (np.arange(800) + 0.5) / 800
    turn = (np.arange(800) + 0.5) / 800 * 2 * np.pi
    n_l, phi = np.meshgrid(mu, turn, indexing="ij")
    across = np.sqrt(1 - n_l**2)
    view = np.array([np.sqrt(1 - n_v**2), 0, n_v])
    light = np.stack([across * np.cos(phi), across * np.sin(phi), n_l], axis=-1)
    half = light + view
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    facets = alpha**2 / (np.pi * (half[..., 2] ** 2 * (alpha**2 - 1) + 1) ** 2)
    k = alpha / 2
    seen = 1 / ((n_l * (1 - k) + k) * (n_v * (1 - k) + k))
    fresnel = f0 + (1 - f0) * (1 - half @ view) ** 5
    return (fresnel * facets * seen / 4 * n_l).mean() * 2 * np.pi


@pytest.mark.parametrize(
    ("roughness", "metalness", "tilt"), [(0.5, 1.0, 0.3), (1.0, 1.0, 1.2), (0.7, 0.0, 1.0)]
)
def test_in_a_furnace(roughness, metalness, tilt):
    """Under a sky of one radiance: that times what the reflectance sums up to."""
    material = Material("floor", (0.6, 0.6, 0.6), roughness=roughness, metalness=metalness)
    scene = replace(floor_of(material), environment=Environment.constant((2.0, 2.0, 2.0)))
    eye = np.array([np.sin(tilt), np.cos(tilt), 0.0])
    camera = Camera(tuple(3 * eye), (0.0, 0.0, 0.0), 1.0, up=(0.0, 0.0, 1.0))
    found = reference_gloss(scene, camera, 4, 4, paths=4096)
    f0 = 0.6 if metalness else 0.04
    expected = 2 * reflected_share(np.cos(tilt), roughness**2, f0)
    mean, error = found.value.mean(), np.sqrt((found.stderr**2).mean() / 16)
    assert abs(mean - expected) < 5 * error + 2e-3 * expected
    assert error < 0.01 * expected


def test_light_from_one_side_alone():
    """A wall that glows is seen in the floor before it, and not from behind."""
    wall = quad((2, 0, -5), (0, 0, 10), (0, 5, 0))
    floor = quad((-5, 0, -5), (0, 0, 10), (10, 0, 0))
    materials = [
        Material("floor", (0.8, 0.8, 0.8), roughness=0.2, metalness=1.0),
        Material("wall", (0.0, 0.0, 0.0), (3.0, 3.0, 3.0)),
    ]
    scene = scene_of(np.array([*floor, *wall]), [0, 0, 1, 1], materials)
    towards = Camera((-2, 1, 0), (0, 0, 0), 1.0)
    away = Camera((1.5, 1, 0), (0, 0, 0), 1.0)
    facing, turned = (reference_gloss(scene, c, 2, 2, paths=512).value for c in (towards, away))
    assert facing.min() > 1.5
    assert turned.max() < 0.05 * facing.min()


def lobe_share(mirrored, exponent, sees):
    """What of a lobe (n + 1) / (2 pi) cos^n about ``mirrored`` falls where ``sees`` says, by
    quadrature."""
    mu = ((np.arange(1500) + 0.5) / 1500) ** (1 / (exponent + 1))  # equal shares
    turn = (np.arange(1500) + 0.5) / 1500 * 2 * np.pi
    mu, turn = np.meshgrid(mu, turn, indexing="ij")
    across = np.sqrt(1 - mu**2)
    first = np.cross(mirrored, (0.0, 0.0, 1.0))
    first /= np.linalg.norm(first)
    second = np.cross(first, mirrored)
    light = mu[..., None] * mirrored + across[..., None] * (
        np.cos(turn)[..., None] * first + np.sin(turn)[..., None] * second
    )
    return sees(light).mean()


@pytest.mark.parametrize(("exponent", "half_vector"), [(1.0, False), (20.0, False), (20.0, True)])
def test_a_lobe_gathers_what_it_covers(exponent, half_vector):
    """A wall that glows before a floor that the camera sees at a slant; the sky is dark."""
    wall = quad((2, 0, -3), (0, 0, 6), (0, 1.5, 0))
    floor = quad((-5, 0, -5), (0, 0, 10), (10, 0, 0))
    materials = [Material("floor", (0.8, 0.8, 0.8)), Material("wall", (0, 0, 0), (3.0, 2.0, 1.0))]
    scene = scene_of(np.array([*floor, *wall]), [0, 0, 1, 1], materials)
    camera = Camera((-2, 1, 0), (0, 0, 0), 0.1)
    found = reference_lobe(scene, camera, 2, 2, exponent, half_vector=half_vector, paths=4096)

    def sees(d):
        far = 2 / np.maximum(d[..., 0], 1e-9)
        y, z = far * d[..., 1], far * d[..., 2]
        return (d[..., 0] > 0) & (y > 0) & (y < 1.5) & (np.abs(z) < 3)

    view = np.array([-2.0, 1.0, 0.0]) / np.sqrt(5)

    def mirrors_to(half):
        return sees(2 * (half @ view)[..., None] * half - view)

    if half_vector:  # drawn about the normal
        share = lobe_share(np.array([0.0, 1.0, 0.0]), exponent, mirrors_to)
    else:
        share = lobe_share(view * (-1, 1, 1), exponent, sees)
    assert 0.1 < share < 0.95
    mean, error = found.value.mean(axis=(0, 1)), np.sqrt((found.stderr**2).mean(axis=(0, 1)) / 4)
    # 6 standard errors, known from 16 rounds alone: no channel of 10^5 runs is beyond.
    assert (np.abs(mean - share * np.array([3.0, 2.0, 1.0])) < 6 * error + 2e-3 * share).all()
    assert (error < 0.03 * mean).all()


def test_too_few_paths_are_refused():
    scene = floor_of(Material("floor"))
    with pytest.raises(BadInput, match="no standard error"):
        reference_lobe(scene, Camera((0, 1, 0), (0, 0, 0), up=(0, 0, 1)), 2, 2, 20.0, paths=4)
    with pytest.raises(BadInput, match="no standard error"):
        reference_gloss(scene, Camera((0, 1, 0), (0, 0, 0), up=(0, 0, 1)), 2, 2, paths=4)
