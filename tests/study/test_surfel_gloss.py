"""Surfel caches' gloss and a light with an image against path-traced truths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gibench.profiles import load_profile
from gibench.rays.embree import scene_tracer
from gibench.reference.camera import image_plane
from gibench.resources import data
from gibench.scene.load import load_scene
from gibench.study.experiments import surfel_failures, surfel_gloss
from gibench.study.experiments.common import Context, Measuring
from gibench.study.site import Site
from gibench.work import Worker

SMALL = {"surfels": 8192, "caches": 3000}


def test_the_floor_is_what_lies_lowest():
    """Against the height of what each pixel's middle sees, a row at a time."""
    scene = load_scene(str(data("scenes") / "surfel-caches" / "stars.toml"))
    camera, width, height = scene.cameras[0], 48, 27
    floor = surfel_gloss.floor_seen(scene, camera, width, height)
    origin, ahead, right, up = image_plane(camera, width, height)
    for row in range(height):
        x = 2 * (np.arange(width) + 0.5) / width - 1
        rays = ahead + x[:, None] * right + (1 - 2 * (row + 0.5) / height) * up
        starts = np.broadcast_to(origin, rays.shape).astype(np.float32)
        hits = scene_tracer(scene).closest(starts, rays.astype(np.float32))
        y = origin[1] + hits.distance * rays[:, 1]
        np.testing.assert_array_equal(floor[row], (hits.triangle >= 0) & (y < 1e-3))
    assert 0.1 < floor.mean() < 0.6


def context_in(folder):
    return Context((load_profile("iphone7"),), Site(folder), target_error=0.05)


@pytest.mark.slow
def test_a_glossy_floor_is_lit_as_in_truth(tmp_path, monkeypatch):
    """As far as the bands go: a lamp beside the mirrored direction is smeared into the lobe, by
    three and four bands the brighter; what is projected at run time is similar.
    """
    monkeypatch.setattr(surfel_gloss, "AREA_LIGHT", SMALL)
    monkeypatch.setattr(surfel_gloss, "_IMAGE", (128, 72))
    context = context_in(tmp_path)
    found = {
        (point.key["truth"], point.key["setting"]): surfel_gloss.GLOSS.measure(
            context, Measuring(point), Worker()
        ).rows[0]
        for point in surfel_gloss.GLOSS.points(context)
    }
    narrow, wide = (
        [row for (lobe, _), row in found.items() if lobe == one]
        for one in (surfel_gloss.MIRRORED, surfel_gloss.HALF_VECTOR)
    )
    two, three, four, at_run_time = (row["rel_l2"] for row in narrow)
    assert two < 0.3 and max(three, four) < 0.45
    assert abs(four - at_run_time) < 0.03
    assert all(abs(row["bias"]) < 0.1 for row in narrow)
    assert [row["exponent"] for row in wide] == [5.0, 5.0, 5.0, 5.0, 20.0]


@pytest.mark.slow
def test_a_light_with_an_image_lights_as_in_truth(tmp_path, monkeypatch):
    monkeypatch.setattr(surfel_failures, "AREA_LIGHT", SMALL)
    context = context_in(tmp_path)
    (point,) = [
        point
        for point in surfel_failures.FAILURES.points(context)
        if point.key == {"case": "stars", "setting": "3 bands"}
    ]
    settings = replace(point.job.settings, **SMALL)
    point = replace(point, job=replace(point.job, settings=settings, receivers=3000))
    (row,) = surfel_failures.FAILURES.measure(context, Measuring(point), Worker()).rows
    assert abs(row["bias"]) < 0.1
    assert row["rel_l2"] < 0.15
