"""How GIBS's surfels come and go, against NumPy, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.techniques.gibs.conform_state import (
    ALIVE,
    CAPACITY,
    OBJECTS,
    SEED,
    Sorted,
    alive_surfels,
    into_objects,
    random_words,
    unit,
)
from gibench.techniques.gibs.macros import KEY_FACTOR, NO_PIXEL, NO_RAY
from gibench.techniques.parts.conformance.case import Bench, Case, at_least, off, run_pass
from gibench.techniques.parts.conformance.shading import surface

CHANCE, PRESSURE_FROM = 0.6, 0.97
_POINT = 4e-6
"""m; what single precision makes of a point of a triangle and of its way into an object's space:
some ten roundings of coordinates of a metre or two."""


@dataclass(frozen=True)
class Wish:
    """A surfel that is to be placed."""

    object: int  # from 1
    position: Array
    normal: Array
    birth: int


def _image(state: Sorted, rng: np.random.Generator, number: int) -> list[Wish]:
    """Write a random image and its tiles' least covered pixels; what the camera wants placed."""
    technique, device = state.technique, state.technique.device
    view, width, height = technique.view, technique.scene.width, technique.scene.height
    across = -(-width // 16)
    g_position = rng.uniform(-1, 1, (height, width, 4)).astype(np.float32)
    objects = rng.integers(1, OBJECTS + 1, (height, width)).astype(np.int32)
    g_position[..., 3] = objects.view(np.float32)
    g_normal = rng.normal(size=(height, width, 4))
    g_normal /= np.linalg.norm(g_normal[..., :3], axis=2, keepdims=True)
    g_normal = g_normal.astype(np.float32)
    tiles = across * -(-height // 16)
    words = np.full(tiles, NO_PIXEL, np.int64)
    chosen, wanted = random_words(SEED ^ 0x9E3779B9, number, np.arange(tiles)), []
    for tile in np.flatnonzero(rng.random(tiles) < 0.9):
        y = tile // across * 16 + rng.integers(0, min(16, height - tile // across * 16))
        x = tile % across * 16 + rng.integers(0, min(16, width - tile % across * 16))
        # The threshold is 1, in 1/4096; that itself is covered.
        steps = int(rng.choice([0, 4095, 4096, 5000, int(rng.integers(0, 4096))]))
        words[tile] = steps << 8 | (y % 16) * 16 + x % 16
        if steps < 4096 and chosen[tile, 0] < round(CHANCE * 2**32):
            wanted.append(
                Wish(
                    int(objects[y, x]),
                    g_position[y, x, :3].astype(np.float64),
                    g_normal[y, x, :3].astype(np.float64),
                    int(chosen[tile, 1]),
                )
            )
    device.write(view.position, g_position.reshape(-1, 4))
    device.write(view.normal, g_normal.reshape(-1, 4))
    device.write(view.least, words.astype(np.uint32))
    return wanted


def _hits(state: Sorted, rng: np.random.Generator, number: int) -> list[Wish]:
    """Write random hits of bare surface, one in some cells; what rays want placed."""
    technique, device = state.technique, state.technique.device
    s, scene = technique.surfels, technique.scene.scene
    rays, cells = s.ray_hit.shape[0], s.cell_ray.shape[0]
    triangle = rng.integers(0, len(scene.triangles), rays).astype(np.int32)
    u, v = rng.dirichlet((1, 1, 1), rays)[:, :2].astype(np.float32).T
    kept = np.stack([triangle.view(np.float32), u, v, np.zeros(rays, np.float32)], axis=1)
    mask = int(random_words(SEED, number, 0xBA4E)[0, 0])
    keys = np.full(cells, NO_RAY, np.int64)
    some = np.sort(rng.choice(cells, 60, replace=False))
    ray = rng.choice(rays, 60, replace=False)
    keys[some] = [(int(one) ^ mask) * KEY_FACTOR % 2**32 for one in ray]
    device.write(s.ray_hit, kept)
    device.write(s.cell_ray, keys.astype(np.uint32))
    at = surface(scene, triangle[ray], u[ray].astype(np.float64), v[ray].astype(np.float64))
    chosen = random_words(SEED ^ 0xC2B2AE35, number, some)
    numbers = scene.object_numbers()[triangle[ray]] + 1
    return [
        Wish(int(numbers[k]), at.position[k], at.normal[k], int(chosen[k, 1]))
        for k in range(60)
        if chosen[k, 0] < round(CHANCE * 2**32)
    ]


def _placement(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Surfels placed on pixels, then where rays hit, as long as IDs are free."""
    state = alive_surfels(
        bench,
        rng,
        size,
        "tuned",
        (140, 100),
        placement="rays",
        placement_chance=CHANCE,
        bare_chance=CHANCE,
        recycle_pressure_from=PRESSURE_FROM,
        depth_moments=True,
        ray_guiding=True,
    )
    technique, device = state.technique, state.technique.device
    s, g, number = technique.surfels, technique.surfels.geometry, int(rng.integers(2, 1000))
    # From enough free IDs for all to too few for the camera's alone.
    alive = int(rng.integers(250, 298))
    order = rng.permutation(CAPACITY).astype(np.uint32)
    free = np.zeros(CAPACITY, np.uint32)
    free[: CAPACITY - alive] = order[alive:]
    counters = np.array([alive, CAPACITY - alive, 0, 3, 0], np.uint32)
    before = {name: device.read(getattr(g, name)) for name in ("local_position", "local_normal")}
    for buffer, values in ((g.alive_ids, order), (s.free_ids, free), (s.counters, counters)):
        device.write(buffer, values)
    state.begin(number, alive=alive)
    by_camera, by_rays = _image(state, rng, number), _hits(state, rng, number)
    yield at_least(float(min(len(by_camera), len(by_rays))), 3)
    run_pass(technique, "placement", size)

    first = by_camera[: CAPACITY - alive]
    room = min(
        CAPACITY - alive - len(first), max(0, int(PRESSURE_FROM * CAPACITY) - alive - len(first))
    )
    placed = [*first, *by_rays[:room]]
    count = len(placed)
    ids = free[CAPACITY - alive - 1 - np.arange(count)].astype(int)
    after = np.array([alive + count, CAPACITY - alive - count, count, 3, 0])
    yield off(device.read(s.counters).astype(np.int64), after)
    yield off(device.read(g.alive_ids)[alive : alive + count].astype(np.int64), ids)
    yield off(device.read(s.free_ids).astype(np.int64), free.astype(np.int64))
    yield off(device.read(s.cell_ray).astype(np.int64), np.full(s.cell_ray.shape, NO_RAY))
    owner = np.array([one.object for one in placed]) - 1
    position = np.array([one.position for one in placed])
    normal = np.array([one.normal for one in placed])
    local, turned = into_objects(state.transforms, owner, position, normal)
    for name, expected in (("local_position", local), ("local_normal", turned)):
        whole = before[name].astype(np.float64).T
        whole[ids] = expected
        yield off(device.read(getattr(g, name)).T, whole, absolute=_POINT)
    read = device.read
    yield off(read(g.object_ids)[ids], owner + 1)
    yield off(read(s.births)[ids].astype(np.int64), np.array([one.birth for one in placed]))
    yield off(read(s.seen)[ids].astype(np.int64), np.full(count, number))
    fresh = np.zeros((12, count))
    fresh[10] = 1
    yield off(read(s.estimator)[:, ids], fresh)
    reach = 2 * state.radius_at(position)
    moments = np.repeat(np.stack([reach, reach**2, 0 * reach], axis=1), 16, axis=1)
    yield off(read(s.moments)[ids], moments, 1e-5)
    yield off(read(g.nearest)[ids], reach, 1e-5)
    yield off(read(s.guides)[ids], np.zeros((count, 16)))


def _recycling(bench: Bench, rng: np.random.Generator, size: int, variant: str) -> Iterator[float]:
    """Who stays, by chance, age, distance and coverage; lists of the living and of free IDs."""
    chance, unseen_frames, from_, most, distance = 0.7, 30.0, 0.3, 0.8, 0.6
    settings: dict[str, Any] = {
        "recycle_chance": chance,
        "recycle_unseen_frames": unseen_frames,
        "recycle_pressure_from": from_,
        "recycle_coverage": most,
        "recycle_distance": distance,
    }
    state = alive_surfels(bench, rng, size, variant, **settings)
    technique, device = state.technique, state.technique.device
    s, g, number = technique.surfels, technique.surfels.geometry, int(rng.integers(100, 1000))
    new = int(rng.integers(1, 30))  # placed in this frame
    alive = ALIVE + new
    rest = np.setdiff1d(np.arange(CAPACITY), state.ids)
    order = np.concatenate([state.ids, rng.permutation(rest)])
    free = np.zeros(CAPACITY, np.int64)
    free[: CAPACITY - alive] = order[alive:]
    seen = number - rng.integers(0, 40, CAPACITY)
    births = rng.integers(0, 2**32, CAPACITY, dtype=np.uint32)
    owners = np.zeros(CAPACITY, np.int64)
    owners[order[:alive]] = rng.integers(1, OBJECTS + 1, alive)
    for buffer, values in (
        (g.alive_ids, order),
        (g.object_ids, owners),
        (s.free_ids, free),
        (s.seen, seen),
        (s.births, births),
        (s.counters, np.array([alive, CAPACITY - alive, new, 0, 0])),
    ):
        device.write(buffer, values.astype(buffer.dtype))
    state.begin(number)
    technique._alive = alive
    run_pass(technique, "recycling", size)

    ids = state.ids
    draw = unit(random_words(births[ids] ^ np.uint32(SEED), number, 0xDEAD)[:, 0])
    share = np.clip((alive / CAPACITY - from_) / (1 - from_), 0, 1)
    pressure = share * share * (3 - 2 * share)
    low, high = technique.scene.scene.bounds
    far = distance * float(np.linalg.norm(high - low))
    unseen = number - seen[ids]
    away = np.linalg.norm(state.position[ids] - state.camera, axis=1) / far
    limit = chance * pressure * np.minimum(np.maximum(unseen / unseen_frames, away), 1)
    old = (unseen > 16) & (draw < limit)
    coverage = state.lookup(state.position[ids], state.normal[ids])[:, 3]
    crowded = coverage > most
    keep = np.ones(alive, bool)
    keep[:ALIVE] = (draw >= np.float32(chance)) | ~(old | crowded)
    sure = np.ones(alive, bool)
    sure[:ALIVE] = (np.abs(draw - limit) > 1e-5) & (np.abs(coverage - most) > 1e-3)
    yield at_least(float(sure.mean()), 0.9)
    yield at_least(float(min((~keep).sum(), keep[:ALIVE].sum(), old.sum(), crowded.sum())), 10)
    kept = device.read(s.marks)[:alive].astype(np.int64)
    yield off(kept[sure], keep[sure])

    # What follows from that list must be exact.
    gone, stay = order[:alive][kept == 0], order[:alive][kept == 1]
    survivors, lost = len(stay), len(gone)
    counters = [survivors, CAPACITY - alive + lost, new, lost, survivors]
    yield off(device.read(s.counters).astype(np.int64), np.array(counters))
    yield off(device.read(g.alive_ids)[:survivors].astype(np.int64), stay)
    free[CAPACITY - alive : CAPACITY - alive + lost] = gone
    yield off(device.read(s.free_ids).astype(np.int64), free)
    owners[gone] = 0
    yield off(device.read(g.object_ids), owners)


CASES = [
    Case(
        "GIBS's placement, by the camera and by rays",
        ("gibs/life.cl:placement", "gibs/life.cl:placement_by_rays"),
        _placement,
        (1, 7, 64, 100),
    ),
    *(
        Case(
            f"GIBS's recycling ({variant})",
            tuple(f"gibs/life.cl:recycling_{name}" for name in ("choose", "move", "commit")),
            partial(_recycling, variant=variant),
            (7, 64, 100),
        )
        for variant in ("published", "tuned")
    ),
]
