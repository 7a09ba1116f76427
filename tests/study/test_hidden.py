"""Receivers that lie in part inside of geometry are told apart."""

from __future__ import annotations

import numpy as np
from support.tiny_scenes import box, quad_scene

from gibench.study.hidden import open_receivers

FLOOR = ((-1.0, 0.0, -1.0), (0.0, 0.0, 2.0), (2.0, 0.0, 0.0))
SIDE = 8


def test_a_box_sunk_into_the_floor():
    """Floor under the box, and the box under the floor, are hidden; a texel under its edge too."""
    sunk = box((-0.4, -0.5, -0.4), (0.4, 0.5, 0.4), inward=False)
    scene, lightmap = quad_scene([FLOOR, *sunk], SIDE)
    found = open_receivers(scene, lightmap)
    position, normal = lightmap.receivers.position, lightmap.receivers.normal
    up, down = normal[:, 1] > 0.5, normal[:, 1] < -0.5
    floor = up & (np.abs(position[:, 1]) < 1e-6)
    under = (np.abs(position[:, [0, 2]]) < 0.5).all(axis=1)  # texels are 0.25 m wide
    assert (floor & under).sum() == 16
    np.testing.assert_array_equal(found[floor], ~under[floor])
    sides = ~up & ~down
    np.testing.assert_array_equal(found[sides], position[sides, 1] > 0)
    assert found[up & ~floor].all() and found[down].all()


def test_the_rays_may_be_had_again_and_chunks_change_nothing(monkeypatch):
    scene, lightmap = quad_scene([FLOOR, *box((-0.4, -0.5, -0.4), (0.4, 0.5, 0.4), False)], 5)
    whole = open_receivers(scene, lightmap, seed=3)
    np.testing.assert_array_equal(whole, open_receivers(scene, lightmap, seed=3))
    monkeypatch.setattr("gibench.study.hidden._CHUNK", 7)
    chunked = open_receivers(scene, lightmap, seed=4)
    assert 0 < whole.sum() < len(whole)
    np.testing.assert_array_equal(whole, chunked)
