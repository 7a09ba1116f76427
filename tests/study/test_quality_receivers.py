"""Receivers that are too few for a scene's many parts."""

from __future__ import annotations

import numpy as np
import pytest
from support.tiny_scenes import quad_scene

from gibench.scene.lightmap.atlas import unwrap
from gibench.study.quality import too_few

WALL = ((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))  # faces +z


def test_receivers_that_stand_for_whole_walls_are_said(rng: np.random.Generator):
    """One wall of 100 m2 among crumbs, each a chart that takes a texel of its own."""
    at = rng.uniform(0.1, 1.0, (700, 3)) * (-10, 10, 10)
    crumbs = [(tuple(p), (0.01, 0, 0), (0, 0.01, 0)) for p in at]
    scene, _ = quad_scene([((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (0.0, 10.0, 0.0)), *crumbs], 2)
    few, enough = (unwrap(scene, count).receivers for count in (500, 6000))
    area = few.area.astype(np.float64)
    assert few.effective == pytest.approx(1 / np.square(area / area.sum()).sum())
    assert few.effective < 10
    told = too_few(few)
    assert f"the {len(few)} receivers" in told and f"--receivers {2 * len(few):,}" in told
    assert too_few(enough) is None
    _, lightmap = quad_scene([WALL], 16)
    assert lightmap.receivers.effective == pytest.approx(len(lightmap.receivers), rel=1e-5)
