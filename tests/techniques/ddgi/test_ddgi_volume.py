"""DDGI's settings and volume: what is refused, where probes are, which rays they cast."""

import numpy as np
import pytest
from support.synthetic_bake import random_scene

from gibench.errors import BadInput
from gibench.techniques.ddgi import SPEC
from gibench.techniques.ddgi.volume import (
    fit_counts,
    make_volume,
    random_rotation,
    ray_directions,
    spherical_fibonacci,
)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"probes": 0}, "0 probes"),
        ({"probes": -5}, "-5 probes"),
        ({"rays": 0}, "0 rays"),
        ({"rays": 32}, "32 of 32 rays are fixed"),
        ({"fixed_rays": -1}, "fixed"),
        ({"counts": "20x-10x10"}, "20x-10x10"),
        ({"counts": "20x0x10"}, "20x0x10"),
        ({"counts": "many"}, "many"),
        ({"storage": "fp8"}, "fp16 or fp32|fp32 or fp16"),
        ({"hysteresis": 1.0}, "hysteresis"),
        ({"hysteresis": float("nan")}, "finite"),
        ({"gamma": 0.0}, "gamma"),
        ({"irradiance_texels": 1}, "irradiance_texels"),
        ({"normal_bias": -0.1}, "normal_bias"),
        ({"crush_threshold": 2.0}, "crush_threshold"),
        ({"origin": "0,0,0", "spacing": "1,1,1"}, "without counts"),
        ({"origin": "0,0,0", "counts": "2x2x2"}, "go together"),
        ({"origin": "0,0", "spacing": "1,1,1", "counts": "2x2x2"}, "origin is '0,0'"),
        ({"origin": "0,0,0", "spacing": "1,0,1", "counts": "2x2x2"}, "spacing"),
    ],
)
def test_nonsense_gets_one_clear_line(values, message):
    with pytest.raises(BadInput, match=message) as caught:
        SPEC.settings(values)
    assert "\n" not in str(caught.value)


def test_every_setting_says_what_it_does():
    for field in SPEC.settings_type.__dataclass_fields__.values():
        assert len(field.metadata["help"]) > 10
        assert "unit" in field.metadata


def test_a_volume_that_misses_the_scene():
    scene = random_scene(np.random.default_rng(0))
    place = {"spacing": "0.5,0.5,0.5", "counts": "4x4x4"}
    with pytest.raises(BadInput, match="misses the scene 'soup'"):
        make_volume(scene, SPEC.settings({"origin": "10,0,0", **place}))
    volume = make_volume(scene, SPEC.settings({"origin": "1,0,0", **place}))
    assert volume.origin == (1.0, 0.0, 0.0)
    np.testing.assert_allclose(volume.positions[-1], [2.5, 1.5, 1.5])


@pytest.mark.parametrize("budget", [1, 2, 7, 64, 2000, 30_000])
def test_fit_uses_the_budget_on_cubes(budget):
    low, extent = np.zeros(3), np.array([23.0, 9.0, 14.0])
    counts = fit_counts(low, extent, budget)
    assert np.prod(counts) <= budget
    if budget >= 2000:
        cell = extent / counts
        assert np.prod(counts) > 0.9 * budget
        assert cell.max() / cell.min() < 1.2


def test_the_fitted_volume_lies_inside_the_scene():
    scene = random_scene(np.random.default_rng(0))
    volume = make_volume(scene, SPEC.settings({"counts": "4x3x5"}))
    low, high = scene.bounds
    np.testing.assert_allclose(volume.positions.min(axis=0) - low, np.array(volume.spacing) / 2)
    np.testing.assert_allclose(high - volume.positions.max(axis=0), np.array(volume.spacing) / 2)


def test_a_scrolled_volume_keeps_what_it_still_covers():
    scene = random_scene(np.random.default_rng(0))
    volume = make_volume(
        scene, SPEC.settings({"origin": "-1,-1,-1", "spacing": "0.5,0.4,0.5", "counts": "4x5x3"})
    )
    moved = volume.scrolled((0.3, -1.7, -0.5))
    assert moved.scroll == (1, -4, 0)
    before, after = volume.positions, moved.positions
    assert len({tuple(np.round(p, 6)) for p in after}) == 60
    same = (np.abs(before - after) < 1e-9).all(axis=1)
    # 3 of 4 columns and 1 of 5 layers are still covered, and lie where they lay.
    assert same.sum() == 3 * 1 * 3
    np.testing.assert_allclose(after.mean(axis=0), [0.25, -1.8, -0.5], atol=1e-9)


def test_ray_directions():
    for count in (32, 224):
        d = spherical_fibonacci(count)
        np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, atol=1e-12)
        # Evenly spread: moments up to the second are those of the sphere.
        assert np.abs(d.mean(axis=0)).max() < 0.02
        np.testing.assert_allclose(d.T @ d / count, np.eye(3) / 3, atol=0.02)
    rng = np.random.default_rng(0)
    turned = np.array([random_rotation(rng) for _ in range(4000)])
    np.testing.assert_allclose(turned @ turned.transpose(0, 2, 1), np.tile(np.eye(3), (4000, 1, 1)),
                               atol=1e-12)  # fmt: skip
    assert (np.linalg.det(turned) > 0).all()
    # Uniform: every entry of the matrix has mean 0 and mean square 1/3.
    assert np.abs(turned.mean(axis=0)).max() < 0.05
    np.testing.assert_allclose((turned**2).mean(axis=0), 1 / 3, atol=0.03)
    settings = SPEC.settings({})
    a, b = ray_directions(settings, 1, 3), ray_directions(settings, 1, 4)
    assert a.shape == (256, 3)
    np.testing.assert_array_equal(a[:32], b[:32])
    assert np.abs(a[32:] - b[32:]).max() > 0.1
    np.testing.assert_array_equal(a, ray_directions(settings, 1, 3))
