"""What of a scene's geometry decides how densely its light must be sampled: measured by a few rays
from its surfaces, in shares of nothing but itself, so that neither unit nor size matters.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.model import Camera, DirectionalLight, Scene

_POINTS: Final = 4096
_LOOKS: Final = 8  # cosine-distributed rays from each
_REACHED: Final = 700  # points of which it is found whether rays reach them
_FOUND: Final = 0.05  # share of what a place sees whose rays find it soon
_RARE: Final = 0.01  # share of the sphere under which light is looked for where it comes from
_SENDERS: Final = 64  # emitting spots that each point is connected to
# A surface counts as close to another when this share of the whole has one in front of it that is
# no further: it must matter to the picture, and a few niches do not.
_CLOSE_SHARE: Final = 0.2


@dataclass(frozen=True)
class FreeSpace:
    """Of a scene's surfaces, weighted by area.

    Attributes:
        low: corner of the bounds, m.
        high: the other, m.
        closeness: a fifth of the surface has another in front of it, straight along its normal, no
            further than this, m; infinite where less than a fifth has any.
        open: share of what surfaces see that is beyond the scene.
        emitted: mean irradiance that comes straight from emitting surfaces, W/m2.
        sky: that from beyond the scene, W/m2.
        lamps: that from lights, W/m2.
        small_emitters: share of a sphere's directions that end on emitting surfaces, where any do:
            mean over points that see some; 0 where none does.
        bright_sky: share of the sphere that brings half of the sky's light.
    """

    low: Doubles
    high: Doubles
    closeness: float
    open: float
    emitted: float
    sky: float
    lamps: float
    small_emitters: float
    bright_sky: float

    @property
    def extent(self) -> Doubles:
        """Sides of the bounds, m."""
        return np.asarray(self.high - self.low)

    @property
    def light(self) -> float:
        """Irradiance from all that sends light, W/m2."""
        return self.emitted + self.sky + self.lamps


_MEASURED: dict[tuple[int, ...], FreeSpace] = {}


def free_space(scene: Scene) -> FreeSpace:
    """What is measured of ``scene``; once for all scenes of the same triangles and lights."""
    held = (scene.positions, scene.triangles, scene.environment.pixels)
    key = (*map(id, held), hash((scene.lights, scene.materials)))
    if key not in _MEASURED:
        _MEASURED[key] = _measure(scene)
        for part in held:
            weakref.finalize(part, _MEASURED.pop, key, None)
    return _MEASURED[key]


def _measure(scene: Scene) -> FreeSpace:
    rng = np.random.default_rng(7)
    tracer, lift = scene_tracer(scene), surface_offset(scene)
    points, normals = points_on_surfaces(scene, rng, _POINTS)
    origins = (points + lift * normals).astype(np.float32)
    ahead = tracer.closest(origins, normals.astype(np.float32)).distance
    directions = cosine_directions(np.repeat(normals, _LOOKS, axis=0), rng)
    hits = tracer.closest(np.repeat(origins, _LOOKS, axis=0), directions.astype(np.float32))
    away = hits.triangle < 0
    sky, bright = _from_sky(scene, origins, normals, directions[away], len(away), rng)
    emitted, share = _from_emitters(scene, points, normals, origins, rng)
    low, high = scene.bounds
    return FreeSpace(
        low=low,
        high=high,
        closeness=float(np.quantile(ahead.astype(np.float64), _CLOSE_SHARE, method="higher")),
        open=float(away.mean()),
        emitted=emitted,
        sky=sky,
        lamps=_from_lamps(scene, points, normals, origins),
        small_emitters=share,
        bright_sky=bright,
    )


def points_on_surfaces(
    scene: Scene, rng: np.random.Generator, count: int
) -> tuple[Doubles, Doubles]:
    """Points spread over all fronts by area, and their unit normals, (n, 3) each."""
    return _on_triangles(scene.corners.astype(np.float64), rng, count)


def _on_triangles(
    corners: Doubles, rng: np.random.Generator, count: int
) -> tuple[Doubles, Doubles]:
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    below = np.cumsum(twice) / twice.sum()
    at = (np.arange(count) + rng.random(count)) / count
    triangle = np.minimum(np.searchsorted(below, at), len(below) - 1)
    u, v = rng.random((2, count))
    root = np.sqrt(u)
    weights = np.stack([1 - root, root * (1 - v), root * v], axis=1)
    points = np.einsum("nc,ncx->nx", weights, corners[triangle])
    return np.asarray(points), np.asarray(normal[triangle] / twice[triangle, None])


def cosine_directions(normals: Doubles, rng: np.random.Generator) -> Doubles:
    """Directions by the cosine with ``normals``: the normal and a point of the sphere added."""
    away = rng.normal(size=normals.shape)
    found = normals + 0.9999 * away / np.linalg.norm(away, axis=1, keepdims=True)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _from_emitters(
    scene: Scene, points: Doubles, normals: Doubles, origins: npt.NDArray[np.float32],
    rng: np.random.Generator,
) -> tuple[float, float]:  # fmt: skip
    """Mean irradiance from emitting surfaces, and the share of directions that end on them."""
    radiance = np.array([np.mean(m.emission) for m in scene.materials])[scene.material_ids]
    glows = radiance > 0
    if not glows.any():
        return 0.0, 0.0
    corners = scene.corners[glows].astype(np.float64)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    ).sum() / 2  # fmt: skip
    brightness = float(np.average(radiance[glows]))
    senders, facing = _on_triangles(corners, rng, _SENDERS)
    which = rng.integers(_SENDERS, size=len(points))
    way = senders[which] - points
    squared = np.maximum((way**2).sum(axis=1), 1e-30)
    unit = way / np.sqrt(squared)[:, None]
    sent = np.maximum(-(unit * facing[which]).sum(axis=1), 0)
    got = np.maximum((unit * normals).sum(axis=1), 0)
    free = ~scene_tracer(scene).occluded(origins, (senders[which] - origins).astype(np.float32),
                                         1 - 1e-3)  # fmt: skip
    # No point sees more of them than a hemisphere.
    solid = np.minimum(sent * free * area / squared, 2 * np.pi)
    irradiance = float((brightness * solid * got).mean())
    sees = solid > 0
    return irradiance, float(solid[sees].mean() / (4 * np.pi)) if sees.any() else 0.0


def _from_lamps(
    scene: Scene, points: Doubles, normals: Doubles, origins: npt.NDArray[np.float32]
) -> float:
    """Mean irradiance from point, spot and directional lights, W/m2; cones are left out."""
    total, tracer = 0.0, scene_tracer(scene)
    for strength, towards, limit in _towards_lamps(scene, points):
        length = np.linalg.norm(towards, axis=1)
        cosine = np.maximum((towards * normals).sum(axis=1) / np.maximum(length, 1e-30), 0)
        free = ~tracer.occluded(origins, towards.astype(np.float32), limit)
        total += float((strength * cosine * free).mean())
    return total


def _from_sky(
    scene: Scene, origins: npt.NDArray[np.float32], normals: Doubles, away: Doubles, rays: int,
    rng: np.random.Generator,
) -> tuple[float, float]:  # fmt: skip
    """Mean irradiance from the sky, and the share of the sphere of its bright half.

    By those of ``rays`` cosine-distributed rays that go ``away``; a bright half that these would
    hardly meet, which may be one texel, by a ray from each point to some place in it.
    """
    pixels = scene.environment.pixels.astype(np.float64).mean(axis=2)
    height, width = pixels.shape
    rows = np.sin((np.arange(height) + 0.5) / height * np.pi)
    solid = np.broadcast_to((4 * np.pi * rows / rows.sum() / width)[:, None], pixels.shape).ravel()
    flux = pixels.ravel() * solid
    if flux.sum() <= 0:
        return 0.0, 1.0
    order = np.argsort(-pixels.ravel(), kind="stable")
    sent = np.cumsum(flux[order])
    half = order[: int(np.searchsorted(sent, sent[-1] / 2)) + 1]
    share = float(solid[half].sum() / (4 * np.pi))
    if share > _RARE:
        seen = scene.environment.radiance(away).mean(axis=1) if len(away) else np.zeros(1)
        return float(np.pi * seen.sum() / rays), share
    dark = pixels.copy()
    dark.reshape(-1)[half] = 0.0
    # Texels, not interpolated: what is bright must not be counted twice.
    x = np.arctan2(away[:, 0], -away[:, 2]) / (2 * np.pi) + 0.5
    y = np.arccos(np.clip(away[:, 1], -1, 1)) / np.pi
    column = np.minimum((x * width).astype(int), width - 1)
    row = np.minimum((y * height).astype(int), height - 1)
    total = np.pi * dark[row, column].sum() / rays
    chosen = half[
        np.searchsorted(np.cumsum(flux[half]) / flux[half].sum(), rng.random(len(normals)))
    ]
    polar = (chosen // width + 0.5) / height * np.pi
    azimuth = ((chosen % width + 0.5) / width - 0.5) * 2 * np.pi
    ring = np.sin(polar)
    towards = np.stack([ring * np.sin(azimuth), np.cos(polar), -ring * np.cos(azimuth)], axis=1)
    cosine = np.maximum((towards * normals).sum(axis=1), 0)
    free = ~scene_tracer(scene).occluded(origins, towards.astype(np.float32))
    total += float((cosine * free).mean() * flux[half].sum())
    return float(total), share


def in_reach(scene: Scene, camera: Camera, aspect: float, hops: bool) -> float:
    """Share of the lit surface that a camera shows, or with ``hops`` that is found from there by
    rays from surface to surface in a few hundred frames.

    Args:
        scene: the scene.
        camera: the view.
        aspect: width over height of its image.
        hops: whether rays go on.
    """
    rng = np.random.default_rng(11)
    lift = surface_offset(scene)
    points, normals = points_on_surfaces(scene, rng, _REACHED)
    origins = points + lift * normals
    reached = _shown(scene, camera, aspect, origins, normals)
    factors = _view_factors(scene, origins, normals, _area(scene) / _REACHED)
    if hops:
        reached = _spread(reached, factors, _FOUND)
    direct = _lit(scene, points, normals, origins.astype(np.float32), rng)
    lit = _spread(direct, factors, 0.0)
    return float(reached[lit].mean()) if lit.any() else 1.0


def _area(scene: Scene) -> float:
    c = scene.corners.astype(np.float64)
    return float(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum() / 2)


def _shown(
    scene: Scene, camera: Camera, aspect: float, origins: Doubles, normals: Doubles
) -> npt.NDArray[np.bool_]:
    """Which points the camera shows, (n,)."""
    eye, axis = np.asarray(camera.position), np.asarray(camera.target) - camera.position
    axis = axis / np.linalg.norm(axis)
    right = np.cross(axis, camera.up)
    right = right / np.linalg.norm(right)
    way = origins - eye
    depth = way @ axis
    reach = np.tan(np.radians(camera.fov_degrees) / 2) * np.maximum(depth, 0)
    shown = (depth > 0) & ((way * normals).sum(axis=1) < 0)
    shown &= np.abs(way @ np.cross(right, axis)) <= reach
    shown &= np.abs(way @ right) <= reach * aspect
    shown &= ~scene_tracer(scene).occluded(
        origins.astype(np.float32), (-way).astype(np.float32), 1.0
    )
    return np.asarray(shown)


def _view_factors(scene: Scene, origins: Doubles, normals: Doubles, area: float) -> Doubles:
    """What share of what point j sees is around point i, ``area`` m2 each; (n, n)."""
    found = np.zeros((len(origins), len(origins)))
    to = origins[None] - origins[:, None]
    squared = np.maximum((to**2).sum(axis=2), 1e-30)
    leaves = (to * normals[:, None]).sum(axis=2)
    meets = -(to * normals[None]).sum(axis=2)
    one, other = np.nonzero((leaves > 0) & (meets > 0) & np.tri(len(origins), k=-1, dtype=bool))
    free = ~scene_tracer(scene).occluded(
        origins[one].astype(np.float32), to[one, other].astype(np.float32), 1 - 1e-4
    )
    one, other = one[free], other[free]
    factor = (leaves * meets)[one, other] * area / (np.pi * squared[one, other] ** 2)
    found[one, other] = found[other, one] = np.minimum(factor, 1.0)
    return found


def _spread(begun: npt.NDArray[np.bool_], factors: Doubles, least: float) -> npt.NDArray[np.bool_]:
    """``begun`` and all that sees more than ``least`` of what was there before, over and over."""
    now = begun
    while True:
        wider = now | (factors[now].sum(axis=0) > least)
        if (wider == now).all():
            return np.asarray(now)
        now = wider


def _lit(
    scene: Scene, points: Doubles, normals: Doubles, origins: npt.NDArray[np.float32],
    rng: np.random.Generator,
) -> npt.NDArray[np.bool_]:  # fmt: skip
    """Which points light falls on straight from where it is sent, (n,)."""
    tracer = scene_tracer(scene)
    lit = np.zeros(len(points), np.bool_)
    for _, towards, limit in _towards_lamps(scene, points):
        facing = (towards * normals).sum(axis=1) > 0
        lit |= facing & ~tracer.occluded(origins, towards.astype(np.float32), limit)
    directions = cosine_directions(np.repeat(normals, _LOOKS, axis=0), rng)
    hits = tracer.closest(np.repeat(origins, _LOOKS, axis=0), directions.astype(np.float32))
    radiance = scene.environment.radiance(directions).max(axis=1)
    glows = np.array([max(m.emission) for m in scene.materials])[scene.material_ids]
    bright = np.where(hits.triangle < 0, radiance, glows[hits.triangle])
    lit |= (bright > 0).reshape(-1, _LOOKS).any(axis=1)
    senders, facing = _emitting(scene, rng)
    if len(senders):
        which = rng.integers(len(senders), size=len(points))
        way = senders[which] - origins
        meets = ((way * normals).sum(axis=1) > 0) & ((way * facing[which]).sum(axis=1) < 0)
        lit |= meets & ~tracer.occluded(origins, way.astype(np.float32), 1 - 1e-3)
    return lit


def _emitting(scene: Scene, rng: np.random.Generator) -> tuple[Doubles, Doubles]:
    """Places on emitting surfaces and their normals; none where nothing emits."""
    glows = np.array([max(m.emission) for m in scene.materials])[scene.material_ids] > 0
    if not glows.any():
        return np.zeros((0, 3)), np.zeros((0, 3))
    return _on_triangles(scene.corners[glows].astype(np.float64), rng, _SENDERS)


def _towards_lamps(scene: Scene, points: Doubles) -> Iterator[tuple[Doubles, Doubles, float]]:
    """Of each light: irradiance (n,) on what faces it, W/m2, ways to it (n, 3), and how long they
    are in units of themselves; cones are left out.
    """
    for light in scene.lights:
        if isinstance(light, DirectionalLight):
            towards = np.broadcast_to(-np.asarray(light.direction), points.shape)
            yield np.full(len(points), float(np.mean(light.irradiance))), towards, np.inf
        else:
            towards = np.asarray(light.position) - points
            squared = np.maximum((towards**2).sum(axis=1), 1e-30)
            yield np.mean(light.intensity) / squared, towards, 1 - 1e-4
