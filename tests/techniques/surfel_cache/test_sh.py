"""Lobes and caps in spherical harmonics against numerical integration."""

import numpy as np
import pytest

from gibench.techniques.surfel_cache.sh import BAND_OF, basis, cap_factors, lobe_factors


def quadrature(count=96):
    """Directions (n, 3) and weights that integrate polynomials over the sphere exactly."""
    z, weight = np.polynomial.legendre.leggauss(count)
    phi = (np.arange(2 * count) + 0.5) * np.pi / count
    r = np.sqrt(1 - z**2)
    d = np.stack(
        [
            np.outer(r, np.cos(phi)).ravel(),
            np.outer(r, np.sin(phi)).ravel(),
            np.repeat(z, len(phi)),
        ],
        axis=1,
    )
    return d, np.repeat(weight, len(phi)) * np.pi / count


def unit(rng):
    d = rng.normal(size=3)
    return d / np.linalg.norm(d)


def test_the_basis_is_orthonormal_and_polar_in_z():
    d, w = quadrature(12)
    y = basis(d)
    np.testing.assert_allclose(y.T @ (y * w[:, None]), np.eye(16), atol=1e-12)
    assert np.allclose(basis(np.array([[0.0, 0.0, 1.0]]))[0][[0, 2, 6, 12]] > 0, True)
    assert basis(d.astype(np.float32)).dtype == np.float32


@pytest.mark.parametrize("exponent", [1, 2, 5, 20, 33.5, 64])
def test_lobes_are_their_integrals(rng, exponent):
    """Of (n + 1) / (2 pi) cos^n about any direction, band by band."""
    axis = unit(rng)
    z, weight = np.polynomial.legendre.leggauss(400)
    z, weight = (z + 1) / 2, weight / 2  # the lobe's half alone: it has an edge at the horizon
    phi = (np.arange(64) + 0.5) * np.pi / 32
    other = np.cross(axis, unit(rng))
    other /= np.linalg.norm(other)
    third = np.cross(axis, other)
    r = np.sqrt(1 - z**2)
    d = (
        z[:, None, None] * axis
        + r[:, None, None] * np.cos(phi)[:, None] * other
        + r[:, None, None] * np.sin(phi)[:, None] * third
    ).reshape(-1, 3)
    lobe = (exponent + 1) / (2 * np.pi) * np.repeat(z**exponent * weight, 64) * np.pi / 32
    found = (basis(d) * lobe[:, None]).sum(axis=0)
    expected = lobe_factors(exponent)[BAND_OF] * basis(axis[None])[0]
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_the_lobe_of_exponent_one_is_the_diffuse_one():
    np.testing.assert_allclose(lobe_factors(1), [1, 2 / 3, 1 / 4, 0])


def test_caps_are_their_integrals(rng):
    axis, cosine = unit(rng), rng.uniform(-0.9, 0.95)
    solid = 2 * np.pi * (1 - cosine)
    z, weight = np.polynomial.legendre.leggauss(40)
    z = cosine + (z + 1) / 2 * (1 - cosine)
    # Zonal: about the z axis only the m = 0 functions are left, and turn with the axis.
    zonal = np.stack([np.ones_like(z), z, (3 * z * z - 1) / 2, (5 * z**3 - 3 * z) / 2])
    factors = 2 * np.pi * (zonal * weight).sum(axis=1) * (1 - cosine) / 2
    np.testing.assert_allclose(cap_factors(np.array([solid]))[0], factors, atol=1e-10)
    expected = factors[BAND_OF] * basis(axis[None])[0]
    d, w = quadrature(300)
    found = (basis(d) * (w * (d @ axis > cosine))[:, None]).sum(axis=0)
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_the_whole_sphere_is_a_cap_without_direction():
    found = cap_factors(np.array([4 * np.pi]))[0]
    np.testing.assert_allclose(found, [4 * np.pi, 0, 0, 0], atol=1e-12)
