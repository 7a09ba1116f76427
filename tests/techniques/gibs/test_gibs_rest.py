"""When GIBS says that it is at rest: the picture is covered, and it stays as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.gibs_scenes import FEW, ROOMY, Frames, furnished, gibs

from gibench.techniques.registry import PUBLISHED, TUNED
from gibench.techniques.technique import LOOK_EVERY, KnowsItsRest

QUICK = {
    **ROOMY,
    "radius_share": 0.1,
    "placement_chance": 1.0,
    "placement": "camera",
    "width": 48,
    "height": 48,
}


def frames_to_rest(technique, frames, most=400):
    """Frames until it says so, looked at as the harness does."""
    assert isinstance(technique, KnowsItsRest)
    assert not technique.at_rest()  # before any frame
    while frames.next < most:
        frames.run(LOOK_EVERY)
        if technique.at_rest():
            return frames.next
    return None


def covered(technique):
    coverage = technique.coverage()
    return float(np.mean(coverage[np.isfinite(coverage)] >= 1 - 1e-4))


@pytest.mark.parametrize("variant", [PUBLISHED, TUNED])
def test_it_rests_with_the_picture_covered_and_its_surfels_there(variant):
    technique = gibs(furnished(), variant, **QUICK)
    frames = Frames(technique)
    first = frames_to_rest(technique, frames)
    assert first is not None and first > 32
    assert covered(technique) >= 0.999
    alive = technique.life()["alive"]
    frames.run(120)
    assert abs(technique.life()["alive"] - alive) <= 0.01 * alive
    assert technique.at_rest()
    # Early on it is neither covered nor steady.
    early = gibs(furnished(), variant, **QUICK)
    Frames(early).run(10)
    assert covered(early) < 0.9 and early.life()["alive"] < 0.9 * alive


def test_it_rests_where_rays_place_surfels_too():
    """They grow ever slower: by less than 0.5 % in 32 frames, 4 % in 120 at most. Its boxes stand a
    millimetre over the floor, where no number of surfels would cover anything.
    """
    technique = gibs(furnished(), **{**QUICK, "placement": "rays"})
    frames = Frames(technique)
    assert frames_to_rest(technique, frames, most=400) is not None
    assert covered(technique) >= 0.999
    alive = technique.life()["alive"]
    frames.run(120)
    assert 0 <= technique.life()["alive"] - alive <= 0.04 * alive


def test_it_rests_where_every_surfel_is_in_use():
    technique = gibs(furnished(), **{**QUICK, **FEW}, recycle_chance=0.0)
    frames = Frames(technique)
    assert frames_to_rest(technique, frames) is not None
    assert technique.life()["free"] == 0
    assert covered(technique) < 0.9


def test_it_does_not_rest_while_surfels_come_slowly_or_not_at_all():
    slow = gibs(furnished(), **{**QUICK, "placement_chance": 0.002})
    assert frames_to_rest(slow, Frames(slow), most=160) is None
    none = gibs(furnished(), **{**QUICK, "placement_chance": 0.0})
    assert frames_to_rest(none, Frames(none), most=80) is None


def test_another_view_wakes_it():
    scene = furnished()
    technique = gibs(scene, **QUICK)
    frames = Frames(technique)
    assert frames_to_rest(technique, frames) is not None
    technique.look_from(replace(scene.cameras[0], position=(-1.7, 1.5, -1.2)))
    frames.run(LOOK_EVERY)
    assert not technique.at_rest()


def test_looking_into_the_void_it_rests_with_nothing():
    scene = furnished()
    away = replace(scene.cameras[0], position=(9.0, 9.0, 9.0), target=(20.0, 20.0, 20.0))
    technique = gibs(replace(scene, cameras=(away,)), **ROOMY)
    frames = Frames(technique)
    assert frames_to_rest(technique, frames) == 64 - LOOK_EVERY
    assert technique.life()["alive"] == 0
