"""The same room from 2 mm to 5 km: every technique gives the same light."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.made import made
from support.scaled import scaled
from support.tiny_scenes import empty_room, room

from gibench.device import Device
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.profiles import load_profile
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Material, PointLight, ProbeSettings
from gibench.techniques.registry import BakeContext, find_technique, techniques
from gibench.techniques.technique import KnowsItsCover

# Of a room of 2.4 m: powers of two, so that numbers round alike and chance falls the same.
SCALES = {"2 mm": 2.0**-10, "5 km": 2.0**11}
FRAMES = {"gibs": 240}
# SRP's are given: what it chooses at random differs where rounding does.
PROBES = [[x, y, z] for x in (-0.6, 0.6) for y in (0.5, 1.9) for z in (-0.8, 0.8)]
COARSE = {"capture_texels": 32, "map_texels": 16}
SETTINGS = {
    "ddgi": {"counts": "3x3x3", "rays": 128, "storage": "fp32"},
    "gibs": {
        "surfels": 3000,
        "placement_chance": 0.6,
        "rays_per_surfel": 8.0,
        "grid_cells": 10,
        "radius_share": 0.15,
    },
    "srp": {"sh_order": 2, "transport_rays": 256, "relight_samples": 256},
    "irradiance-probes": {"counts": "2x2x2", "relit_share": 1.0, **COARSE},
    "light-field-probes": {"counts": "2x2x2", "relit_share": 1.0, **COARSE},
    "surfel-cache": {"surfels": 300, "links": 32, "caches": 150, "grid": "2x2x2"},
}


@cache
def light(technique: str, factor: float, cache_dir: Path) -> np.ndarray:
    """Indirect irradiance at the receivers (n, 3); NaN where the technique has none to tell."""
    scene, lightmap = room(side=5, lights=(PointLight((0.5, 1.9, 0.5), (4.0, 4.0, 4.0)),))
    if technique == "gibs":  # even light, as surfels' places still differ where offsets do
        glowing = (Material("glowing", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)),)
        scene, lightmap = empty_room(side=5)
        scene = replace(scene, materials=glowing)
    scene = replace(
        scene,
        cameras=(Camera((0.9, 1.6, 1.0), (-0.2, 0.8, -0.2), 80.0),),
        probes=ProbeSettings(len(PROBES), np.array(PROBES, np.float32)),
    )
    scene, lightmap = scaled(scene, factor), stretched(lightmap, factor)
    spec = find_technique(technique)
    settings = spec.settings(SETTINGS.get(technique, {}))
    baked = spec.bake(BakeContext(scene, lightmap, settings, cache_dir))
    profile = replace(load_profile("vega56"), simd_width=1)
    one = made(
        spec, Device(profile), scene, lightmap, settings, baked, "tuned", 64, 32, 24,
        scene.cameras[0], 5,
    )  # fmt: skip
    prepared = prepare_passes(one, 64)
    for frame in range(FRAMES.get(technique, 40)):
        enqueue_frame(one, prepared, frame)
    found = np.array(one.indirect_irradiance(), np.float64)
    if isinstance(one, KnowsItsCover):
        found[~one.covered()] = np.nan
    return found


def stretched(lightmap: Lightmap, factor: float) -> Lightmap:
    """The same receivers in another unit."""
    r, f = lightmap.receivers, lightmap.fragments
    return replace(
        lightmap,
        receivers=replace(
            r,
            position=(r.position * factor).astype(np.float32),
            area=(r.area * factor**2).astype(np.float32),
        ),
        fragments=replace(
            f,
            corners=(f.corners * factor).astype(np.float32),
            area=(f.area * factor**2).astype(np.float32),
        ),
    )


def techniques_and_sizes():
    """Every technique at one of the two sizes in turn; the other one is slow."""
    names = [name for name in techniques() if name != "direct"]
    return [
        pytest.param(name, size, marks=() if m == n % len(SCALES) else pytest.mark.slow)
        for n, name in enumerate(names)
        for m, size in enumerate(SCALES)
    ]


@pytest.mark.parametrize(("technique", "size"), techniques_and_sizes())
def test_a_room_of_any_size_has_the_same_light(tmp_path_factory, technique, size):
    cache_dir = tmp_path_factory.getbasetemp()
    metre, found = (light(technique, factor, cache_dir) for factor in (1.0, SCALES[size]))
    assert min(np.isfinite(metre).mean(), np.isfinite(found).mean()) > 0.9
    # A surfel placed in the last frame is dark yet: of GIBS's even light the median.
    middle = np.nanmedian if technique == "gibs" else np.mean
    assert middle(metre) > 0.1
    assert middle(found) == pytest.approx(middle(metre), rel=0.02)
    if technique != "gibs":
        assert np.sqrt(((found - metre) ** 2).mean()) / metre.mean() < 0.02
