"""The table of the split sum: what a glossy surface reflects of light that fills its lobe evenly.

With Schlick's Fresnel term the reflectance times the cosine, integrated over the hemisphere, is
``f0 * scale + offset``, both of which depend on n . v and roughness alone (Karis 2013, "Real
Shading in Unreal Engine 4"; Anonymous 2022, equations 4.5 to 4.7). The terms:
kernels_cl/common/ggx.cl.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gibench.arrays import Doubles, Floats
from gibench.device import BufferSpec
from gibench.device.build import Define
from gibench.scene.gloss import DIELECTRIC_F0, LEAST_ALPHA

SPLIT_SUM_SIDE = 64
"""Entries of the table's side."""
GLOSS_MACROS: dict[str, Define] = {
    "SPLIT_SUM_SIDE": SPLIT_SUM_SIDE,
    "LEAST_ALPHA": LEAST_ALPHA,
    "DIELECTRIC_F0": DIELECTRIC_F0,
}
"""Of every program that includes kernels_cl/common/ggx.cl."""
_SAMPLES = 4096  # facets per entry: errors under 0.004 (tests)


def split_sum_buffer() -> BufferSpec:
    """Of the table on a device."""
    return BufferSpec.of("split_sum", (SPLIT_SUM_SIDE, SPLIT_SUM_SIDE, 2), np.float32)


@cache
def split_sum_table() -> Floats:
    """Scale and offset of f0, (SPLIT_SUM_SIDE, SPLIT_SUM_SIDE, 2) float32: rows roughness, columns
    n . v, each entry at its cell's middle.
    """
    middles = (np.arange(SPLIT_SUM_SIDE) + 0.5) / SPLIT_SUM_SIDE
    rows = [split_sum(middles, np.full(SPLIT_SUM_SIDE, r)) for r in middles]
    table = np.stack(rows).astype(np.float32)
    table.setflags(write=False)
    return table


def split_sum(n_v: Doubles, roughness: Doubles, samples: int = _SAMPLES) -> Doubles:
    """Scale and offset (n, 2), by facets drawn as the distribution has them.

    Args:
        n_v: (n,) cosines of the view, above 0.
        roughness: (n,) perceptual.
        samples: facets, a Hammersley sequence (Anonymous 2022, listing 4.1).
    """
    alpha = np.maximum(roughness**2, LEAST_ALPHA)[:, None]
    turn, share = hammersley(samples).T
    cosine = np.sqrt((1 - share) / (1 + (alpha**2 - 1) * share))
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    v_h = np.sqrt(1 - n_v**2)[:, None] * sine * np.cos(2 * np.pi * turn) + n_v[:, None] * cosine
    n_l = 2 * v_h * cosine - n_v[:, None]
    k = alpha / 2
    seen = n_v[:, None] / (n_v[:, None] * (1 - k) + k)
    lit = n_l / np.where(n_l > 0, n_l * (1 - k) + k, 1)
    weight = np.where(n_l > 0, seen * lit * v_h / (cosine * n_v[:, None]), 0.0)
    away = np.clip(1 - v_h, 0, 1) ** 5
    return np.stack([(weight * (1 - away)).mean(axis=1), (weight * away).mean(axis=1)], axis=1)


def hammersley(count: int) -> Doubles:
    """Points (count, 2) in the unit square, spread evenly; shifted by half a step along the first
    axis, and never at 1 along the second.
    """
    i = np.arange(count, dtype=np.uint64)
    bits = i.copy()
    inverse, unit = np.zeros(count), 0.5
    while bits.any():
        inverse += unit * (bits & np.uint64(1))
        bits >>= np.uint64(1)
        unit /= 2
    return np.stack([(i + 0.5) / count, inverse], axis=1)
