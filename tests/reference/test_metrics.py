"""Error metrics against hand-computed values, packages, and noise that should count as none."""

import numpy as np
import pytest

from gibench.errors import BadInput, CannotRun
from gibench.reference import metrics
from gibench.reference.metrics import Measure

NO_NOISE = np.zeros((2, 3))
REFERENCE = np.array([[1.0, 2.0, 4.0], [2.0, 2.0, 1.0]])
RESULT = np.array([[1.5, 2.0, 3.0], [2.0, 2.0, 3.0]])


def test_bias_by_hand():
    assert metrics.bias(RESULT, REFERENCE, NO_NOISE).value == pytest.approx(1.5 / 12)
    weighted = metrics.bias(RESULT, REFERENCE, NO_NOISE, np.array([3.0, 1.0]))
    assert weighted.value == pytest.approx((3 * -0.5 + 2) / (3 * 7 + 5))
    noise = np.full((2, 3), 0.1)
    assert metrics.bias(RESULT, REFERENCE, noise).noise == pytest.approx(
        1.96 * 0.1 * np.sqrt(6) / 12
    )


def test_relative_l2_by_hand():
    assert metrics.relative_l2(RESULT, REFERENCE, NO_NOISE).value == pytest.approx(
        np.sqrt((0.25 + 1 + 4) / (1 + 4 + 16 + 4 + 4 + 1))
    )


def test_relative_mse_by_hand():
    dark = 0.01 * (12 / 6) ** 2
    expected = (0.25 / (1 + dark) + 1 / (16 + dark) + 4 / (1 + dark)) / 6
    assert metrics.relative_mse(RESULT, REFERENCE, NO_NOISE).value == pytest.approx(expected)


@pytest.mark.parametrize("metric", [metrics.relative_l2, metrics.relative_mse, metrics.lab_l_mse])
def test_the_references_noise_is_taken_out(rng, metric):
    truth = rng.uniform(0.5, 2, (20_000, 3))
    result = truth * 1.1 + rng.normal(size=truth.shape) * 0.05
    exact = metric(result, truth, np.zeros_like(truth)).value
    stderr = 0.04 * truth
    noisy = truth + stderr * rng.normal(size=truth.shape)
    estimate = metric(result, noisy, stderr)
    plain = metric(result, noisy, np.zeros_like(truth)).value
    # What remains is of second order: the noise in the denominator, the curvature of L*.
    assert plain > 1.04 * exact
    assert abs(estimate.value - exact) < 0.5 * abs(plain - exact)
    assert not estimate.is_none


@pytest.mark.parametrize(
    "metric", [metrics.bias, metrics.relative_l2, metrics.relative_mse, metrics.lab_l_mse]
)
def test_a_perfect_result_differs_by_none(rng, metric):
    none, turns = 0, 400
    for _ in range(turns):
        truth = rng.uniform(0.5, 2, (300, 3))
        stderr = np.full_like(truth, 0.05)
        noisy = truth + stderr * rng.normal(size=truth.shape)
        none += metric(truth, noisy, stderr).is_none
    # 95 % of them at least: five standard errors of that share.
    assert none >= 0.95 * turns - 5 * np.sqrt(0.95 * 0.05 * turns)
    assert str(metric(truth, truth, stderr)) == "none"
    assert not metric(truth * 1.2, noisy, stderr).is_none


def test_lightness_by_hand():
    # L* of Y = 0.18 is 49.496, of Y = 0.001 is 903.296 x 0.001 (CIE 15:2004, 8.3 and 8.7).
    grey = np.array([[0.18] * 3, [0.001] * 3, [1.0] * 3, [0.0] * 3, [-1.0] * 3])
    expected = [49.4961, 0.903296, 100, 0, 0]
    assert metrics.lightness(grey) == pytest.approx(expected, rel=1e-5)
    assert metrics.lightness(grey / 4, exposure=4.0) == pytest.approx(expected, rel=1e-5)
    green = np.array([[0.0, 1.0, 0.0]])
    assert metrics.lightness(green) == pytest.approx([116 * 0.7152 ** (1 / 3) - 16])


def test_lightness_against_scikit_image(rng):
    color = pytest.importorskip("skimage.color", reason="scikit-image is not installed")
    linear = rng.random((50, 3))
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert metrics.lightness(linear) == pytest.approx(color.rgb2lab(srgb)[:, 0], abs=0.02)


def test_lab_l_mse_by_hand():
    reference = np.array([[0.18] * 3, [1.0] * 3])
    result = np.array([[0.001] * 3, [1.0] * 3])
    found = metrics.lab_l_mse(result, reference, NO_NOISE, exposure=1.0)
    assert found.value == pytest.approx((49.4961 - 0.903296) ** 2 / 2, rel=1e-5)


def test_default_exposure_brings_the_brightest_to_white():
    grey = np.linspace(0, 5, 1001)[:, None] * np.ones(3)
    assert metrics.default_exposure(grey) == pytest.approx(1 / (0.99 * 5))
    assert metrics.default_exposure(np.zeros((4, 3))) == 1.0


def image():
    y, x = np.mgrid[0:48, 0:64] / 16
    return np.stack((1 + np.sin(x), 1 + np.cos(y), 0.5 + 0 * x), axis=-1)


def test_flip_as_its_authors_have_it():
    package = pytest.importorskip("flip_evaluator", reason="flip-evaluator is not installed")
    reference = image()
    result = reference * np.array([1.3, 1.0, 0.8])
    found = metrics.flip(result, reference, np.zeros_like(reference))
    _, mean, _ = package.evaluate(
        reference.astype(np.float32), result.astype(np.float32), "HDR", applyMagma=False
    )
    assert found.value == pytest.approx(mean, rel=1e-4)
    assert found.noise == 0
    assert metrics.flip(reference, reference, np.zeros_like(reference)).value == 0
    assert not metrics.flip(result, reference, 1e-3 * reference).is_none
    assert metrics.flip(reference * 1.0001, reference, 0.2 * reference).is_none
    half = np.zeros(reference.shape[:2], bool)
    half[:, :20] = True
    left = np.where(half[..., None], reference, result)
    far = np.zeros_like(half)
    far[:, :5] = True
    stderr = np.zeros_like(reference)
    assert metrics.flip(left, reference, stderr, far).value < 0.2 * found.value


def test_flips_exposures_are_those_of_what_counts():
    """A black background about the image, three times its size, changes neither exposures nor FLIP
    (but near its edge, as FLIP filters).
    """
    package = pytest.importorskip("flip_evaluator", reason="flip-evaluator is not installed")
    reference = image()
    result = reference * np.array([1.3, 1.0, 0.8])
    _, _, chosen = package.evaluate(
        reference.astype(np.float32), result.astype(np.float32), "HDR", applyMagma=False
    )
    everywhere = np.ones(reference.shape[:2], bool)
    start, stop = metrics._flip_exposures(metrics.luminance(reference).ravel())
    assert start == pytest.approx(chosen["startExposure"], abs=1e-4)
    assert stop == pytest.approx(chosen["stopExposure"], abs=1e-2)  # a median of an even number
    border = ((48, 48), (64, 64))
    large, larger = (np.pad(one, (*border, (0, 0))) for one in (reference, result))
    counts = np.pad(everywhere, border)
    inner = np.pad(np.ones((24, 40), bool), ((60, 60), (76, 76)))
    alone = metrics.flip_map(result, reference, everywhere)
    framed = metrics.flip_map(larger, large, counts)
    assert framed[inner].mean() == pytest.approx(alone[12:36, 12:52].mean(), rel=0.02)
    assert metrics.flip(larger, large, np.zeros_like(large), counts).value == pytest.approx(
        framed[counts].mean()
    )
    dark = np.zeros_like(reference)
    assert metrics.flip(dark, dark, dark).value == 0
    assert metrics.flip(reference, dark, dark).value == 1


def test_ssim_by_hand():
    pytest.importorskip("skimage", reason="scikit-image is not installed")
    # Two flat images: only the luminance term is left, (2 a b + c) / (a^2 + b^2 + c), c = 1.
    first, second = np.full((16, 16, 3), 0.18), np.full((16, 16, 3), 0.5)
    a, b = metrics.lightness(np.array([0.18] * 3)), metrics.lightness(np.array([0.5] * 3))
    found = metrics.ssim(first, second, np.zeros_like(first), exposure=1.0)
    assert found.value == pytest.approx((2 * a * b + 1) / (a * a + b * b + 1), rel=1e-6)
    assert found.perfect == 1 and not found.is_none
    same = metrics.ssim(image(), image(), 0.01 * image())
    assert same.value == pytest.approx(1) and same.is_none
    with pytest.raises(CannotRun, match="16 x 9: SSIM needs images of 11 x 11 pixels and more"):
        metrics.ssim(first[:9], second[:9], np.zeros_like(first[:9]))


def test_dark_scenes():
    black = np.zeros((5, 3))
    for metric in (metrics.bias, metrics.relative_l2, metrics.relative_mse):
        assert metric(black, black, black).value == 0
        assert metric(black + 1, black, black).value == np.inf
    assert metrics.lab_l_mse(black, black, black).is_none


def test_bad_input():
    with pytest.raises(BadInput, match="same receivers"):
        metrics.bias(RESULT[:1], REFERENCE, NO_NOISE)
    with pytest.raises(BadInput, match="1 values of the result are not finite"):
        metrics.relative_mse(np.where(RESULT == 1.5, np.nan, RESULT), REFERENCE, NO_NOISE)
    with pytest.raises(BadInput, match="weights"):
        metrics.bias(RESULT, REFERENCE, NO_NOISE, np.zeros(2))
    with pytest.raises(BadInput, match="images"):
        metrics.flip(RESULT, REFERENCE, NO_NOISE)
    with pytest.raises(BadInput, match="mask"):
        metrics.flip(image(), image(), image(), np.zeros((48, 64), bool))


def test_measures_read_as_text():
    assert str(Measure(0.5, 0.1)) == "0.5"
    assert str(Measure(0.05, 0.1)) == "none"
    assert str(Measure(0.97, 0.01, 1.0)) == "0.97"
    assert str(Measure(0.995, 0.01, 1.0)) == "none"
