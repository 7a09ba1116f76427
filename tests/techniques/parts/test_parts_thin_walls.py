"""How thick walls are, against closed forms; and what techniques say of thin ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.scaled import scaled
from support.tiny_scenes import box, quad_scene

from gibench.measure.plan.view import choose_camera
from gibench.profiles import load_profile
from gibench.scene.builtin import build
from gibench.scene.model import Scene
from gibench.techniques.job import Job, Shot
from gibench.techniques.parts.thin_walls import wall_thickness
from gibench.techniques.registry import find_technique


def told(scene: Scene, technique: str, **settings) -> list[str]:
    spec = find_technique(technique)
    job = Job(technique, spec.settings(settings), "tuned", scene.name, load_profile("vega56"), 64,
              shot=Shot(64, 36))  # fmt: skip
    return spec.flaws(job, scene, choose_camera(scene, None))


@pytest.mark.parametrize("factor", [1.0, 1e-3, 2500.0])
def test_a_slab_is_as_thick_as_it_is(factor: float) -> None:
    scene, _ = quad_scene(box((-1, 0, -2), (1, 0.1, 2), inward=False), 2)
    found = wall_thickness(scaled(scene, factor))
    area = 2 * (2 * 4 + 2 * 0.1 + 4 * 0.1)
    near = pytest.approx(0.1 * factor, rel=1e-3)
    assert np.isfinite(found).all()
    assert (np.abs(found / factor - 0.1) < 1e-4).mean() == pytest.approx(16 / area, abs=1e-3)
    assert found[0] == near and found[-1] == pytest.approx(4 * factor, rel=1e-3)


def test_a_room_with_nothing_behind_its_walls_has_none() -> None:
    scene, _ = quad_scene(box((-1, 0, -2), (1, 2, 2), inward=True), 2)
    assert np.isinf(wall_thickness(scene)).all()
    assert told(scene, "irradiance-probes") == []


def test_a_sheet_of_two_faces_is_thin_and_faces_that_look_alike_are_passed() -> None:
    sheet = [((0, 0, 0), (1, 0, 0), (0, 0, -1)), ((0, 0, 0), (0, 0, -1), (1, 0, 0))]
    below = [((0, -0.5, 0), (1, 0, 0), (0, 0, -1)), ((0, -1.0, 0), (0, 0, -1), (1, 0, 0))]
    scene, _ = quad_scene(below, 2)
    np.testing.assert_allclose(wall_thickness(scene), 0.5, atol=1e-4)
    # A lower front that looks the same way does not end the wall; its own end is nearer to it.
    over = ((0, 0.0, 0), (1, 0, 0), (0, 0, -1))
    three, _ = quad_scene([over, *below], 2)
    found = wall_thickness(three)
    assert np.sum(np.abs(found - 0.5) < 1e-3) == pytest.approx(2 * len(found) / 3, rel=0.02)
    assert np.sum(np.abs(found - 1.0) < 1e-3) == pytest.approx(len(found) / 3, rel=0.02)
    both, _ = quad_scene(sheet, 2)
    apart = replace(both, positions=both.positions.copy())
    apart.positions[both.triangles[2:].reshape(-1), 1] -= 1e-4
    assert wall_thickness(apart).max() < 2e-4


def test_techniques_say_what_they_let_through() -> None:
    house, rooms = build("thin-house"), build("two-rooms")
    for scene in (house, rooms):
        (one,) = told(scene, "irradiance-probes")
        assert "which know of no walls" in one
    # 4 cm are thinner than a metre's worth of DDGI's distances; 30 cm between rooms are not.
    (one,) = told(house, "ddgi")
    assert "over which a probe's distances are averaged" in one and "--probes" in one
    wanted = int(one.split("--probes ")[1].split()[0])
    assert len(told(house, "ddgi", probes=wanted)) == 1
    assert told(rooms, "ddgi") == []
    assert told(house, "gibs") == []
    (one,) = told(house, "gibs", depth_moments=False)
    assert "depth_moments=true" in one
    (one,) = told(house, "light-field-probes")
    assert told(rooms, "light-field-probes") == []
    assert told(house, "srp") == told(house, "direct") == []
