"""When DDGI says that it is at rest: its light has come, and it knows when light changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.ddgi_oracle import create
from support.tiny_scenes import empty_room

from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.scene.model import Camera, PointLight
from gibench.techniques.ddgi.technique import rest_window
from gibench.techniques.technique import LOOK_EVERY

SETTINGS = {"counts": "3x3x3", "rays": 96, "fixed_rays": 32}


def test_windows_follow_hysteresis():
    assert rest_window(0.97) * LOOK_EVERY == 72  # 2 / 0.03 frames, in whole looks
    assert rest_window(0.99) * LOOK_EVERY == 200
    assert rest_window(0.5) * LOOK_EVERY == 64
    assert rest_window(0.0) == 8


@pytest.mark.parametrize("hysteresis", [0.9, 0.97])
def test_it_rests_once_its_light_has_come_and_wakes_when_it_goes(hysteresis):
    room, lightmap = empty_room()
    light = PointLight((0.1, 1.2, 0.2), (2.0, 2.0, 2.0))
    scene = replace(room, lights=(light,), cameras=(Camera((0.2, 1, 0.8), (0, 1, 0), 70.0),))
    settings = {**SETTINGS, "hysteresis": hysteresis}
    technique = create(scene, settings, "tuned", lightmap=lightmap)
    prepared = prepare_passes(technique, 64)
    assert not technique.at_rest()

    def run(first, last):
        for frame in range(first, last):
            enqueue_frame(technique, prepared, frame)
            if (frame + 1) % LOOK_EVERY == 0 and technique.at_rest():
                return frame + 1
        return None

    first = run(0, 1200)
    assert first is not None and first >= 2 * 64 - LOOK_EVERY
    then = technique.indirect_irradiance().mean()
    for frame in range(first, first + 400):
        enqueue_frame(technique, prepared, frame)
    last = technique.indirect_irradiance().mean()
    assert then == pytest.approx(last, rel=0.03)
    # A twentieth of the light: the probes are far from what their rays see.
    technique.scene.scene = replace(scene, lights=(replace(light, intensity=(0.1, 0.1, 0.1)),))
    for frame in range(first + 400, first + 400 + LOOK_EVERY):
        enqueue_frame(technique, prepared, frame)
    assert np.isfinite(technique.average_variability())
    assert not technique.at_rest()
