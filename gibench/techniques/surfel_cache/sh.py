"""Spherical harmonics of two to four bands: the basis, lobes and caps (Jendersie et al. 2016).

Real, orthonormal, index j = l (l + 1) + m, z the polar axis, no Condon-Shortley phase.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles

MOST_BANDS: Final = 4
COEFFICIENTS: Final = MOST_BANDS**2
"""Of the most bands."""

BAND_OF: Final = np.repeat(np.arange(MOST_BANDS), 2 * np.arange(MOST_BANDS) + 1)
"""Band of each coefficient, (16,)."""


def basis(directions: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The basis of four bands at unit ``directions`` (n, 3), (n, 16) of their type.

    The polynomials of Sloan 2008, "Stupid Spherical Harmonics (SH) Tricks", appendix A2, without
    the phase.
    """
    x, y, z = directions[:, 0], directions[:, 1], directions[:, 2]
    out = np.empty((len(directions), COEFFICIENTS), directions.dtype)
    xx, yy, zz = x * x, y * y, z * z
    out[:, 0] = 0.28209479177387814
    out[:, 1] = 0.4886025119029199 * y
    out[:, 2] = 0.4886025119029199 * z
    out[:, 3] = 0.4886025119029199 * x
    out[:, 4] = 1.0925484305920792 * x * y
    out[:, 5] = 1.0925484305920792 * y * z
    out[:, 6] = 0.31539156525252005 * (3 * zz - 1)
    out[:, 7] = 1.0925484305920792 * x * z
    out[:, 8] = 0.5462742152960396 * (xx - yy)
    out[:, 9] = 0.5900435899266435 * y * (3 * xx - yy)
    out[:, 10] = 2.890611442640554 * x * y * z
    out[:, 11] = 0.4570457994644658 * y * (5 * zz - 1)
    out[:, 12] = 0.3731763325901154 * z * (5 * zz - 3)
    out[:, 13] = 0.4570457994644658 * x * (5 * zz - 1)
    out[:, 14] = 1.445305721320277 * z * (xx - yy)
    out[:, 15] = 0.5900435899266435 * x * (xx - 3 * yy)
    return out


def lobe_factors(exponent: float) -> Doubles:
    """What each band of a lobe cos^n of volume one weighs, (4,): equations 11 and 12's s_l(n).

    With exponent 1 the lobe is a diffuse surface's over pi.
    """
    n = exponent
    s = [1.0, (n + 1) / (n + 2)]
    for band in (2, 3):
        s.append(s[band - 2] * (n + 2 - band) / (n + 1 + band))
    return np.array(s)


def cap_factors(solid_angle: npt.NDArray[Any]) -> Doubles:
    """What each band of a spherical cap weighs, (n, 4): its projection is the factor times the
    basis in the direction of its middle.

    2 pi times the integral of the Legendre polynomial over the cap's cosines.

    Args:
        solid_angle: (n,) of the caps, sr, up to 4 pi.
    """
    c = 1.0 - np.asarray(solid_angle, np.float64) / (2 * np.pi)
    return np.asarray(
        2
        * np.pi
        * np.stack(
            [
                1 - c,
                (1 - c**2) / 2,
                (c - c**3) / 2,
                (6 * c**2 - 5 * c**4 - 1) / 8,
            ],
            axis=-1,
        )
    )
