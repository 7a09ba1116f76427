"""The probe volume: what is refused, where probes are; directions."""

import numpy as np
import pytest
from support.synthetic_bake import random_scene

from gibench.errors import BadInput
from gibench.techniques.parts.directions import random_rotation, spherical_fibonacci
from gibench.techniques.parts.probe_volume import fit_counts, fit_volume, given_volume


def test_a_volume_that_misses_the_scene():
    scene = random_scene(np.random.default_rng(0))
    counts, spacing = (4, 4, 4), (0.5, 0.5, 0.5)
    with pytest.raises(BadInput, match="misses the scene 'soup'"):
        given_volume(scene, counts, (10.0, 0.0, 0.0), spacing)
    volume = given_volume(scene, counts, (1.0, 0.0, 0.0), spacing)
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
    volume = fit_volume(*scene.bounds, (4, 3, 5))
    low, high = scene.bounds
    np.testing.assert_allclose(volume.positions.min(axis=0) - low, np.array(volume.spacing) / 2)
    np.testing.assert_allclose(high - volume.positions.max(axis=0), np.array(volume.spacing) / 2)


def test_a_scrolled_volume_keeps_what_it_still_covers():
    scene = random_scene(np.random.default_rng(0))
    volume = given_volume(scene, (4, 5, 3), (-1.0, -1.0, -1.0), (0.5, 0.4, 0.5))
    moved = volume.scrolled((0.3, -1.7, -0.5))
    assert moved.scroll == (1, -4, 0)
    before, after = volume.positions, moved.positions
    assert len({tuple(np.round(p, 6)) for p in after}) == 60
    same = (np.abs(before - after) < 1e-9).all(axis=1)
    # 3 of 4 columns and 1 of 5 layers are still covered, and lie where they lay.
    assert same.sum() == 3 * 1 * 3
    np.testing.assert_allclose(after.mean(axis=0), [0.25, -1.8, -0.5], atol=1e-9)


def test_directions_and_rotations_are_uniform():
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
