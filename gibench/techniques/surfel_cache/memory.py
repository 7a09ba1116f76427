"""Memory by the table of Jendersie et al. 2016 (table 4), beside which ours is put."""

from __future__ import annotations

from typing import Final

SURFEL_BYTES: Final = 28
"""Position and area, normal, texture coordinates with albedo and emission."""
NODE_BYTES: Final = 12
"""Surfel, child and flux."""
LINK_ID_BYTES: Final = 4
COEFFICIENT_BYTES: Final = 2
RUN_TIME_LINK_BYTES: Final = 12
CACHE_COEFFICIENT_BYTES: Final = 8
"""Three channels and an unused one, 2 bytes each."""

# Table 4 counts in thousands: 128k surfels are 128 000 there.
HIGH: Final = (128_000, 254, 4, 10_000)
MODERATE: Final = (32_000, 128, 3, 10_000)


def published_bytes(surfels: int, links: int, bands: int, caches: int, stored: bool) -> int:
    """The sum of table 4's components.

    Args:
        surfels: in a binary tree of twice as many nodes.
        links: of a cache.
        bands: of spherical harmonics.
        caches: on the map and in the grid.
        stored: links hold coefficients; else a direction and a factor.
    """
    coefficients = bands**2
    link = RUN_TIME_LINK_BYTES
    if stored:
        link = LINK_ID_BYTES + COEFFICIENT_BYTES * coefficients
    return (
        surfels * (SURFEL_BYTES + 2 * NODE_BYTES)
        + caches * CACHE_COEFFICIENT_BYTES * coefficients
        + caches * links * link
    )
