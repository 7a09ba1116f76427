"""Surfel caches in float64 NumPy: what the frame's kernels are held against."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gibench.measure.session.enqueue import prepare_pass
from gibench.techniques.registry import BakeContext
from gibench.techniques.surfel_cache import SPEC, SurfelCache
from gibench.techniques.surfel_cache.bake.data import LINK_SCALE
from gibench.techniques.surfel_cache.sh import BAND_OF, basis, cap_factors, lobe_factors
from gibench.techniques.surfel_cache.shared_exponent import decode, encode
from gibench.work import Serial
from support.made import made
from support.shading_oracle import open_device

VARIANTS = ("published", "tuned")
SHAPES = ("published", "wide", "simt")
"""The published variant, and the tuned one in both layouts."""
SMALL = {"surfels": 300, "links": 20, "caches": 120, "grid": "3x4x2", "relaxation": 2}


def baked(scene, lightmap, settings, cache: Path):
    """The bake of ``scene`` with ``settings`` by name."""
    return SPEC.bake(BakeContext(scene, lightmap, SPEC.settings(settings), cache), Serial())


def create(scene, lightmap, settings, bake, variant="tuned", size=64, image=(24, 16), motion=None):
    """The technique on a fresh device; ``variant`` may be of ``SHAPES``."""
    layout = variant if variant in ("wide", "simt") else None
    variant = "tuned" if layout else variant
    technique: SurfelCache = made(
        *(SPEC, open_device(layout=layout), scene, lightmap, SPEC.settings(settings), bake),
        variant, size,
        *image, scene.cameras[0], motion=motion,
    )  # fmt: skip
    return technique


def run_pass(technique, name, size):
    """One pass alone, ``size`` work-items per group."""
    (declared,) = [p for p in technique.passes() if p.name == name]
    prepared = prepare_pass(technique.device, declared, size)
    assert prepared.problem is None
    for launch in prepared.launches:
        launch.enqueue(technique.device.queue)


def read(technique, name):
    """A buffer of the technique."""
    return technique.device.read(technique.frame.held[name])


def write(technique, name, array):
    """Overwrite a buffer of the technique."""
    technique.device.write(technique.frame.held[name], array)


def halves(technique, name):
    """The caches of a map or grid, (n, coefficients, 4) float64."""
    return read(technique, name).view(np.float16).astype(np.float64)


def random_caches(technique, rng):
    """Fill lit and dilated caches with light from all around; marks stay."""
    for name in ("cache_map", "cache_grid"):
        values = halves(technique, name)
        marked = values[:, 0, 3] > 0
        light = rng.uniform(-0.2, 0.2, values[..., :3].shape)
        light[:, 0] = rng.uniform(0.5, 1.5, light[:, 0].shape)
        values[marked, :, :3] = light[marked]
        write(technique, name, values.astype(np.float16).view(np.uint16))


def random_flux(technique, rng):
    """Random radiosities of all nodes, as stored; (nodes, 3) what they are."""
    nodes = len(technique.bake.hierarchy.child)
    light = 10 ** rng.uniform(-2, 0.5, (nodes, 1)) * rng.uniform(0, 1, (nodes, 3))
    bits = encode(light * technique.frame.flux_scale)
    write(technique, "node_flux", bits)
    return decode(bits) / technique.frame.flux_scale


def link_terms(technique, stored: bool):
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


def lit_caches(technique, flux, stored: bool):
    """Equation 4 of every cache from the fluxes of nodes (nodes, 3), (caches, coefficients, 3)."""
    terms, node = link_terms(technique, stored)
    light = np.einsum("clk,clh->ckh", terms, flux[node])
    environment = technique.bake.caches.environment
    if environment is not None:
        light += environment[:, : light.shape[1]].astype(np.float64)
    return light


def lobe(technique, directions, exponent=1.0):
    """The terms of a lobe about directions (n, 3), (n, coefficients)."""
    k = technique.sizes.coefficients
    return (lobe_factors(exponent)[BAND_OF] * basis(np.asarray(directions, np.float64)))[:, :k]


def gathered(technique, places, positions, terms):
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


def spread(grid_bits):
    """Directions of packed octahedral ones (n,), in float64."""
    q = np.stack([grid_bits & 0xFFFF, grid_bits >> 16], axis=1).astype(np.uint16).view(np.int16)
    p = np.maximum(q / 32767.0, -1)
    z = 1 - np.abs(p).sum(axis=1)
    fold = np.maximum(-z, 0)[:, None]
    p = p + np.where(p >= 0, -fold, fold)
    d = np.concatenate([p, z[:, None]], axis=1)
    return d / np.linalg.norm(d, axis=1, keepdims=True)
