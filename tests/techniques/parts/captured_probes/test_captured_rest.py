"""When captured probes say that they are at rest: each has had its turn, and nothing came of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.captured_oracle import NAMES, SMALL, create
from support.tiny_scenes import empty_room

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.model import Camera, PointLight, Scene
from gibench.techniques.parts.captured_probes.schedule import Schedule
from gibench.techniques.technique import LOOK_EVERY, KnowsItsRest

LAMP = PointLight((0.3, 2.0, 0.2), (3.0, 2.0, 1.0))


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("captured")


def lit(*lamps: PointLight) -> tuple[Scene, object]:
    scene, lightmap = empty_room(side=4)
    camera = (Camera((0.0, 1.2, 0.0), (0.0, 1.2, 1.0)),)
    return replace(scene, lights=lamps, cameras=camera), lightmap


def frames_to_rest(technique, first, last, each=lambda frame: None):
    """Frames until it says so, looked at as the harness does."""
    prepared = prepare_passes(technique, 64)
    for frame in range(first, last):
        each(frame)
        enqueue_frame(technique, prepared, frame)
        if (frame + 1) % LOOK_EVERY == 0 and technique.at_rest():
            return frame + 1
    return None


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("share", [1.0, 0.125])
def test_relit_they_rest_once_their_bounces_have_come(cache: Path, name: str, share: float) -> None:
    scene, lightmap = lit(LAMP)
    settings = {**SMALL, "relit_share": share, "far_from": 0.2}
    technique = create(name, scene, settings, cache, lightmap=lightmap)
    assert isinstance(technique, KnowsItsRest)
    assert not technique.at_rest()  # before any frame
    first = frames_to_rest(technique, 0, 1200)
    # With 12 probes of which two take turns, those far away the fourth as often: 6 frames at least
    # for a turn, and two turns to compare.
    assert first is not None and first >= (2 * LOOK_EVERY if share == 1.0 else 4 * LOOK_EVERY)
    then = technique.indirect_irradiance().astype(np.float64)
    assert then.mean() > 0
    # It stays so, asked right after a look as well as later.
    assert frames_to_rest(technique, first, first + LOOK_EVERY) == first + LOOK_EVERY
    frames_to_rest(technique, first + LOOK_EVERY, first + 200)
    last = technique.indirect_irradiance().astype(np.float64)
    assert np.linalg.norm(then - last) <= 0.02 * np.linalg.norm(last)
    # And wakes once the light is another and every probe has seen it.
    brighter = replace(LAMP, intensity=(9.0, 6.0, 3.0))
    technique.scene.scene = replace(scene, lights=(brighter,))
    prepared = prepare_passes(technique, 64)
    told = []
    for frame in range(first + 200, first + 400):
        enqueue_frame(technique, prepared, frame)
        if (frame + 1) % LOOK_EVERY == 0:
            told.append(technique.at_rest())
    assert not all(told) and told[-1]


@pytest.mark.parametrize("name", NAMES)
def test_they_never_rest_under_light_that_goes_up_and_down(cache: Path, name: str) -> None:
    scene, lightmap = lit(LAMP)
    technique = create(name, scene, {**SMALL, "relit_share": 0.5}, cache, lightmap=lightmap)
    assert not technique.at_rest()

    def another(frame: int) -> None:
        share = 1 + 0.5 * np.sin(frame)
        now = replace(LAMP, intensity=tuple(share * x for x in LAMP.intensity))
        technique.scene.scene = replace(scene, lights=(now,))

    assert frames_to_rest(technique, 0, 300, another) is None


@pytest.mark.parametrize("name", NAMES)
def test_lit_once_they_always_rest(cache: Path, name: str) -> None:
    scene, lightmap = lit(LAMP)
    technique = create(name, scene, {**SMALL, "update": "static"}, cache, lightmap=lightmap)
    assert technique.at_rest()


@pytest.mark.parametrize("name", NAMES)
def test_in_the_dark_they_rest_after_two_turns(cache: Path, name: str) -> None:
    scene, lightmap = lit()
    technique = create(name, scene, {**SMALL, "relit_share": 1.0}, cache, lightmap=lightmap)
    assert not technique.at_rest()
    assert frames_to_rest(technique, 0, 100) == 2 * LOOK_EVERY


def test_the_oldest_turn_is_told(rng: np.random.Generator) -> None:
    positions = rng.uniform(-1, 1, (7, 3))
    schedule = Schedule(positions, np.arange(7), each_frame=2, far=0.8, slower=3.0)
    lit_in = np.full(7, -np.inf)
    assert schedule.oldest == np.inf
    for frame in range(60):
        chosen, _ = schedule.next((0.0, 0.0, 0.0))
        lit_in[chosen] = frame
        assert schedule.oldest == (frame - lit_in + 1).max()
    assert Schedule(positions[:0], np.arange(0), 1, 1.0, 1.0).oldest == 0
