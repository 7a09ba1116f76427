"""How far a result is from the truth, and whether that is more than the truth's own noise.

Every function takes the result and the reference in the same linear unit, (n, 3) for receivers or
(height, width, 3) for images, and the standard error of the reference, which is taken to be
independent between receivers, channels and pixels, as the path tracer's is. Squared errors have
the share of the reference's noise taken out: if x = truth + noise, the mean of (r - x)^2 is
(r - truth)^2 + variance. What is left is 0 at least. All functions are pure and compute in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Array, Bools, Doubles
from gibench.errors import BadInput, CannotRun
from gibench.reference.luminance import LUMINANCE, luminance

# Standard errors that a value must lie above nothing to be called a difference (95 %, two-sided).
_SIGMAS = 1.96
# Added to the square of the reference in relative squares, as a share of its mean squared, so that
# receivers in the dark do not decide alone (Rousselle, Knaus and Zwicker 2011, "Adaptive Sampling
# and Reconstruction using Greedy Error Minimization", section 6, has 0.01 for images in [0, 1]).
_DARK_SHARE = 1e-2
# CIE 15:2004, equations 8.6 and 8.7: below this share of white L* is linear.
_LINEAR_BELOW = (6 / 29) ** 3


@dataclass(frozen=True)
class Measure:
    """An error and how much of it could be the reference's own noise.

    Attributes:
        value: the error.
        noise: an error this far from ``perfect`` or less may be the reference's noise alone.
        perfect: what the metric gives for no difference at all: 0, or 1 for SSIM.
    """

    value: float
    noise: float
    perfect: float = 0.0

    @property
    def is_none(self) -> bool:
        """Whether the difference cannot be told from the reference's noise."""
        return abs(self.value - self.perfect) <= self.noise

    def __str__(self) -> str:
        return "none" if self.is_none else f"{self.value:.4g}"


def bias(result: Array, reference: Array, stderr: Array, weights: Array | None = None) -> Measure:
    """Mean signed difference over the mean of the reference, channels together.

    Args:
        result: (..., 3).
        reference: (..., 3).
        stderr: (..., 3).
        weights: (...) of the receivers, such as their areas; even when None.

    Raises:
        BadInput: shapes that differ, or a result that is not finite.
    """
    x, y, s, w = _inputs(result, reference, stderr, weights)
    whole = float((w * y).sum())
    if whole == 0:
        return Measure(0.0 if not x.any() else np.inf, 0.0)
    spread = float(np.sqrt((w**2 * s**2).sum()))
    return Measure(float((w * (x - y)).sum()) / whole, _SIGMAS * spread / whole)


def relative_l2(
    result: Array, reference: Array, stderr: Array, weights: Array | None = None
) -> Measure:
    """Root of the summed squared difference over the summed square of the reference.

    Arguments and errors as :func:`bias`. What the reference's noise adds is taken out.
    """
    x, y, s, w = _inputs(result, reference, stderr, weights)
    whole = float((w * (y**2 - s**2)).sum())
    if whole <= 0:
        return Measure(0.0 if np.array_equal(x, y) else np.inf, 0.0)
    off, spread = _squares(x - y, s, w)
    return Measure(float(np.sqrt(max(off, 0.0) / whole)), float(np.sqrt(_SIGMAS * spread / whole)))


def relative_mse(
    result: Array, reference: Array, stderr: Array, weights: Array | None = None
) -> Measure:
    """Mean of the squared difference over the squared reference, channel by channel.

    The denominator has 1 % of the squared mean of the reference added. Arguments and errors as
    :func:`bias`. What the reference's noise adds to the difference is taken out; what it does to
    the denominator is not, and counts once the relative noise is not small against the relative
    difference (a share of 4 noise^2 / difference).
    """
    x, y, s, w = _inputs(result, reference, stderr, weights)
    mean = float((w * y).sum() / w.sum())
    below = y**2 + _DARK_SHARE * mean**2
    if mean == 0:
        return Measure(0.0 if not x.any() else np.inf, 0.0)
    off, spread = _squares(x - y, s, w / below)
    total = float(w.sum())
    return Measure(max(off, 0.0) / total, _SIGMAS * spread / total)


def default_exposure(reference: Array) -> float:
    """The factor that brings the reference's 99th percentile of luminance to white."""
    bright = float(np.percentile(luminance(reference), 99))
    return 1.0 / bright if bright > 0 else 1.0


def lightness(rgb: Array, exposure: float = 1.0) -> Doubles:
    """CIE 1976 L* (...) of linear Rec. 709 RGB (..., 3), in 0 to 100 below white.

    White is D65 at luminance 1 after exposure (L* depends on white's luminance only). Nothing is
    clipped: what is brighter than white is over 100, negative light counts as none. CIE 15:2004,
    equation 8.3.
    """
    y = np.maximum(luminance(rgb) * exposure, 0.0)
    return np.asarray(
        np.where(y > _LINEAR_BELOW, 116 * np.cbrt(y) - 16, y * (116 / (3 * (6 / 29) ** 2)))
    )


def lab_l_mse(
    result: Array,
    reference: Array,
    stderr: Array,
    weights: Array | None = None,
    *,
    exposure: float | None = None,
) -> Measure:
    """Mean squared difference of L* in CIE L*a*b*, on its scale of 0 to 100.

    Arguments and errors as :func:`bias`. The reference's noise is carried through the slope of L*
    and taken out.

    Args:
        result: (..., 3).
        reference: (..., 3).
        stderr: (..., 3).
        weights: (...).
        exposure: of both; :func:`default_exposure` of the reference when None.
    """
    x, y, s, w = _inputs(result, reference, stderr, weights)
    factor = default_exposure(y) if exposure is None else exposure
    bright = np.maximum(luminance(y) * factor, _LINEAR_BELOW)
    slope = 116 / 3 * bright ** (-2 / 3) * factor
    spread = np.sqrt((s**2) @ LUMINANCE**2) * slope
    w = w[..., 0]
    off, error = _squares(lightness(x, factor) - lightness(y, factor), spread, w)
    return Measure(max(off, 0.0) / float(w.sum()), _SIGMAS * error / float(w.sum()))


def flip(
    result: Array, reference: Array, stderr: Array, mask: Bools | None = None, *, seed: int = 1
) -> Measure:
    """Mean HDR-FLIP of an image (Andersson et al. 2021, "Visualizing Errors in Rendered HDR
    Images"), at 67 pixels per degree, by its authors' package.

    The noise is the FLIP of the reference against itself with one more draw of its noise.

    Args:
        result: (height, width, 3) linear, not negative.
        reference: (height, width, 3).
        stderr: (height, width, 3).
        mask: (height, width) pixels that count; all when None.
        seed: of the draw.

    Raises:
        BadInput: as :func:`bias`, or not images.
        CannotRun: flip-evaluator is not installed.
    """
    x, y, s = _images(result, reference, stderr)
    area = _all(mask, x)
    if not y[area].any():
        return Measure(0.0 if not x[area].any() else 1.0, 0.0)
    return Measure(
        float(flip_map(x, y, area)[area].mean()),
        float(flip_map(_noisy(y, s, seed), y, area)[area].mean()) if s.any() else 0.0,
    )


def flip_map(result: Array, reference: Array, mask: Bools) -> Doubles:
    """HDR-FLIP of every pixel (height, width), 0 to 1.

    The range of exposures is that of the reference in ``mask`` (height, width). The package would
    take it from the median of all pixels: where half of them are black background, that is 0, and
    it looks at two dozen exposures, up to 2^24, in most of which everything is white.

    Raises:
        CannotRun: flip-evaluator is not installed.
    """
    try:
        import flip_evaluator  # type: ignore[import-untyped, unused-ignore]
    except ImportError as error:
        raise CannotRun(
            "FLIP needs the flip-evaluator package", mend='pip install "gibench[truth]"'
        ) from error
    first, second = (np.maximum(a, 0).astype(np.float32) for a in (reference, result))
    start, stop = _flip_exposures(luminance(first[mask]))
    found = flip_evaluator.evaluate(
        first,
        second,
        "HDR",
        inputsRGB=False,
        applyMagma=False,
        parameters={"startExposure": start, "stopExposure": stop},
    )
    return np.asarray(found[0], np.float64).reshape(first.shape[:2])


def _flip_exposures(bright: Array) -> tuple[float, float]:
    """The exposures, as powers of two, that bring the brightest and the median of the luminances
    ``bright`` (n,) to the largest value that ACES maps below 0.85; what is black does not count
    (Andersson et al. 2021, section 4.1).
    """
    lit = bright[bright > 0]
    brightest, median = float(lit.max()), float(np.median(lit))
    # Narkowicz 2015, "ACES Filmic Tone Mapping Curve", (a x^2 + b x) / (c x^2 + d x + e) at 0.6 of
    # the exposure, as the package has it.
    a, b, c, d, e = 0.36 * 2.51, 0.6 * 0.03, 0.36 * 2.43, 0.6 * 0.59, 0.14
    most = max(float(root) for root in np.roots((a - 0.85 * c, b - 0.85 * d, -0.85 * e)).real)
    return float(np.log2(most / brightest)), float(np.log2(most / median))


_SSIM_WINDOW = 11
"""Pixels across of the Gaussian of SSIM (Wang et al. 2004, section III.C)."""


def ssim(
    result: Array,
    reference: Array,
    stderr: Array,
    mask: Bools | None = None,
    *,
    exposure: float | None = None,
    seed: int = 1,
) -> Measure:
    """Mean structural similarity of L* (Wang et al. 2004; Gaussian of 1.5 pixels, range 100).

    Arguments and errors as :func:`flip`; the exposure as in :func:`lab_l_mse`. 1 is no difference.

    Raises:
        CannotRun: scikit-image is not installed, or the image is smaller than its window.
    """
    x, y, s = _images(result, reference, stderr)
    if min(x.shape[:2]) < _SSIM_WINDOW:
        raise CannotRun(
            f"SSIM needs images of {_SSIM_WINDOW} x {_SSIM_WINDOW} pixels and more",
            where=f"{x.shape[1]} x {x.shape[0]}",
        )
    factor = default_exposure(y) if exposure is None else exposure
    seen, noisy = lightness(y, factor), lightness(_noisy(y, s, seed), factor)
    area = _all(mask, x)
    value = float(_ssim_map(lightness(x, factor), seen)[area].mean())
    return Measure(value, 1.0 - float(_ssim_map(noisy, seen)[area].mean()), 1.0)


def _ssim_map(first: Doubles, second: Doubles) -> Doubles:
    try:
        from skimage.metrics import structural_similarity
    except ImportError as error:
        raise CannotRun(
            "SSIM needs the scikit-image package", mend='pip install "gibench[truth]"'
        ) from error
    compare: Callable[..., tuple[float, Doubles]] = structural_similarity
    _, found = compare(
        first,
        second,
        data_range=100.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return np.asarray(found, np.float64)


def _squares(off: Doubles, stderr: Doubles, weights: Doubles) -> tuple[float, float]:
    """Weighted sum of squared differences without the noise's share, and its standard error.

    With d the true difference, the variance of (d + noise)^2 is 4 d^2 s^2 + 2 s^4.
    """
    cleaned = off**2 - stderr**2
    variance = 4 * np.maximum(cleaned, 0) * stderr**2 + 2 * stderr**4
    return float((weights * cleaned).sum()), float(np.sqrt((weights**2 * variance).sum()))


def _inputs(
    result: Array, reference: Array, stderr: Array, weights: Array | None
) -> tuple[Doubles, Doubles, Doubles, Doubles]:
    x, y, s = (np.asarray(a, np.float64) for a in (result, reference, stderr))
    if x.shape != y.shape or s.shape != y.shape or x.shape[-1:] != (3,) or x.size == 0:
        raise BadInput(
            f"a result of shape {x.shape} against a reference of {y.shape} and its standard "
            f"error of {s.shape}",
            mend="compare results of the same receivers or pixels",
        )
    strange = int((~np.isfinite(x)).sum())
    if strange:
        raise BadInput(f"{strange} values of the result are not finite")
    w = np.ones(x.shape[:-1]) if weights is None else np.asarray(weights, np.float64)
    if w.shape != x.shape[:-1] or w.sum() <= 0:
        raise BadInput(f"weights of shape {w.shape} for {x.shape[:-1]}, or that add up to nothing")
    return x, y, s, np.broadcast_to(w[..., None], x.shape)


def _images(result: Array, reference: Array, stderr: Array) -> tuple[Doubles, Doubles, Doubles]:
    x, y, s, _ = _inputs(result, reference, stderr, None)
    if x.ndim != 3:
        raise BadInput(f"images are compared here, and this is of shape {x.shape}")
    return x, y, s


def _noisy(reference: Doubles, stderr: Doubles, seed: int) -> Doubles:
    draw = np.random.default_rng(seed).normal(size=reference.shape)
    return np.maximum(reference + stderr * draw, 0.0)


def _all(mask: Bools | None, image: Doubles) -> Bools:
    if mask is None:
        return np.ones(image.shape[:2], np.bool_)
    if mask.shape != image.shape[:2] or not mask.any():
        raise BadInput(f"a mask of shape {mask.shape} for {image.shape[:2]}, or an empty one")
    return mask
