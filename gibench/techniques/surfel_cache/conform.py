"""Surfel caches' kernels against float64 NumPy, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.device import SIMT, WIDE, Layout
from gibench.techniques.parts.conformance.case import (
    Bench,
    Case,
    at_least,
    created,
    off,
    run,
    run_pass,
)
from gibench.techniques.parts.conformance.shading import (
    direct_irradiance,
    light_gain,
    pixel_directions,
)
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene
from gibench.techniques.registry import BakeContext
from gibench.techniques.surfel_cache import SPEC
from gibench.techniques.surfel_cache.conform_oracle import (
    dilated,
    gathered,
    halves,
    link_terms,
    lit_caches,
    lobe,
    random_caches,
    random_flux,
    read,
    spread,
    write,
)
from gibench.techniques.surfel_cache.pack import node_sums
from gibench.techniques.surfel_cache.shared_exponent import LEAST_STEP, MOST, decode, encode
from gibench.work import Serial

SURFELS = 300
SMALL = {"surfels": SURFELS, "links": 20, "caches": 120, "grid": "3x4x2", "relaxation": 2}
SHAPES = ("published", WIDE, SIMT)
"""The published variant, and the tuned one in both layouts."""
_BANDS = {1: 2, 7: 3, 64: 4, 100: 3}
"""Bands of spherical harmonics by work-group size: all there are, whatever the seed."""
HALF = 2e-3
"""What halves of links and of sums are off by, of all that is added up."""
CAPS = 6e-3
"""The same at run time, where a cap's solid angle is a half, too."""


def _made(
    bench: Bench,
    rng: np.random.Generator,
    size: int,
    shape: str,
    image: tuple[int, int] = (24, 16),
    **settings: Any,
) -> Any:
    scene = random_scene(rng, 60)
    lightmap = random_lightmap(rng, scene, 50, 10, 10)
    chosen = SPEC.settings({**SMALL, **settings})
    with TemporaryDirectory() as folder:
        baked = SPEC.bake(BakeContext(scene, lightmap, chosen, Path(folder)), Serial())
    layout: Layout | None = None if shape == "published" else SIMT if shape == SIMT else WIDE
    variant = "tuned" if layout else "published"
    device = bench.open(layout=layout)
    return created(SPEC, device, scene, lightmap, chosen, baked, variant, size, image)


def _pull(bench: Bench, rng: np.random.Generator, size: int, shape: str) -> Iterator[float]:
    """A level adds half a step, 2^-9 of the largest channel at most; what is too much stays the
    most there is, nothing stays nothing.
    """
    technique = _made(bench, rng, size, shape)
    tree = technique.bake.hierarchy
    leaves = np.flatnonzero(tree.child < 0)
    values = 10 ** rng.uniform(-5, 2, (SURFELS, 1)) * rng.uniform(0, 1, (SURFELS, 3))
    values[rng.choice(SURFELS, 60, replace=False)] = 0.0
    bits = np.zeros(len(tree.child), np.uint32)
    bits[leaves] = encode(values)[tree.begin[leaves]]
    write(technique, "node_flux", bits)
    run_pass(technique, "pull", size)
    exact = node_sums(tree, decode(encode(values)))
    height = np.ceil(np.log2(np.maximum(tree.end - tree.begin, 1)))
    depth = np.searchsorted(tree.level, np.arange(len(bits)), side="right")
    height = np.maximum(height, len(tree.level) - 1 - depth)
    bound = ((1 + 2.0**-9) ** height - 1) * exact.max(axis=1) + height * LEAST_STEP
    apart = np.abs(decode(read(technique, "node_flux")) - exact)
    yield float((apart / ((1 + 1e-6) * bound[:, None] + 1e-30)).max())
    bits[leaves] = encode(np.full((SURFELS, 3), np.inf))
    write(technique, "node_flux", bits)
    run_pass(technique, "pull", size)
    most = decode(read(technique, "node_flux"))
    yield off(most, np.full(most.shape, MOST))
    write(technique, "node_flux", np.zeros_like(bits))
    run_pass(technique, "pull", size)
    yield off(read(technique, "node_flux"), np.zeros(len(bits)))


def _lighting(
    bench: Bench, rng: np.random.Generator, size: int, shape: str, projection: str
) -> Iterator[float]:
    """The caches' light from their links and from what they see of the environment."""
    stored = projection == "stored"
    technique = _made(bench, rng, size, shape, sh_bands=_BANDS[size], projection=projection)
    on_map = np.flatnonzero(halves(technique, "cache_map")[:, 0, 3] == 1)
    in_grid = np.flatnonzero(technique.bake.caches.grid_kept)
    flux = random_flux(technique, rng)
    for name in ("cache_lighting_map", "cache_lighting_grid"):
        run_pass(technique, name, size)
    found = np.concatenate(
        [halves(technique, "cache_map")[on_map], halves(technique, "cache_grid")[in_grid]]
    )
    yield off(found[:, 0, 3], np.ones(len(found)))
    yield off(found[:, 1:, 3], np.zeros(found[:, 1:, 3].shape))
    expected = lit_caches(technique, flux, stored)
    terms, node = link_terms(technique, stored)
    most = np.einsum("clk,clh->ckh", np.abs(terms), flux[node]) + np.abs(expected)
    bound = (HALF if stored else CAPS) * most + 2e-5
    bound += (0 if stored else HALF) * most[:, :1]
    yield float((np.abs(found[..., :3] - expected) / bound).max())


def _dilation(bench: Bench, rng: np.random.Generator, size: int, shape: str) -> Iterator[float]:
    """Texels beside lit caches take the mean of those."""
    technique = _made(bench, rng, size, shape, sh_bands=_BANDS[size])
    random_caches(technique, rng)
    atlas = technique.bake.caches.atlas
    whole = (atlas.height, atlas.width, technique.sizes.coefficients, 4)
    before = halves(technique, "cache_map").reshape(whole)
    run_pass(technique, "dilation", size)
    after = halves(technique, "cache_map").reshape(whole)
    border, mean = dilated(before)
    yield at_least(float(border.sum()), 20)
    # A half is known to 2^-11 of itself, its sum of up to eight in single precision.
    yield off(after[border][..., :3], mean, 1e-3, 1e-4)
    yield off(after[~border], before[~border])
    yield off(after[border][..., 3], before[border][..., 3])


def _surfels(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Surfels' radiosity: direct light, what the caches hold there, their emission."""
    technique = _made(bench, rng, size, WIDE, sh_bands=_BANDS[size])
    random_caches(technique, rng)
    frame = int(rng.integers(0, 200))
    technique.begin_frame(frame)
    run_pass(technique, "surfel_lighting", size)
    bake, atlas = technique.bake, technique.bake.caches.atlas
    scene, tree = technique.scene.scene, bake.hierarchy
    leaves = np.flatnonzero(tree.child < 0)
    scale = technique.frame.flux_scale
    flux = decode(read(technique, "node_flux"))[leaves[np.argsort(tree.begin[leaves])]] / scale
    normal = spread(read(technique, "surfel_normal"))
    yield off(normal, bake.surfels.shading, absolute=1e-4)
    position = bake.surfels.position.astype(np.float64)
    lit = direct_irradiance(scene, frame, position, normal, normal)
    irradiance, sure = lit.irradiance, lit.certain
    # A light almost in the triangle's plane meets the triangle or not as rounding will have it.
    for light in scene.lights_at(frame):
        towards = light_gain(light, position)[0]
        geometric = np.einsum("ij,ij->i", bake.surfels.normal, towards)
        sure &= np.abs(geometric) > 0.02
        sure &= geometric * np.einsum("ij,ij->i", normal, towards) > 0
    uv = read(technique, "surfel_uv")
    place = np.stack([uv & 0xFFFF, uv >> 16], axis=1) / 65535 * [atlas.width, atlas.height]
    place[uv == 0xFFFFFFFF] = -1
    indirect, decided = gathered(technique, place, position, lobe(technique, normal))
    irradiance, sure = irradiance + np.pi * indirect, sure & decided
    expected = np.pi * decode(encode(bake.emission)) + bake.albedo * irradiance
    yield at_least(float(sure.mean()), 0.4)
    # Half a step of the flux and of the albedo, and what float32 is off.
    bound = expected.max(axis=1, keepdims=True) * 2.0**-9 + irradiance / 2046
    bound += LEAST_STEP / scale + 1e-3 * expected + 2e-4
    yield float((np.abs(flux - expected) / bound)[sure].max())


def pixels_of(technique: Any) -> tuple[Array, Array, Array, Array]:
    """What the camera sees: per pixel with a surface its row, triangle, place on it, albedo."""
    kept = technique.device.read(technique.frame.hits.buffer)
    width, height = technique.scene.width, technique.scene.height
    tiles = -(-width // 8)
    code = np.arange(64)
    even = (code & 1) | (code >> 1 & 2) | (code >> 2 & 4)
    odd = (code >> 1 & 1) | (code >> 2 & 2) | (code >> 3 & 4)
    item = np.arange(len(kept))
    tile, inside = np.divmod(item, 64)
    x, y = tile % tiles * 8 + even[inside], tile // tiles * 8 + odd[inside]
    triangle = kept[:, 0].view(np.int32)
    shown = (x < width) & (y < height) & (triangle >= 0)
    return (y * width + x)[shown], triangle[shown], kept[shown, 1:3].astype(float), kept[shown, 3:]


def _image(bench: Bench, rng: np.random.Generator, size: int, shape: str) -> Iterator[float]:
    """The caches' light at pixels, a diffuse and a glossy lobe's, and at receivers."""
    exponent, width, height = 20.0, 48, 35
    settings = {"exponent": exponent, "gloss": 0.3, "sh_bands": _BANDS[size]}
    technique = _made(bench, rng, size, shape, (width, height), **settings)
    technique.begin_frame(0)
    random_caches(technique, rng)
    for item in technique.passes():
        if item.name == "camera":
            run(technique.device, item.launches(), size)
    found = technique.images()["indirect only"].reshape(-1, 3)
    row, triangle, uv, albedo = pixels_of(technique)
    yield at_least(float(len(row)), 50)
    weights = np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)
    scene = technique.scene.scene
    corners = scene.triangles[triangle]
    position = np.einsum("ij,ijk->ik", weights, scene.positions[corners].astype(float))
    normal = np.einsum("ij,ijk->ik", weights, scene.normals[corners].astype(float))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    uvs = read(technique, "cache_uvs").reshape(-1, 3, 2)[triangle].astype(float)
    place = np.einsum("ij,ijk->ik", weights, uvs)
    place[uvs[:, 0, 0] < 0] = -1
    light, sure = gathered(technique, place, position, lobe(technique, normal))
    expected = albedo * light
    seen = pixel_directions(scene.cameras[0], width, height)[row]
    mirrored = seen - 2 * (seen * normal).sum(axis=1, keepdims=True) * normal
    terms = lobe(technique, mirrored, exponent)
    expected += 0.3 * gathered(technique, place, position, terms)[0]
    yield at_least(float(sure.mean()), 0.8)
    yield off(found[row[sure]], expected[sure], 2e-3, 3e-4 * float(expected.max()))
    rest = np.setdiff1d(np.arange(width * height), row)
    yield off(found[rest], np.zeros((len(rest), 3)))


def _receivers(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Irradiance at points by places in the map, on and off it, and in the grid."""
    technique = _made(bench, rng, size, WIDE, sh_bands=_BANDS[size])
    random_caches(technique, rng)
    device, atlas, count = technique.device, technique.bake.caches.atlas, 201
    place = rng.uniform(0, (atlas.width, atlas.height), (count, 2)).astype(np.float32)
    place[rng.random(count) < 0.3] = -1
    low, high = technique.scene.scene.bounds
    position = rng.uniform(low - 0.2, high + 0.2, (count, 3)).astype(np.float32)
    normal = rng.normal(size=(count, 3))
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    given = {"place": place, "position": position, "normal": normal}
    held = [device.upload(f"point_{name}", value) for name, value in given.items()]
    held.append(device.empty("point_light", (count, 3), np.float32))
    run(device, [technique.frame.receivers(*held)], size)
    light, sure = gathered(technique, place, position, lobe(technique, normal))
    yield at_least(float(sure.mean()), 0.8)
    most = 1e-3 * float(light.max())
    yield off(device.read(held[-1])[sure], np.pi * light[sure], 2e-3, most)


_FILES = {"published": "published", WIDE: "tuned", SIMT: "simt"}
CASES = [
    *(
        Case(
            f"Surfel caches' hierarchy ({shape})",
            (f"surfel_cache/pull.cl:pull{'_subtrees' if shape == WIDE else ''}",),
            partial(_pull, shape=shape),
            (7, 64),
        )
        for shape in SHAPES
    ),
    *(
        Case(
            f"Surfel caches' lighting ({shape}, {projection})",
            (f"surfel_cache/{_FILES[shape]}_cache_lighting.cl:cache_lighting",),
            partial(_lighting, shape=shape, projection=projection),
        )
        for shape in SHAPES
        for projection in ("stored", "runtime")
    ),
    *(
        Case(
            f"Surfel caches' dilation ({shape})",
            (f"surfel_cache/dilation.cl:dilation{'' if shape == 'published' else '_border'}",),
            partial(_dilation, shape=shape),
            (7, 64),
        )
        for shape in ("published", WIDE)
    ),
    Case(
        "Surfel caches' surfels lit",
        ("surfel_cache/surfel_lighting.cl:surfel_lighting",),
        _surfels,
        (7, 64),
    ),
    Case(
        "Surfel caches at receivers",
        ("surfel_cache/forward_render.cl:receiver_irradiance",),
        _receivers,
        (7, 64),
    ),
    *(
        Case(
            f"Surfel caches on an image ({shape})",
            ("surfel_cache/forward_render.cl:forward_render",),
            partial(_image, shape=shape),
            (7, 64),
        )
        for shape in ("published", WIDE)
    ),
]
