"""Figures of faults against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from gibench.measure.statistics import faults
from gibench.measure.statistics.blotches import FAR, FlatError, band, blotches
from gibench.reference.luminance import LUMINANCE


def grey(values):
    return np.repeat(np.asarray(values, np.float64)[:, None], 3, axis=1)


def room(rng, lit=900, dark=100):
    """A truth: light of about 1, and a dark part without any; its receivers' areas."""
    truth = grey(np.concatenate([rng.uniform(0.9, 1.1, lit), np.zeros(dark)]))
    return truth, np.full_like(truth, 1e-4), rng.uniform(0.5, 1.5, lit + dark)


def test_a_leak_is_the_light_in_the_dark_over_the_mean_of_the_truth(rng):
    truth, stderr, area = room(rng)
    everywhere = np.ones(len(truth), bool)
    extra = rng.uniform(0.0, 0.3, 100)
    result = truth * 1.5  # a bias of the lit part is no leak
    result[900:] += grey(extra)
    stderr[900:] *= 20  # more than that of a receiver at the limit of what is dark
    noise = faults.SIGMAS * 2e-3 * np.sqrt((LUMINANCE**2).sum())
    mean = (area * truth[:, 0]).sum() / area.sum()
    over = np.maximum(extra - noise, 0.0)
    wanted = (area[900:] * over).sum() / area[900:].sum() / mean
    found = faults.leak(result, truth, stderr, area, everywhere)
    assert found == pytest.approx(wanted, rel=1e-9)
    assert faults.leak(truth, truth, stderr, area, everywhere) == 0
    assert np.isnan(faults.leak(result, truth, stderr, area, truth[:, 0] > 0))
    bright = truth + 1.0  # nothing is dark
    assert np.isnan(faults.leak(bright, bright, stderr, area, everywhere))


def test_what_the_truths_noise_could_hide_is_not_dark(rng):
    truth, _, area = room(rng)
    everywhere = np.ones(len(truth), bool)
    unsure = np.full_like(truth, 0.1)
    assert not faults.dark(truth, unsure, area, everywhere).any()
    few = np.zeros(len(truth), bool)
    few[-1] = True  # one receiver of a thousand, of less than a thousandth of the surface
    area[-1] = 1e-6
    truth[900:999] = 1.0
    assert not faults.dark(truth, np.zeros_like(truth), area, everywhere).any()


def test_a_receiver_that_few_paths_found_dark_is_not_known_to_be(rng):
    """Of 16 paths that find light with a chance of 1 in 10, one receiver in 5 finds none."""
    drawn = rng.random((2000, 16)) < 0.1
    value = grey(10.0 * drawn.mean(axis=1))
    stderr = grey(10.0 * drawn.std(axis=1, ddof=1) / 4)
    area, everywhere = np.ones(2000), np.ones(2000, bool)
    assert (value == 0).all(axis=1).any()
    assert not faults.dark(value, stderr, area, everywhere).any()
    assert np.isnan(faults.leak(value + 1, value, stderr, area, everywhere))


def test_flicker_of_noise_of_known_size(rng):
    frames, receivers, share = 64, 4000, 0.05
    moments = faults.Moments()
    mean = rng.uniform(0.5, 2.0, receivers)
    mean[:400] = 1e-3  # too dark to be seen flickering
    drawn = []
    for _ in range(frames):
        values = mean * (1 + share * rng.normal(size=receivers))
        values[:400] = mean[:400] * rng.uniform(0, 2, 400)
        drawn.append(values)
        moments.add(values)
    np.testing.assert_allclose(moments.mean, np.mean(drawn, axis=0), rtol=1e-12)
    np.testing.assert_allclose(moments.deviation, np.std(drawn, axis=0, ddof=1), rtol=1e-9)
    # A sample variance of normal noise is chi-squared; 5 standard errors of each percentile.
    for found, at in zip(faults.flicker(moments), (0.5, 0.99), strict=True):
        spread = np.sqrt(at * (1 - at) / 3600)
        low, high = (
            share * np.sqrt(chi2.ppf(np.clip(at + side * 5 * spread, 0, 0.9999), frames - 1) / 63)
            for side in (-1, 1)
        )
        assert 0.99 * low < found < 1.01 * high
    assert all(np.isnan(faults.flicker(faults.Moments())))


@pytest.mark.parametrize("stays", [0.5, 0.9, 0.97])
def test_lag_of_an_exponential(rng, stays):
    """1 - stays^n is half way after ln(1/2) / ln(stays) frames, 95 % after ln(1/20) / ln(stays)."""
    old, new = rng.random((2, 500))
    area = rng.uniform(0.5, 1.5, 500)
    shares = [faults.progress(new + (old - new) * stays**n, old, new, area) for n in range(1, 200)]
    exact = 1 - stays ** np.arange(1, 200)  # half of the way is a half to the last digit
    np.testing.assert_allclose(shares, exact, atol=1e-12)
    for share in (faults.HALF, faults.NEARLY):
        wanted = np.ceil(np.log(1 - share) / np.log(stays) - 1e-9)
        assert faults.frames_until(exact, share) == wanted
    assert faults.frames_until(shares[:2], 0.999) == np.inf
    still = np.zeros(500)
    assert faults.changes(old, new, area, still)
    assert not faults.changes(old, old * 1.005, area, still)
    assert not faults.changes(old, new, area, np.full(500, 10.0))


def test_missing_is_what_is_uncovered_or_black_where_the_truth_is_lit(rng):
    truth, stderr, _ = room(rng)
    covered = np.ones(1000, bool)
    assert faults.missing(truth, covered, truth, stderr) == 0  # black where it should be
    result = truth.copy()
    result[3] = 0.0
    assert faults.missing(result, covered, truth, stderr) == pytest.approx(1 / 1000)
    covered[[3, 950]] = False
    assert faults.missing(result, covered, truth, stderr) == pytest.approx(2 / 1000)


@pytest.mark.parametrize("near", [1.5, 3.0])
@pytest.mark.parametrize("length", [12.0, 40.0])
def test_the_band_of_a_wave(near, length):
    """A Gaussian of s texels lets exp(-(2 pi s / l)^2 / 2) of a wave of l texels through."""
    side = 260
    x = np.arange(side)
    wave = 0.1 * np.sin(2 * np.pi * x / length + 0.3)
    error = np.tile(wave, (side, 1))
    one = FlatError(error, np.zeros_like(error), np.ones_like(error), near)
    kept, noise = band(one)
    k = 2 * np.pi / length
    through = np.exp(-((k * near) ** 2) / 2) - np.exp(-((k * FAR * near) ** 2) / 2)
    inner = slice(60, 200)  # beyond the reach of the edges
    np.testing.assert_allclose(kept[inner, inner], through * error[inner, inner], atol=2e-4)
    assert not noise.any()
    whole = FlatError(np.ones((90, 90)), np.zeros((90, 90)), np.ones((90, 90)), near)
    assert blotches([whole]) == pytest.approx(0, abs=1e-12)  # a bias is none
    assert np.isnan(blotches([]))


def test_the_truths_noise_is_taken_out_of_blotches(rng):
    weight = rng.uniform(0.2, 1.0, (48, 48))
    weight[:10, :10] = 0.0
    variance = rng.uniform(0.5, 1.5, (48, 48)) * 0.01
    found = []
    for _ in range(200):
        error = rng.normal(size=(48, 48)) * np.sqrt(variance)
        kept, noise = band(FlatError(error, variance, weight, 1.5))
        assert not kept[:10, :10].any()
        found.append((weight * kept**2).sum())
    wanted = (weight * noise).sum()
    spread = np.std(found) / np.sqrt(len(found))
    assert abs(np.mean(found) - wanted) < 5 * spread
