"""When surfel caches say that they are at rest: their bounces have come together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.surfel_oracle import SMALL, VARIANTS, baked, create
from support.surfel_scenes import looking
from support.tiny_scenes import room

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.model import PointLight
from gibench.techniques.technique import LOOK_EVERY, KnowsItsRest

LAMP = PointLight((0.6, 2.0, 0.6), (4.0, 4.0, 4.0))


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("bakes")


def made(cache: Path, variant: str, *lamps: PointLight, **settings):
    scene, lightmap = room()
    scene, own = looking(replace(scene, lights=lamps)), {**SMALL, **settings}
    bake = baked(scene, lightmap, own, cache)
    return scene, create(scene, lightmap, own, bake, variant)


def frames_to_rest(technique, first, last, each=lambda frame: None):
    """Frames until it says so, looked at as the harness does."""
    prepared = prepare_passes(technique, 64)
    for frame in range(first, last):
        each(frame)
        enqueue_frame(technique, prepared, frame)
        if (frame + 1) % LOOK_EVERY == 0 and technique.at_rest():
            return frame + 1
    return None


@pytest.mark.parametrize("variant", VARIANTS)
def test_they_rest_once_their_bounces_have_come(cache: Path, variant: str) -> None:
    scene, technique = made(cache, variant, LAMP)
    assert isinstance(technique, KnowsItsRest)
    assert not technique.at_rest()  # before any frame
    first = frames_to_rest(technique, 0, 200)
    assert first is not None and first >= 2 * LOOK_EVERY
    then = technique.indirect_irradiance().astype(np.float64)
    prepared = prepare_passes(technique, 64)
    for frame in range(first, first + 60):
        enqueue_frame(technique, prepared, frame)
    last = technique.indirect_irradiance().astype(np.float64)
    assert last.mean() > 0
    assert np.linalg.norm(then - last) <= 0.01 * np.linalg.norm(last)
    assert technique.at_rest()
    brighter = replace(LAMP, intensity=(9.0, 9.0, 9.0))
    technique.scene.scene = replace(scene, lights=(brighter,))
    enqueue_frame(technique, prepared, first + 60)
    assert not technique.at_rest()


def test_with_one_bounce_they_rest_at_the_second_look_with_light(cache: Path) -> None:
    _, technique = made(cache, "tuned", LAMP, bounces=False)
    assert not technique.at_rest()
    assert frames_to_rest(technique, 0, 100) == 2 * LOOK_EVERY


def test_they_never_rest_under_light_that_goes_up_and_down(cache: Path) -> None:
    scene, technique = made(cache, "tuned", LAMP)
    assert not technique.at_rest()

    def another(frame: int) -> None:
        share = 1 + 0.5 * np.sin(frame)
        now = replace(LAMP, intensity=tuple(share * x for x in LAMP.intensity))
        technique.scene.scene = replace(scene, lights=(now,))

    assert frames_to_rest(technique, 0, 120, another) is None


def test_in_the_dark_they_rest_at_once(cache: Path) -> None:
    _, technique = made(cache, "tuned")
    assert not technique.at_rest()
    assert frames_to_rest(technique, 0, 100) == LOOK_EVERY
