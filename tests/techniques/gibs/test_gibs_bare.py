"""Surfels where rays hit bare surface: which hits, what is placed, what light comes of it."""

import numpy as np
import pytest
from support.gibs_scenes import FEW, LOW, ROOMY, Frames, furnace, furnished, gibs

from gibench.errors import BadInput
from gibench.scene.model import Camera
from gibench.techniques.gibs.conform_state import random_words
from gibench.techniques.gibs.macros import NO_RAY
from gibench.techniques.gibs.settings import GibsSettings
from gibench.techniques.registry import PUBLISHED, TUNED

FACTOR = 0x9E3779B1


def cells_of(technique, points):
    grid = technique.grid.grid
    at = np.floor((points - np.array(grid.lower)) / grid.cell).astype(int)
    x, y, _ = grid.shape
    return (at[:, 2] * y + at[:, 1]) * x + at[:, 0]


def hits_of(technique, scene, rays):
    """Positions and objects (from 1) of kept hits."""
    kept = technique.device.read(technique.surfels.ray_hit)[rays]
    triangle = np.ascontiguousarray(kept[:, 0]).view(np.int32)
    u, v = kept[:, 1:3].astype(np.float64).T
    corners = scene.corners[triangle].astype(np.float64)
    weights = np.stack([1 - u - v, u, v], axis=1)
    return np.einsum("nk,nkd->nd", weights, corners), scene.object_ids[triangle] + 1


@pytest.mark.parametrize(
    ("variant", "size"),
    [
        (PUBLISHED, 7),
        (TUNED, 100),
        pytest.param(TUNED, 7, marks=pytest.mark.slow),
        pytest.param(PUBLISHED, 64, marks=pytest.mark.slow),
    ],
)
def test_one_hit_in_a_cell_gets_a_surfel(rng, variant, size):
    scene, seed = furnished(), int(rng.integers(2**31))
    # Of other cells than ROOMY's, on whose borders the walls lie.
    settings = {**ROOMY, "placement": "rays", "bare_threshold": 0.5, "grid_cells": 9}
    technique = gibs(
        scene,
        variant,
        size,
        seed=seed,
        placement_chance=0.6,
        bare_chance=0.6,
        rays_per_surfel=6.0,
        **settings,
    )
    frames, s = Frames(technique, size).run(2), technique.surfels
    device, read = technique.device, technique.device.read
    technique.begin_frame(2)
    nothing = np.full(s.ray_hit.shape, np.nan, np.float32)
    device.write(s.ray_hit, nothing)
    for name in ("transform_and_count", "prefix_sum", "finalise", "irradiance"):
        frames.enqueue(name)
    keys = read(s.cell_ray)
    bare = np.flatnonzero(~np.isnan(read(s.ray_hit)[:, 1]))
    far, owner = read(s.ray_light)[bare, 3], read(s.ray_owner)[bare]
    assert (far > read(s.geometry.radii)[owner]).all()  # shorter ones are passed over
    points, objects = hits_of(technique, scene, bare)
    mask = int(random_words(seed, 3, 0xBA4E)[0, 0])
    own = np.array([(int(ray) ^ mask) * FACTOR % 2**32 for ray in bare], np.uint64)
    expected = np.full(len(keys), NO_RAY, np.uint64)
    np.minimum.at(expected, cells_of(technique, points), own)
    assert 8 < (expected != NO_RAY).sum() < len(bare)
    # A hit on the border between two cells may count to either in float32.
    wrong = np.flatnonzero(keys != expected)
    assert len(wrong) <= 0.02 * len(keys)

    by_number = dict(zip(own.tolist(), zip(points, objects, strict=True), strict=True))
    before = read(s.counters)
    free, ids = read(s.free_ids), []
    launch = frames.launches["placement"][1]
    launch.enqueue(device.queue)
    after = read(s.counters)
    for cell in np.flatnonzero(keys != NO_RAY):
        if random_words(seed ^ 0xC2B2AE35, 3, int(cell))[0, 0] < round(0.6 * 2**32):
            ids.append((free[before[1] - 1 - len(ids)], by_number[int(keys[cell])]))
    assert after[0] - before[0] == before[1] - after[1] == len(ids) > 2
    alive = read(technique.surfels.geometry.alive_ids)[before[0] : after[0]]
    np.testing.assert_array_equal(alive, [one for one, _ in ids])
    placed = read(technique.surfels.geometry.local_position)[:, alive].T
    np.testing.assert_allclose(placed, [where for _, (where, _) in ids], atol=2e-6)
    numbers = read(technique.surfels.geometry.object_ids)[alive]
    np.testing.assert_array_equal(numbers, [number for _, (_, number) in ids])
    assert (read(s.cell_ray) == NO_RAY).all()


def test_they_leave_room_for_what_the_camera_sees():
    """Rays place no more than recycling leaves alone; the camera places up to the last ID."""
    settings = {**FEW, "recycle_pressure_from": 0.5, "placement_chance": 1.0,
                "placement": "rays", "radius_share": 0.01, "recycle_chance": 0.0}  # fmt: skip
    half = FEW["surfels"] // 2
    blind = gibs(furnished(), width=16, height=16, **settings)
    frames, most = Frames(blind), 0
    for _ in range(40):
        before = blind.life()["alive"]
        frames.run()
        alive = blind.life()["alive"]
        # One tile: the camera places one surfel a frame at most.
        assert alive - before <= 1 or alive <= half + 1
        most = max(most, alive)
    assert half < most < 1.5 * half


def closed_in():
    """A glowing room and a camera that sees a little of one wall."""
    scene = furnace()
    camera = Camera((0.0, 1.0, 0.0), (0.0, 1.0, LOW[2]), fov_degrees=25.0)
    object.__setattr__(scene, "cameras", (camera,))
    return scene


@pytest.mark.parametrize("variant", [TUNED, pytest.param(PUBLISHED, marks=pytest.mark.slow)])
def test_light_goes_round_where_no_camera_looks(variant):
    found = {}
    for placement in ("camera", "rays"):
        technique = gibs(closed_in(), variant, placement=placement, rays_per_surfel=4.0,
                         radius_share=0.2, **ROOMY)  # fmt: skip
        Frames(technique).run(150)
        ids = technique.device.read(technique.surfels.geometry.alive_ids)[
            : technique.life()["alive"]
        ]
        place = technique.device.read(technique.surfels.geometry.local_position)[:, ids]
        light = technique.device.read(technique.surfels.estimator)[:3, ids]
        seen = place[2] < LOW[2] + 1e-4
        found[placement] = (~seen).sum(), light[:, seen].mean()
    # Irradiance is pi / (1 - 0.5) where all light that goes round is there.
    assert found["camera"][0] == 0 and found["rays"][0] > 200
    assert found["rays"][1] == pytest.approx(2 * np.pi, rel=0.04)
    assert found["camera"][1] < 0.8 * 2 * np.pi


def test_who_places():
    auto = GibsSettings()
    assert auto.by_rays(published=False) and not auto.by_rays(published=True)
    assert GibsSettings(placement="rays").by_rays(published=True)
    assert not GibsSettings(placement="camera").by_rays(published=False)
    with pytest.raises(BadInput, match="'camera' or 'rays'"):
        GibsSettings(placement="everywhere")
