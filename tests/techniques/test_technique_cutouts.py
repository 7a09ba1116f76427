"""Techniques on masked leaves against the same holes cut in the mesh."""

from dataclasses import replace

import numpy as np
import pytest
from support.cut_scenes import leaves
from support.made import made
from support.shading_oracle import open_device

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.model import PointLight, ProbeSettings
from gibench.techniques.registry import BakeContext, find_technique

RECEIVERS = 1500
SMALL = {
    "srp": {"sh_order": 3, "transport_rays": 256, "relight_samples": 4000},
    "ddgi": {"probes": 27, "rays": 64},
    "gibs": {"surfels": 1500, "ray_budget": 4000, "grid_cells": 6},
    "direct": {},
}


def ran(scene, folder, name, variant, size, frames, image=(64, 48)):
    """A technique after some frames."""
    lightmap = unwrap(scene, RECEIVERS)
    spec = find_technique(name)
    settings = spec.settings(SMALL[name])
    baked = spec.bake(BakeContext(scene, lightmap, settings, folder))
    technique = made(
        *(spec, open_device(), scene, lightmap, settings, baked, variant, size, *image),
        scene.cameras[0],
    )
    prepared = prepare_passes(technique, size)
    assert not [item.problem for item in prepared if item.problem]
    for frame in range(frames):
        enqueue_frame(technique, prepared, frame)
    return technique


def alike(one, other):
    """The pixels (height, width) of two images that show the same."""
    return np.isclose(one, other, rtol=1e-3, atol=1e-4).all(axis=2)


@pytest.mark.parametrize("variant", ["published", "tuned"])
@pytest.mark.parametrize("size", [16, 64])
def test_direct_light_passes_the_holes(rng, tmp_path, variant, size):
    """Camera rays and shadow rays, single and in packets."""
    both = leaves(rng, count=5, image=(4, 3))
    images = []
    for scene in (both.masked, both.meshed):
        technique = ran(scene, tmp_path, "direct", variant, size, 1)
        held = technique.device.memory.allocated
        assert ("bvh_cutouts" in held) == (scene.cutouts is not None)
        images.append(technique.images()["frame"])
        assert technique.passes()[0].counted(size).rays > 64 * 48
    assert alike(*images).mean() > 0.995  # all but edges of texels
    solid = replace(both.masked, cutouts=None)
    plain = ran(solid, tmp_path, "direct", variant, size, 1).images()["frame"]
    # However few holes are in sight: through them the image is another.
    masked, meshed = (~alike(plain, image) for image in images)
    assert meshed.any()
    assert (masked & meshed).sum() > 0.8 * meshed.sum()


@pytest.mark.parametrize("name, frames", [("srp", 12), ("ddgi", 24)])
def test_indirect_light_of_masked_leaves_is_that_of_the_holes(tmp_path, name, frames):
    """At the walls, whose receivers are alike: within what two lightmaps and estimates differ."""
    # Off all walls: a lamp's bright spot is where few samples make the most of a difference.
    lamp = PointLight((0.25, 0.75, 0.25), (1.0, 0.9, 0.8))
    both = leaves(np.random.default_rng(1), count=5, image=(4, 3), lights=(lamp,))
    grid = np.stack(np.meshgrid(*[[0.17, 0.5, 0.83]] * 3), axis=-1).reshape(-1, 3)
    probes = ProbeSettings(27, grid.astype(np.float32))
    means = []
    for scene in (replace(both.masked, probes=probes), replace(both.meshed, probes=probes)):
        technique = ran(scene, tmp_path / str(len(means)), name, "tuned", 64, frames)
        receivers = unwrap(scene, RECEIVERS).receivers
        wall = np.abs(receivers.albedo[:, 1] - 0.6) < 1e-3
        values, area = technique.indirect_irradiance()[wall], receivers.area[wall, None]
        assert np.isfinite(values).all()
        means.append((values * area).sum(axis=0) / area.sum())
    np.testing.assert_allclose(means[0], means[1], rtol=0.03)


def test_surfels_pass_the_holes(rng, tmp_path):
    """Surfels lie on what is there alone, and gather light."""
    both = leaves(rng, count=5, image=(4, 3), sky=1.0)
    technique = ran(both.masked, tmp_path, "gibs", "tuned", 64, 16)
    values = technique.indirect_irradiance()
    assert np.isfinite(values).all()
    assert values.max() > 0
