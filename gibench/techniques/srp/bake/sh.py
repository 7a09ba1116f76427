"""Real spherical harmonics in float64, the reference for ``kernels_cl/common/sh.cl``.

Index j = l (l + 1) + m, z the polar axis, orthonormal over the sphere, no Condon-Shortley phase.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.techniques.srp.bake.data import sh_count


def sh_basis(order: int, directions: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """The basis up to ``order`` in unit ``directions`` (n, 3): (n, (order + 1)^2) float64.

    The normalised associated Legendre functions without their sin^m factor by the three-term
    recurrence in l, that factor with the azimuth by the recurrence of (x + i y)^m (Sloan 2013,
    "Efficient Spherical Harmonic Evaluation").

    Raises:
        ValueError: the order is negative.
    """
    if order < 0:
        raise ValueError("the order of spherical harmonics is at least 0")
    x, y, z = np.moveaxis(np.asarray(directions, np.float64).reshape(-1, 3), 1, 0)
    basis = np.empty((len(x), sh_count(order)))
    cosine, sine = np.ones_like(x), np.zeros_like(x)  # Re and Im of (x + i y)^m
    diagonal = np.sqrt(0.25 / np.pi)  # P_m^m
    for m in range(order + 1):
        if m:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
            diagonal *= np.sqrt((2 * m + 1) / (2 * m))
        before = np.zeros_like(z)
        legendre = np.full_like(z, diagonal * (np.sqrt(2.0) if m else 1.0))
        for degree in range(m, order + 1):
            if degree > m:
                a = np.sqrt((4 * degree**2 - 1) / (degree**2 - m**2))
                b = np.sqrt(((degree - 1) ** 2 - m**2) / (4 * (degree - 1) ** 2 - 1))
                before, legendre = legendre, a * (z * legendre - b * before)
            basis[:, degree * (degree + 1) + m] = legendre * cosine
            if m:
                basis[:, degree * (degree + 1) - m] = legendre * sine
    return basis
