"""GIBS's rays and its light on an image against float64 and Embree, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.rays.embree import EmbreeTracer
from gibench.techniques.gibs.conform_oracle import basis
from gibench.techniques.gibs.conform_state import (
    ALIVE,
    CAPACITY,
    OBJECTS,
    SEED,
    Sorted,
    alive_surfels,
    random_words,
    unit,
)
from gibench.techniques.gibs.macros import GUIDE_FIRST_RAYS, GUIDE_UNIFORM, KEY_FACTOR, NO_RAY
from gibench.techniques.parts.conformance.case import (
    Bench,
    Case,
    Tolerance,
    at_least,
    off,
    run_pass,
)
from gibench.techniques.parts.conformance.hits import met, sent_back
from gibench.techniques.parts.conformance.shading import PlaneHits, surface

LIGHT = Tolerance(1e-3, 1e-4)
"""What rays bring back: weights of surfels are known to 2e-5 (GIBS's gather), light to 3e-4, and
their sum counts as one."""
DIRECTION = 1e-5
"""How far off a direction may be: what single precision makes of sines and square roots, where the
square root's argument is above a hundredth."""
BARE = 1.5
"""Coverage under which a surface is bare here, so that many hits are."""
LEAST_COVERED = 1e-3
"""Coverage under which a mean over surfels is a quotient of roundings."""


@dataclass(frozen=True)
class Cast:
    """Rays as they are cast."""

    direction: Array  # (r, 3)
    factor: Array  # (r,)
    texel: Array  # (r,)
    certain: Array  # (r,) no rounding decides the texel, and the direction is not grazing


def cast(words: Array, normal: Array, guide: Array | None, knows: Array) -> Cast:
    """Directions of rays by the random words (r, 3), the normals (r, 3) of their surfels and these'
    guides (r, 16), of which some are known.
    """
    across, up = unit(words[:, 0]), unit(words[:, 1])
    certain, factor = np.ones(len(words), bool), np.ones(len(words))
    if guide is None:
        square = np.stack([across, up], axis=1) * 2 - 1
        at = np.minimum(((square + 1) * 2).astype(int), 3)
        texel = at[:, 1] * 4 + at[:, 0]
    else:
        total = np.where(knows, guide.sum(axis=1), 0.0)
        share = np.where(total > 0, (1 - GUIDE_UNIFORM) / np.maximum(total, 1e-30), 0.0)[:, None]
        least = np.where(total > 0, GUIDE_UNIFORM, 1.0)[:, None] / 16
        chance = least + share * guide
        upto = np.cumsum(chance, axis=1)
        texel = np.minimum((across[:, None] >= upto).sum(axis=1), 15)
        certain &= np.abs(across[:, None] - upto[:, :15]).min(axis=1) > 1e-5
        row = np.arange(len(words))
        factor = 1 / (16 * chance[row, texel])
        left = (across - (upto[row, texel] - chance[row, texel])) / chance[row, texel]
        inside = np.stack([np.clip(left, 0, 0.999999), up], axis=1)
        square = (np.stack([texel % 4, texel // 4], axis=1) + inside) / 2 - 1
    # Shirley and Chiu 1997.
    a, b = square.T
    wide = np.abs(a) > np.abs(b)
    r, other = np.where(wide, a, b), np.where(wide, b, a)
    angle = np.pi / 4 * other / np.where(r == 0, 1, r)
    x = r * np.where(wide, np.cos(angle), np.sin(angle))
    y = r * np.where(wide, np.sin(angle), np.cos(angle))
    z2 = 1 - x * x - y * y
    certain &= z2 > 1e-2
    t, s = basis(normal)
    direction = x[:, None] * t + y[:, None] * s + np.sqrt(np.maximum(z2, 0))[:, None] * normal
    return Cast(direction, factor, texel, certain)


def _lookup(state: Sorted) -> Any:
    def found(position: Array, normal: Array) -> tuple[Array, Array]:
        light = state.lookup(position, normal)
        weight, cosine = state.weights(position, normal)
        none = ((weight < -1e-4) | (cosine < -1e-4)).all(axis=1)
        return light[:, :3], (light[:, 3] > LEAST_COVERED) | none

    return found


def _trace(
    bench: Bench, rng: np.random.Generator, size: int, variant: str, guided: bool
) -> Iterator[float]:
    """Where surfels' rays go, what comes back along them, and which of them meet bare surface."""
    state = alive_surfels(
        bench, rng, size, variant, ray_guiding=guided, placement="rays", bare_threshold=BARE
    )
    technique, device = state.technique, state.technique.device
    s, number = technique.surfels, int(rng.integers(2, 1000))
    each = rng.integers(0, 8, ALIVE)
    first = np.concatenate([[0], np.cumsum(each)]).astype(np.uint32)
    rays = int(first[-1])
    births = rng.integers(0, 2**32, CAPACITY, dtype=np.uint32)
    guides = rng.exponential(1.0, s.guides.shape).astype(np.float32)
    guides[rng.random(len(guides)) < 0.2] = 0
    owner = np.zeros(s.ray_owner.shape, np.uint32)
    owner[:rays] = np.repeat(np.arange(ALIVE), each)
    firsts = np.zeros(s.ray_first.shape, np.uint32)
    firsts[: ALIVE + 1] = first
    untouched = np.full(s.ray_hit.shape, np.nan, np.float32)
    for buffer, values in (
        (s.births, births),
        (s.guides, guides),
        (s.ray_owner, owner),
        (s.ray_first, firsts),
        (s.ray_hit, untouched),
        (s.cell_ray, np.full(s.cell_ray.shape, NO_RAY, np.uint32)),
    ):
        device.write(buffer, values)
    light_of = int(rng.integers(0, 200))
    technique.scene.begin_frame(light_of)
    state.begin(number, rays)
    device.enqueue(technique._passes._trace(), size)

    place = owner[:rays].astype(int)
    own = state.ids[place]
    words = random_words(births[own] ^ np.uint32(SEED), number, np.arange(rays) - first[place])
    estimator = device.read(s.estimator)
    guide = guides[own].astype(np.float64) if guided else None
    rays_of = cast(words, state.normal[own], guide, estimator[11, own] >= GUIDE_FIRST_RAYS)
    choice = device.read(s.ray_choice)[:rays]
    yield off(choice[rays_of.certain, 1], rays_of.texel[rays_of.certain])
    yield off(choice[rays_of.certain, 0], rays_of.factor[rays_of.certain], 1e-5)

    struck = _struck(state, rng, rays_of, offset_from_surface(state, own), light_of)
    yield at_least(float(struck.told.mean()), 0.25)
    bright = (struck.radiance[struck.hit] > 0).any(axis=1) & struck.told[struck.hit]
    yield at_least(float(bright.sum()), 10)
    found = device.read(s.ray_light)[:rays]
    yield off(found[struck.told, :3], struck.radiance[struck.told], LIGHT.relative, LIGHT.absolute)
    there = struck.hit[struck.sure[struck.hit]]
    far = struck.plane.t, struck.slack
    t, slack = (each[struck.sure[struck.hit]] for each in far)
    yield float((np.abs(found[there, 3] - t) / slack).max())
    yield from _bare(state, number, struck, own)


@dataclass(frozen=True)
class Struck:
    """What rays meet."""

    hit: Array  # (h,) rays that meet anything
    triangle: Array  # (h,)
    plane: PlaneHits  # of the hits
    slack: Array  # (h,) how well the distance is known, m
    sure: Array  # (r,) which rays are certain of what they meet
    radiance: Array  # (r, 3)
    told: Array  # (r,) which are certain of the light, too
    front: Array  # (h,)


def offset_from_surface(state: Sorted, ids: Array) -> Array:
    """Where surfels' rays start (n, 3), with single precision's own bits (Waechter and Binder 2019,
    listing 6.1).
    """
    p = state.position[ids].astype(np.float32)
    n = state.normal[ids].astype(np.float32)
    step = (np.float32(256) * n).astype(np.int32)
    moved = (p.view(np.int32) + np.where(p < 0, -step, step)).view(np.float32)
    near = p + n * np.float32(1 / 65536)
    return np.asarray(np.where(np.abs(p) < 1 / 32, near, moved).astype(np.float64))


def _struck(
    state: Sorted, rng: np.random.Generator, rays: Cast, origin: Array, frame: int
) -> Struck:
    scene = state.technique.scene.scene
    direction = rays.direction
    hits = met(EmbreeTracer(scene.corners), rng, origin, direction)
    sure, told = rays.certain & hits.certain, rays.certain & hits.certain
    hit = np.flatnonzero(hits.triangle >= 0)
    triangle = hits.triangle[hit]
    corners = scene.corners[triangle].astype(np.float64)
    plane = PlaneHits.of(corners, origin[hit], direction[hit])
    # What turning the ray by DIRECTION moves the hit by, along the ray and across the triangle.
    along = np.einsum("ij,ij->i", plane.geometric, direction[hit])
    off_by = DIRECTION * plane.t / np.maximum(np.abs(along), 1e-9)
    slack = plane.slack_t + off_by + 1e-6
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    height = area / edges.max(axis=1)
    plane.slack_u = plane.slack_u + off_by / height
    plane.slack_v = plane.slack_v + off_by / height
    sure[hit] &= slack < 1e-2 * plane.t
    radiance = scene.environment.radiance(direction)
    radiance[hit], light = sent_back(scene, frame, triangle, plane, direction[hit], _lookup(state))
    told &= sure
    told[hit] &= light
    return Struck(hit, triangle, plane, slack, sure, radiance, told, along < 0)


def _bare(state: Sorted, number: int, struck: Struck, own: Array) -> Iterator[float]:
    """Which rays are kept as hits of bare surface, and which of them in each cell."""
    technique, read, rays = state.technique, state.technique.device.read, len(struck.sure)
    kept, grid = read(technique.surfels.ray_hit)[:rays], technique.grid.grid
    hit, plane = struck.hit, struck.plane
    at = surface(technique.scene.scene, struck.triangle, plane.u, plane.v)
    coverage = state.lookup(at.position, at.normal)[:, 3]
    longer = plane.t - state.radius[own[hit]]
    bare = struck.front & (coverage < BARE) & (longer > 0)
    # Coverage is known to 2e-5 (GIBS's gather), and as well as the hit: a surfel's weight falls by
    # 1.5 over its radius at most, four times as fast off its plane, and some eight overlap.
    blurred = 8 * 1.5 * 4 * struck.slack / state.radius[state.ids].min() + 1e-3
    sure = struck.sure[hit] & ((np.abs(coverage - BARE) > blurred) | ~struck.front)
    sure &= (np.abs(longer) > 2 * struck.slack) | ~struck.front
    there = ~np.isnan(kept[:, 0])
    yield at_least(float((sure & bare).sum()), 3)
    yield off(there[hit][sure], bare[sure])
    none = np.setdiff1d(np.flatnonzero(struck.sure), hit)
    yield float(there[none].sum() * 2)
    mine = np.flatnonzero(sure & bare)
    ids = np.ascontiguousarray(kept[hit[mine], 0]).view(np.int32)
    yield off(ids, struck.triangle[mine])
    for column, value, slack in ((1, plane.u, plane.slack_u), (2, plane.v, plane.slack_v)):
        apart = np.abs(kept[hit[mine], column] - value[mine])
        yield float((apart / (slack[mine] + 1e-6)).max())
    mask = random_words(SEED, number, 0xBA4E)[0, 0]
    numbers = np.arange(rays).astype(np.uint32)
    key = ((numbers ^ mask) * np.uint32(KEY_FACTOR)).astype(np.int64)
    cells = (at.position - np.array(grid.lower)) / grid.cell
    inside = (np.abs(cells - np.rint(cells)) * grid.cell > 2 * struck.slack[:, None] + 1e-5).all(1)
    x, y, _ = grid.shape
    low = np.clip(np.floor(cells).astype(int), 0, np.array(grid.shape) - 1)
    cell = (low[:, 2] * y + low[:, 1]) * x + low[:, 0]
    found = read(technique.surfels.cell_ray).astype(np.int64)
    least = np.full(len(found), NO_RAY, np.int64)
    for k in np.flatnonzero(sure & bare & inside):
        least[cell[k]] = min(least[cell[k]], key[hit[k]])
    # A cell's key is no larger than the least of what is sure to lie in it, and belongs to a ray
    # that was kept and is not sure to lie elsewhere.
    yield float((found > least).sum() * 2)
    elsewhere = dict(zip(key[hit[inside & sure]], cell[inside & sure], strict=True))
    named = np.flatnonzero(found != NO_RAY)
    yield off(np.array([elsewhere.get(found[c], c) for c in named]), named)
    of_kept = set(key[np.flatnonzero(there)].tolist())
    yield float(sum(2 for c in named if int(found[c]) not in of_kept))


def _application(
    bench: Bench, rng: np.random.Generator, size: int, variant: str
) -> Iterator[float]:
    """The surfels' light on an image, and which of them it has seen."""
    width, height = 33, 21
    state = alive_surfels(bench, rng, size, variant, (width, height))
    technique, device = state.technique, state.technique.device
    view, s, number = technique.view, technique.surfels, int(rng.integers(100, 1000))
    pixels = width * height
    near = state.ids[rng.integers(0, ALIVE, pixels)]
    g_position = np.zeros((pixels, 4), np.float32)
    g_position[:, :3] = state.position[near] + rng.normal(scale=0.02, size=(pixels, 3))
    surface_of = np.where(rng.random(pixels) < 0.8, rng.integers(1, OBJECTS + 1, pixels), 0)
    g_position[:, 3] = surface_of.astype(np.int32).view(np.float32)
    facing = state.normal[near] + 0.3 * rng.normal(size=(pixels, 3))
    g_normal = np.zeros((pixels, 4), np.float32)
    g_normal[:, :3] = facing / np.linalg.norm(facing, axis=1, keepdims=True)
    albedo = rng.uniform(0, 1, (pixels, 4)).astype(np.float32)
    direct = rng.uniform(0, 2, (pixels, 3)).astype(np.float32)
    seen = rng.integers(0, 100, CAPACITY).astype(np.uint32)
    for buffer, values in (
        (view.position, g_position),
        (view.normal, g_normal),
        (view.albedo, albedo),
        (view.direct, direct),
        (s.seen, seen),
    ):
        device.write(buffer, values)
    # What the irradiance pass changes after the sort must be what is looked up.
    estimator = device.read(s.estimator)
    estimator[:3] = rng.random((3, CAPACITY), np.float32)
    device.write(s.estimator, estimator)
    state.irradiance[:] = estimator[:3].T
    state.begin(number)
    run_pass(technique, "application", size)
    x, n = (one[:, :3].astype(np.float64) for one in (g_position, g_normal))
    shows = surface_of > 0
    light = np.where(shows[:, None], state.lookup(x, n), 0)
    weight, cosine = state.weights(x, n)
    sure = ((light[:, 3] > LEAST_COVERED) | (light[:, 3] == 0)) & (
        (np.abs(weight) > 1e-5) | (cosine < -1e-5)
    ).all(axis=1) | ~shows
    yield at_least(float(sure.mean()), 0.9)
    yield at_least(float((light[:, 3] > 0.1).mean()), 0.2)
    yield off(device.read(view.indirect)[sure], light[sure], absolute=5e-5)
    expected = direct + albedo[:, :3] / np.pi * light[:, :3]
    image = device.read(technique.scene.image).reshape(-1, 3)
    yield off(image[sure], expected[sure], absolute=5e-5)
    row, column = np.divmod(np.arange(pixels), width)
    marks = shows & (column % 4 == number % 4) & (row % 4 == number // 4 % 4)
    counted = ((weight > 0) & (cosine > 0))[marks].any(axis=0)
    doubt = (np.abs(weight) < 1e-5) | (np.abs(cosine) < 1e-5)
    known = ~(doubt & (weight > -1e-5) & (cosine > -1e-5))[marks].any(axis=0)
    wanted = seen.astype(np.int64)
    wanted[state.ids[counted]] = number
    yield at_least(float(known.mean()), 0.9)
    yield at_least(float(counted.sum()), 10)
    mine = state.ids[known]
    yield off(device.read(s.seen)[mine].astype(np.int64), wanted[mine])


CASES = [
    *(
        Case(
            f"GIBS's rays traced ({variant}{', guided' if guided else ''})",
            ("gibs/irradiance.cl:trace_rays",),
            partial(_trace, variant=variant, guided=guided),
            (7, 64),
        )
        for variant, guided in (("published", False), ("tuned", True))
    ),
    *(
        Case(
            f"GIBS's light on an image ({variant})",
            ("gibs/application.cl:application",),
            partial(_application, variant=variant),
            (7, 64, 100),
        )
        for variant in ("published", "tuned")
    ),
]
