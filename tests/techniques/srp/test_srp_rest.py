"""When SRP says that it is at rest: its bounces have come together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.srp_setups import bake, create
from support.tiny_scenes import room

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.model import Camera, PointLight
from gibench.techniques.technique import LOOK_EVERY


@pytest.mark.parametrize("update", ["all", "quarter"])
@pytest.mark.parametrize("variant", ["published", "tuned"])
def test_it_rests_once_its_bounces_have_come_together(tmp_path, variant, update):
    scene, lightmap = room(5)
    light = PointLight((0.1, 1.9, 0.2), (2.0, 2.0, 2.0))
    lit = replace(scene, lights=(light,), cameras=(Camera((0.2, 1, 0.8), (0, 1, 0), 70.0),))
    settings = {"probe_update": update}
    technique = create(bake(tmp_path), lit, lightmap, variant, 64, settings)
    prepared = prepare_passes(technique, 64)
    assert not technique.at_rest()

    def run(first, last):
        for frame in range(first, last):
            enqueue_frame(technique, prepared, frame)
            if (frame + 1) % LOOK_EVERY == 0 and technique.at_rest():
                return frame + 1
        return None

    first = run(0, 200)
    assert first is not None and first >= 2 * LOOK_EVERY
    then = technique.indirect_irradiance().astype(np.float64)
    for frame in range(first, first + 100):
        enqueue_frame(technique, prepared, frame)
    last = technique.indirect_irradiance().astype(np.float64)
    assert last.mean() > 0
    assert np.linalg.norm(then - last) <= 0.01 * np.linalg.norm(last)
    technique.scene.scene = replace(lit, lights=(replace(light, intensity=(9.0, 9.0, 9.0)),))
    for frame in range(300, 300 + LOOK_EVERY):
        enqueue_frame(technique, prepared, frame)
    assert not technique.at_rest()


def test_in_the_dark_it_rests_at_once(tmp_path):
    scene, lightmap = room(5)
    dark = replace(scene, lights=(), cameras=(Camera((0.2, 1, 0.8), (0, 1, 0), 70.0),))
    technique = create(bake(tmp_path), dark, lightmap, "tuned", 64)
    prepared = prepare_passes(technique, 64)
    assert not technique.at_rest()
    enqueue_frame(technique, prepared, 0)
    assert not technique.indirect_irradiance().any()
    assert technique.at_rest()
