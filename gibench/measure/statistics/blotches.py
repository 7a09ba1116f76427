"""Low-frequency error on flat surfaces: what an eye sees as blotches. No I/O here.

A band of the error's frequencies: what a Gaussian of ``near`` texels keeps and one of ``far`` does
not. Noise of single receivers is finer, and a surface that is too bright as a whole is coarser;
neither is a blotch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d

from gibench.arrays import Doubles

FAR = 4.0
"""The wider Gaussian over the narrower one: two octaves."""
_TRUNCATE = 4.0  # standard deviations of the wider Gaussian that are summed over


@dataclass(frozen=True)
class FlatError:
    """The error on one flat surface, on a grid of texels.

    Attributes:
        error: (h, w) of a texel, as a share of the surface's mean light.
        variance: (h, w) of it, by the truth's noise, independent between texels.
        weight: (h, w) area, m2; 0 where there is no receiver.
        near: standard deviation of the narrower Gaussian, texels.
    """

    error: Doubles = field(repr=False)
    variance: Doubles = field(repr=False)
    weight: npt.NDArray[np.floating] = field(repr=False)
    near: float


def blotches(surfaces: Sequence[FlatError]) -> float:
    """Root mean square over all of ``surfaces``, by area, of the error in the band, with what the
    truth's noise adds taken out; nan where there is no surface.
    """
    squares = total = 0.0
    for one in surfaces:
        kept, noise = band(one)
        squares += float((one.weight * (kept**2 - noise)).sum())
        total += float(one.weight.sum())
    return float(np.sqrt(max(squares, 0.0) / total)) if total > 0 else float("nan")


def band(surface: FlatError) -> tuple[Doubles, Doubles]:
    """The error (h, w) in the band, and the variance of that by the truth's noise; 0 where no
    receiver is.

    Both Gaussians are normalised by the weight they find, so that a surface ends where its
    receivers
    do: b_i = sum_j (g_ij / sum_j g_ij w_j - f_ij / sum_j f_ij w_j) w_j e_j.
    """
    reach = round(_TRUNCATE * FAR * surface.near)
    at = np.arange(-reach, reach + 1)
    narrow = np.exp(-0.5 * (at / surface.near) ** 2)
    wide = np.exp(-0.5 * (at / (FAR * surface.near)) ** 2)
    weight = np.asarray(surface.weight, np.float64)
    there = weight > 0
    of_narrow = np.where(there, _spread(weight, narrow), 1.0)
    of_wide = np.where(there, _spread(weight, wide), 1.0)
    weighted = weight * surface.error
    kept = _spread(weighted, narrow) / of_narrow - _spread(weighted, wide) / of_wide
    noisy = weight**2 * surface.variance
    variance = (
        _spread(noisy, narrow**2) / of_narrow**2
        - 2 * _spread(noisy, narrow * wide) / (of_narrow * of_wide)
        + _spread(noisy, wide**2) / of_wide**2
    )
    return np.where(there, kept, 0.0), np.where(there, variance, 0.0)


def _spread(values: Doubles, kernel: Doubles) -> Doubles:
    """``values`` (h, w) convolved along both axes; nothing lies beyond their edge."""
    along = convolve1d(values, kernel, axis=0, mode="constant")
    return np.asarray(convolve1d(along, kernel, axis=1, mode="constant"), np.float64)
