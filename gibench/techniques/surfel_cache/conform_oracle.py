"""Surfel caches in float64 NumPy: what the frame's kernels are held against."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.techniques.surfel_cache.bake.data import LINK_SCALE
from gibench.techniques.surfel_cache.sh import BAND_OF, basis, cap_factors, lobe_factors
from gibench.techniques.surfel_cache.shared_exponent import decode, encode


def read(technique: Any, name: str) -> Array:
    """A buffer of the technique."""
    return np.asarray(technique.device.read(technique.frame.held[name]))


def write(technique: Any, name: str, array: Array) -> None:
    """Overwrite a buffer of the technique."""
    technique.device.write(technique.frame.held[name], array)


def halves(technique: Any, name: str) -> Array:
    """The caches of a map or grid, (n, coefficients, 4) float64."""
    return np.asarray(read(technique, name).view(np.float16).astype(np.float64))


def random_caches(technique: Any, rng: np.random.Generator) -> None:
    """Fill lit and dilated caches with light from all around; marks stay."""
    for name in ("cache_map", "cache_grid"):
        values = halves(technique, name)
        marked = values[:, 0, 3] > 0
        light = rng.uniform(-0.2, 0.2, values[..., :3].shape)
        light[:, 0] = rng.uniform(0.5, 1.5, light[:, 0].shape)
        values[marked, :, :3] = light[marked]
        write(technique, name, values.astype(np.float16).view(np.uint16))


def random_flux(technique: Any, rng: np.random.Generator) -> Array:
    """Random radiosities of all nodes, as stored; (nodes, 3) what they are."""
    nodes = len(technique.bake.hierarchy.child)
    light = 10 ** rng.uniform(-2, 0.5, (nodes, 1)) * rng.uniform(0, 1, (nodes, 3))
    bits = encode(light * technique.frame.flux_scale)
    write(technique, "node_flux", bits)
    return np.asarray(decode(bits) / technique.frame.flux_scale)


def link_terms(technique: Any, stored: bool) -> tuple[Array, Array]:
    """What each link brings of each coefficient, (caches, links, coefficients), and its node."""
    bake, k = technique.bake, technique.sizes.coefficients
    links, tree = bake.links, bake.hierarchy
    c = links.coefficients.astype(np.float64) / LINK_SCALE
    if stored:
        return c[:, :, :k], links.node
    surfels = (tree.end - tree.begin)[links.node]
    towards = c[:, :, [3, 1, 2]]
    length = np.linalg.norm(towards, axis=2, keepdims=True)
    d = np.where(length > 0, towards / np.maximum(length, 1e-30), [0, 0, 1.0])
    solid = c[:, :, 0] / 0.28209479177 * surfels * np.pi
    caps = cap_factors(np.minimum(solid, 4 * np.pi))[..., BAND_OF]
    y = basis(d.reshape(-1, 3)).reshape(*solid.shape, 16)
    return (caps * y / np.pi / surfels[..., None])[:, :, :k], links.node


def lit_caches(technique: Any, flux: Array, stored: bool) -> Array:
    """Equation 4 of every cache from the fluxes of nodes (nodes, 3), (caches, coefficients, 3)."""
    terms, node = link_terms(technique, stored)
    light = np.einsum("clk,clh->ckh", terms, flux[node])
    environment = technique.bake.caches.environment
    if environment is not None:
        light += environment[:, : light.shape[1]].astype(np.float64)
    return np.asarray(light)


def lobe(technique: Any, directions: Array, exponent: float = 1.0) -> Array:
    """The terms of a lobe about directions (n, 3), (n, coefficients)."""
    k = technique.sizes.coefficients
    factors = lobe_factors(exponent)[BAND_OF]
    return np.asarray((factors * basis(np.asarray(directions, np.float64)))[:, :k])


def gathered(technique: Any, places: Array, positions: Array, terms: Array) -> tuple[Array, Array]:
    """What lobes (n, coefficients) gather at places (n, 2) in the map or positions in the grid; and
    where no rounding decides whether the map has anything to say.
    """
    sure = np.ones(len(places), bool)
    atlas, volume = technique.bake.caches.atlas, technique.bake.caches.volume
    map_, grid = halves(technique, "cache_map"), halves(technique, "cache_grid")
    found = np.zeros((len(places), 3))
    for i, (place, position) in enumerate(zip(places, positions, strict=True)):
        total, weight = np.zeros(3), 0.0
        if place[0] >= 0:
            x, y = place - 0.5
            x0, y0 = int(np.floor(x)), int(np.floor(y))
            for dx, wx in ((0, 1 - (x - x0)), (1, x - x0)):
                for dy, wy in ((0, 1 - (y - y0)), (1, y - y0)):
                    column = min(max(x0 + dx, 0), atlas.width - 1)
                    row = min(max(y0 + dy, 0), atlas.height - 1)
                    cache = map_[row * atlas.width + column]
                    if cache[0, 3] > 0:
                        total += wx * wy * (terms[i] @ cache[:, :3])
                        weight += wx * wy
            sure[i] = weight > 1e-3 or weight == 0
        if weight <= 0:
            total, weight = np.zeros(3), 0.0
            counts = np.array(volume.counts)
            at = np.clip((position - volume.origin) / np.array(volume.spacing), 0, counts - 1)
            low = np.minimum(np.floor(at), np.maximum(counts - 2, 0)).astype(int)
            for corner in np.ndindex(2, 2, 2):
                cell = low + corner
                share = np.where(corner, at - low, 1 - (at - low)).prod()
                if share > 0 and (cell < counts).all():
                    cache = grid[(cell[2] * counts[1] + cell[1]) * counts[0] + cell[0]]
                    if cache[0, 3] > 0:
                        total += share * (terms[i] @ cache[:, :3])
                        weight += share
        found[i] = np.maximum(total / weight, 0) if weight > 0 else 0
    return found, sure


def dilated(before: Array) -> tuple[Array, Array]:
    """Which texels (h, w) of a map (h, w, coefficients, 4) dilation fills: those beside lit ones
    that are not lit themselves; and what it puts into these n, the mean (n, coefficients, 3) of the
    lit.
    """
    height, width = before.shape[:2]
    lit = before[:, :, 0, 3] == 1
    values = np.where(lit[..., None, None], before, 0)
    values, around = np.pad(values, ((1, 1), (1, 1), (0, 0), (0, 0))), np.pad(lit, 1)
    count, total = np.zeros(lit.shape), np.zeros(before.shape)
    for dy in range(3):
        for dx in range(3):
            window = (slice(dy, dy + height), slice(dx, dx + width))
            count += around[window]
            total += values[window]
    border = ~lit & (count > 0)
    return border, total[border][..., :3] / count[border][:, None, None]


def spread(grid_bits: Array) -> Array:
    """Directions of packed octahedral ones (n,), in float64."""
    q = np.stack([grid_bits & 0xFFFF, grid_bits >> 16], axis=1).astype(np.uint16).view(np.int16)
    p = np.maximum(q / 32767.0, -1)
    z = 1 - np.abs(p).sum(axis=1)
    fold = np.maximum(-z, 0)[:, None]
    p = p + np.where(p >= 0, -fold, fold)
    d = np.concatenate([p, z[:, None]], axis=1)
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))
