"""What moves, rests and judges DDGI's probes, against float64 NumPy at several work-group sizes."""

import numpy as np
import pytest
from support.ddgi_oracle import (
    BLENDED,
    FAR,
    SIZES,
    SMALL,
    classified,
    create,
    randomise,
    relocated,
    state_of,
    texel_directions,
)
from support.launches import run_pass
from support.pairwise import few
from support.synthetic_bake import random_scene

from gibench.techniques.ddgi.conform_oracle import OFFSET, VARIABILITY


@pytest.fixture(scope="module")
def scene():
    return random_scene(np.random.default_rng(7), 80)


@pytest.mark.parametrize("size", few(SIZES))
def test_relocation_and_classification(scene, size):
    rng = np.random.default_rng(size)
    settings = {**SMALL, "counts": "9x7x6", "min_frontface_distance": 0.4}
    technique = create(scene, settings)
    randomise(technique, rng)
    s, device, probes = state_of(technique), technique.device, technique.probes
    shape = (len(s.state), s.settings.fixed)
    reach = rng.uniform(0.05, 3.0, (shape[0], 1)) * s.longest
    distance = rng.uniform(0.02, 1, shape) * reach
    distance[rng.random(shape) < 0.1] = FAR
    distance *= np.where(rng.random(shape) < rng.uniform(0, 0.5, (shape[0], 1)), -1, 1)
    distance = distance.astype(np.float32).astype(np.float64)
    device.write(probes.fixed_distance, distance)
    accepted = rng.integers(0, 2, shape[0])
    device.write(probes.accepted, accepted)
    run_pass(technique, "relocation", size)
    found, expected = state_of(technique), relocated(s, distance)
    np.testing.assert_array_equal(found.state, s.state)
    np.testing.assert_allclose(found.offset, expected, rtol=OFFSET.relative, atol=OFFSET.absolute)
    moved = np.linalg.norm(expected - s.offset, axis=1)
    assert 0.1 < (moved > 0).mean() < 0.95
    assert (np.linalg.norm(found.offset / s.spacing, axis=1) < 0.4501).all()
    run_pass(technique, "classification", size)
    after = state_of(technique)
    np.testing.assert_array_equal(after.state, classified(s, distance, accepted))
    np.testing.assert_array_equal(after.offset, found.offset)
    assert len(set(after.state)) == 4


def test_without_classification_all_probes_stay_active(scene):
    technique = create(scene, {**SMALL, "classification": False, "relocation": False, "rays": 20})
    assert technique.probes.settings.blended == 20
    assert "relocation" not in [p.name for p in technique.passes()]
    randomise(technique, np.random.default_rng(0))
    s = state_of(technique)
    accepted = np.arange(len(s.state)) % 2
    technique.device.write(technique.probes.accepted, accepted)
    run_pass(technique, "classification", 7)
    blended = (s.state & BLENDED > 0) | ((s.state & 1 > 0) & (accepted > 0))
    np.testing.assert_array_equal(state_of(technique).state, 1 + blended * BLENDED)


@pytest.mark.parametrize(
    ("counts", "size"),
    [  # every count and every size; all of both are slow
        pytest.param(c, n, marks=() if n in fast else pytest.mark.slow)
        for c, fast in (("1x1x1", (7,)), ("5x3x2", (1, 64, 100)), ("20x10x10", (33, 256)))
        for n in (*SIZES, 33, 256)
    ],
)
def test_average_variability_is_the_exact_mean(scene, size, counts):
    rng = np.random.default_rng(size)
    settings = {**SMALL, "counts": counts, "rays": 14, "irradiance_texels": 6}
    technique = create(scene, settings, size=size)
    randomise(technique, rng, states=(0, 1, 2, 3, 3) if counts != "1x1x1" else (3,))
    values = rng.lognormal(0, 2, technique.probes.variability.shape).astype(np.float32)
    technique.device.write(technique.probes.variability, values)
    run_pass(technique, "variability", size)
    exact = values[state_of(technique).state == 3].astype(np.float64).mean()
    assert technique.average_variability() == pytest.approx(exact, rel=VARIABILITY.relative)


def test_average_variability_of_no_probe(scene):
    technique = create(scene, SMALL)
    randomise(technique, np.random.default_rng(0), states=(0, 1, 2))
    technique.device.write(
        technique.probes.variability, np.ones(technique.probes.variability.shape)
    )
    run_pass(technique, "variability", 64)
    assert technique.average_variability() == 0.0


def test_texel_directions_cover_the_sphere():
    for side in (4, 6, 14):
        assert np.abs(texel_directions(side).mean(axis=0)).max() < 1e-12
