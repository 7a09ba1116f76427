"""How surfels come and go: IDs, coverage, flights, the same seed twice."""

import numpy as np
import pytest
from support.gibs_scenes import FEW, HIGH, LOW, ROOMY, Frames, furnished, gibs

from gibench.techniques.gibs.settings import PERSPECTIVE
from gibench.techniques.registry import PUBLISHED, TUNED

FLIGHT = {
    "camera_path": "flight",
    "rest_frames": 0,
    "flight_frames": 250,
    "placement_chance": 0.5,
    "radius_share": 0.06,
    **ROOMY,
}


def ids_of(technique):
    """IDs alive, on the stack, and marked as placed."""
    s, life = technique.surfels, technique.life()
    alive = technique.device.read(s.geometry.alive_ids)[: life["alive"]]
    free = technique.device.read(s.free_ids)[: life["free"]]
    placed = np.flatnonzero(technique.device.read(s.geometry.object_ids))
    return alive, free, placed


@pytest.mark.parametrize("variant", [TUNED, pytest.param(PUBLISHED, marks=pytest.mark.slow)])
def test_no_id_is_lost_or_given_twice_in_a_thousand_frames_of_flight(variant):
    capacity = FEW["surfels"]
    technique = gibs(
        furnished(),
        variant,
        width=32,
        height=32,
        recycle_chance=0.4,
        recycle_unseen_frames=40,
        **{**FLIGHT, "flight_frames": 1000, **FEW},
    )
    frames = Frames(technique)
    recycled = placed = fullest = 0
    for _ in range(1000):
        frames.run()
        alive, free, marked = ids_of(technique)
        assert len(alive) + len(free) == capacity
        assert np.array_equal(np.sort(np.concatenate([alive, free])), np.arange(capacity))
        assert np.array_equal(np.sort(alive), marked)
        life = technique.life()
        recycled, placed = recycled + life["recycled"], placed + life["placed"]
        fullest = max(fullest, len(alive))
    assert placed - recycled == technique.life()["alive"]
    assert recycled > capacity  # every ID was round more than once
    assert fullest == capacity  # and the stack was empty at least once


@pytest.mark.parametrize("grid", ["uniform", PERSPECTIVE])
def test_every_visible_pixel_is_covered_at_rest(grid):
    technique = gibs(
        furnished(), placement_chance=0.5, radius_share=0.05, grid=grid, width=48, height=32,
        **{**ROOMY, "grid_cells": 16 if grid == PERSPECTIVE else 6},
    )  # fmt: skip
    # A tile places one surfel a frame at most, half of the time, and needs about 60.
    frames = Frames(technique).run(330)
    assert technique.life()["free"] > 0
    for _ in range(20):
        frames.run()
        covered = technique.coverage()
        # The threshold is 1; coverage is rounded to 1/4096 before it is compared.
        assert np.nanmin(covered) >= 1 - 0.5 / 4096
    assert np.count_nonzero(np.isfinite(covered)) == covered.size  # the room is closed
    assert np.nanmean(covered) < 4  # and not strewn with surfels
    assert technique.life()["dropped"] == 0


def test_a_pixel_without_surface_gets_no_surfel():
    scene = furnished()
    scene.triangles[:] = scene.triangles[:, ::-1]  # all backs to the camera
    technique = gibs(scene, placement_chance=1.0, **ROOMY)
    Frames(technique).run(5)
    assert technique.life()["alive"] == 0
    assert np.all(np.isnan(technique.coverage()))


def test_the_tuned_variant_repeats_itself_bit_for_bit():
    def result():
        technique = gibs(furnished(), ray_guiding=True, **FLIGHT)
        Frames(technique).run(60)
        estimator = technique.device.read(technique.surfels.estimator)
        return technique.images()["frame"], estimator, ids_of(technique)[0]

    for one, other in zip(result(), result(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_another_seed_gives_other_surfels():
    first = ids_of(gibs(furnished(), seed=1, **FLIGHT))
    runs = [gibs(furnished(), seed=seed, **FLIGHT) for seed in (1, 2)]
    positions = []
    for technique in runs:
        Frames(technique).run(5)
        n = technique.life()["alive"]
        positions.append(technique.device.read(technique.surfels.geometry.local_position)[:, :n])
    assert len(first[0]) == 0
    assert not np.array_equal(*positions)


def test_surfels_lie_on_the_surface_the_pixel_shows():
    technique = gibs(furnished(), placement_chance=1.0, **ROOMY)
    Frames(technique).run(20)
    g = technique.surfels.geometry
    n = technique.life()["alive"]
    ids = technique.device.read(g.alive_ids)[:n]
    p = technique.device.read(g.local_position)[:, ids].T
    objects = technique.device.read(g.object_ids)[ids] - 1
    normal = technique.device.read(g.local_normal)[:, ids].T
    room = objects == 0
    low, high = np.array(LOW), np.array(HIGH)
    off = np.minimum(np.abs(p - low), np.abs(p - high)).min(axis=1)
    assert np.all(off[room] < 1e-5)
    centre = (low + high) / 2
    assert np.all(((centre - p[room]) * normal[room]).sum(1) > 0)
    assert np.count_nonzero(~room) > 10
    for number, a, b in ((1, (-1.2, 0.001, -0.8), (-0.6, 1.1, -0.2)),
                         (2, (0.3, 0.001, 0.1), (1.0, 0.5, 0.8))):  # fmt: skip
        mine = p[objects == number]
        assert np.all((mine >= np.array(a) - 1e-5) & (mine <= np.array(b) + 1e-5))


def test_the_first_rays_reach_who_has_none():
    """A surfel placed in one frame is lit in the next: it asks for rays by its inconsistency."""
    technique = gibs(furnished(), placement_chance=1.0, **ROOMY)
    Frames(technique).run(3)
    n = technique.life()["alive"] - technique.life()["placed"]
    ids = technique.device.read(technique.surfels.geometry.alive_ids)[:n]
    short_mean = technique.device.read(technique.surfels.estimator)[3:6, ids]
    assert np.mean(short_mean.sum(0) > 0) > 0.8


def test_surfels_of_a_full_house_are_recycled_and_a_half_empty_one_is_left_alone():
    settings = {**FLIGHT, "recycle_coverage": 100.0}
    roomy = gibs(furnished(), **settings)  # 30 frames place 180 or so
    frames = Frames(roomy)
    for _ in range(30):
        frames.run()
        assert roomy.life()["recycled"] == 0
    tight = gibs(furnished(), recycle_chance=0.5, **{**settings, **FEW})
    frames = Frames(tight)
    recycled = 0
    for _ in range(80):
        frames.run()
        recycled += tight.life()["recycled"]
    assert recycled > 20


def test_too_much_coverage_thins_out():
    settings = {**ROOMY, "placement_chance": 1.0, "radius_share": 0.12}
    dense = gibs(furnished(), recycle_chance=0.0, placement_threshold=3.0, **settings)
    thinned = gibs(
        furnished(), recycle_chance=0.3, placement_threshold=3.0, recycle_coverage=2.0, **settings
    )
    coverage = []
    for technique in (dense, thinned):
        Frames(technique).run(40)
        coverage.append(np.nanmean(technique.coverage()))
    assert coverage[1] < 0.9 * coverage[0]
