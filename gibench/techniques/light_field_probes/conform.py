"""Captured probes' kernels against float64 NumPy and Embree, for `gibench conform`."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.scene.model import Scene
from gibench.techniques.light_field_probes import SPEC
from gibench.techniques.light_field_probes.conform_oracle import (
    SMALL,
    expected_image,
    filtered_irradiance,
    filtered_moments,
    gather,
    inner,
    lobes_of,
    prefiltered,
    randomise,
    relit,
    within_reach,
)
from gibench.techniques.parts.captured_probes.lobes import lobe_sides
from gibench.techniques.parts.conformance.case import (
    Bench,
    Case,
    Tolerance,
    at_least,
    created,
    off,
    run_pass,
)
from gibench.techniques.parts.conformance.octahedral import bordered
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene
from gibench.techniques.registry import BakeContext

# Sums of some hundred positive products in float32.
IRRADIANCE = Tolerance(2e-5)
# Weights are powers of 20 of cosines, which multiply their rounding; those below a ten thousandth
# of the largest are left out.
DISTANCE = Tolerance(0.0, 2e-4)
# The distribution's denominator is a difference from 1 that narrow lobes square.
LOBES = Tolerance(2e-4)
GATHER = Tolerance(2e-3, 2e-3)
RELIT = Tolerance(3e-3, 1e-3)
IMAGE = Tolerance(5e-3, 5e-3)
_SHARP = 20.0
_PIXELS = (48, 32)


def _made(
    bench: Bench,
    rng: np.random.Generator,
    size: int,
    variant: str = "tuned",
    **settings: Any,
) -> tuple[Any, Scene]:
    scene = random_scene(rng, 60)
    glossy = [
        replace(m, roughness=float(rng.random()), metalness=float(rng.random()))
        for m in scene.materials
    ]
    scene = replace(scene, materials=tuple(glossy))
    chosen = SPEC.settings({**SMALL, "storage": "fp32", **settings})
    lightmap = random_lightmap(rng, scene, 300, 20, 20)
    with tempfile.TemporaryDirectory() as cache:
        baked = SPEC.bake(BakeContext(scene, lightmap, chosen, Path(cache)))
    device = bench.open()
    made = created(SPEC, device, scene, lightmap, chosen, baked, variant, size, _PIXELS)
    return made, scene


def _chosen(technique: Any, rng: np.random.Generator) -> Array:
    """The probes that are relit now."""
    held = technique.probes
    (count,) = held.capture["relit"].shape
    probes = rng.choice(held.baked.volume.probes, count, replace=False).astype(np.int32)
    technique.device.write(held.capture["relit"], probes)
    return np.asarray(probes)


def _lit(technique: Any, rng: np.random.Generator) -> Array:
    """Random radiance of the probes that are relit, (k, t, 3)."""
    held = technique.probes
    radiance = np.zeros(held.capture["radiance"].shape)
    texels = held.settings.texels
    radiance[:, :, :texels] = rng.uniform(0, 3, (*radiance.shape[:2], texels))
    technique.device.write(held.capture["radiance"], radiance)
    given = radiance[:, :, :texels].astype(np.float32).astype(np.float64)
    return np.asarray(given.transpose(0, 2, 1))


def _filters(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Radiance to irradiance, distances to their means."""
    side = 4 + 2 * (size % 4)
    technique, _ = _made(bench, rng, size, map_texels=side, distance_sharpness=_SHARP)
    held, device = technique.probes, technique.device
    probes, radiance = _chosen(technique, rng), _lit(technique, rng)
    moments = rng.uniform(0, 1, held.capture["captured_moments"].shape)
    device.write(held.capture["captured_moments"], moments)
    run_pass(technique, "filter_irradiance", size)
    run_pass(technique, "filter_distance", size)
    light, distance = inner(device.read(held.irradiance)), inner(device.read(held.distance))
    yield off(light[probes, :, :3], filtered_irradiance(radiance, side), *IRRADIANCE)
    yield off(distance[probes], filtered_moments(moments[probes], side, _SHARP), *DISTANCE)
    others = np.setdiff1d(np.arange(held.baked.volume.probes), probes)
    yield off(light[others], np.zeros_like(light[others]))


def _prefilter(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Radiance to a map for each step of roughness, by the GGX distribution."""
    side = 8 + 4 * (size % 3)
    technique, _ = _made(bench, rng, size, map_texels=side, gloss_steps=4)
    probes, radiance = _chosen(technique, rng), _lit(technique, rng)
    run_pass(technique, "prefilter", size)
    run_pass(technique, "border_copy", size)
    for found, own in zip(lobes_of(technique), prefiltered(radiance, side, 4), strict=True):
        yield off(found, bordered(found))
        yield off(inner(found)[probes], own, *LOBES)


def _relight(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """What captured texels send, by shadow rays and what the probes held."""
    technique, scene = _made(bench, rng, size, bounces="any", backface_threshold=1.0)
    randomise(technique, rng)
    technique.scene.begin_frame(size)
    probes = _chosen(technique, rng)
    expected, certain = relit(technique, scene, size, probes)
    run_pass(technique, "probe_relight", size)
    found = technique.device.read(technique.probes.capture["radiance"])
    found = found[:, :, : technique.probes.settings.texels].transpose(0, 2, 1)
    yield at_least(float(certain.mean()), 0.5)
    yield off(found[certain], expected[certain], *RELIT)


def _gather(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Irradiance at receivers, of the probes that see them."""
    for variant in SPEC.variants:
        technique, _ = _made(bench, rng, size, variant)
        randomise(technique, rng)
        receivers = technique._world.lightmap.receivers
        position, normal = (a.astype(np.float64) for a in (receivers.position, receivers.normal))
        certain = within_reach(technique, position, normal)
        yield at_least(float(certain.mean()), 0.9)
        found = technique.indirect_irradiance()
        expected = gather(technique, position, normal, normal)
        yield off(found[certain], expected[certain], *GATHER)


def _gloss(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """What pixels show of it: diffuse, and by the split sum what they mirror."""
    technique, scene = _made(bench, rng, size, map_texels=8, gloss_steps=3)
    randomise(technique, rng)
    count = technique.probes.baked.volume.probes
    rows = [
        bordered(rng.uniform(0.1, 2, (count, side + 2, side + 2, 4))).reshape(-1, 4)
        for side in lobe_sides(8, 3)
    ]
    technique.device.write(technique.probes.lobes, np.concatenate(rows))
    found = technique.images()["indirect only"].reshape(-1, 3)
    expected, certain = expected_image(technique, scene, _PIXELS)
    # A camera may look at little that is certain: some pixels are enough, each is compared.
    yield at_least(float(certain.sum()), 8)
    yield off(found[certain], expected[certain], *IMAGE)


CASES = [
    Case(
        "Captured probes' filters",
        ("parts/captured_filter.cl:filter_irradiance", "parts/captured_filter.cl:filter_distance"),
        _filters,
    ),
    Case("Captured probes' gloss (GGX)", ("parts/captured_prefilter.cl:prefilter",), _prefilter),
    Case("Captured probes relit", ("parts/captured_relight.cl:probe_relight",), _relight, (7, 64)),
    Case(
        "Captured probes' gather",
        ("parts/captured_application.cl:receiver_irradiance",),
        _gather,
        (7, 64),
    ),
    Case("Gloss on an image (split sum)", ("parts/apply.cl:application",), _gloss, (7, 64)),
]
