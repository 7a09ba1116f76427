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
from gibench.scene.model import DirectionalLight, Scene

_POINTS: Final = 4096
_LOOKS: Final = 8  # cosine-distributed rays from each
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
        """Sides of the bounds (3,), m."""
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
    sky, bright, away = sky_at(scene, normals, origins, rng)
    emitted, solid = emitted_at(scene, points, normals, origins, rng)
    sees = solid > 0
    low, high = scene.bounds
    return FreeSpace(
        low=low,
        high=high,
        closeness=float(np.quantile(ahead.astype(np.float64), _CLOSE_SHARE, method="higher")),
        open=float(away.mean()),
        emitted=float(emitted.mean()),
        sky=float(sky.mean()),
        lamps=float(lamps_at(scene, points, normals, origins).mean()),
        small_emitters=float(solid[sees].mean() / (4 * np.pi)) if sees.any() else 0.0,
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
    """Directions (n, 3) by the cosine with ``normals`` (n, 3): the normal and a point of the sphere
    added.
    """
    away = rng.normal(size=normals.shape)
    found = normals + 0.9999 * away / np.linalg.norm(away, axis=1, keepdims=True)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def emitted_at(
    scene: Scene, points: Doubles, normals: Doubles, origins: npt.NDArray[np.float32],
    rng: np.random.Generator,
) -> tuple[Doubles, Doubles]:  # fmt: skip
    """Irradiance (n,) from emitting surfaces, W/m2, and the solid angle (n,) of all that is seen of
    them, sr: a guess at each point by one spot of theirs, right on average.
    """
    radiance = np.array([np.mean(m.emission) for m in scene.materials])[scene.material_ids]
    glows = radiance > 0
    if not glows.any():
        return np.zeros(len(points)), np.zeros(len(points))
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
    return np.asarray(brightness * solid * got), np.asarray(solid)


def lamps_at(
    scene: Scene, points: Doubles, normals: Doubles, origins: npt.NDArray[np.float32]
) -> Doubles:
    """Irradiance (n,) from point, spot and directional lights, W/m2; cones are left out."""
    total, tracer = np.zeros(len(points)), scene_tracer(scene)
    for strength, towards, limit in _towards_lamps(scene, points):
        length = np.linalg.norm(towards, axis=1)
        cosine = np.maximum((towards * normals).sum(axis=1) / np.maximum(length, 1e-30), 0)
        free = ~tracer.occluded(origins, towards.astype(np.float32), limit)
        total += strength * cosine * free
    return total


def sky_at(
    scene: Scene, normals: Doubles, origins: npt.NDArray[np.float32], rng: np.random.Generator
) -> tuple[Doubles, float, npt.NDArray[np.bool_]]:
    """Irradiance (n,) from the sky, W/m2, right on average, the share of the sphere of its bright
    half, and which of each point's rays (n, 8) leave the scene.

    By cosine-distributed rays; a bright half that these would hardly meet, which may be one texel,
    by a ray from each point to some place in it.
    """
    directions = cosine_directions(np.repeat(normals, _LOOKS, axis=0), rng)
    starts = np.repeat(origins, _LOOKS, axis=0)
    leaves = scene_tracer(scene).closest(starts, directions.astype(np.float32)).triangle < 0
    away = directions[leaves]

    def mean(radiance: Doubles) -> Doubles:
        found = np.zeros(len(leaves))
        found[leaves] = radiance
        return np.asarray(np.pi * found.reshape(-1, _LOOKS).mean(axis=1))

    each = leaves.reshape(-1, _LOOKS)
    pixels = scene.environment.pixels.astype(np.float64).mean(axis=2)
    height, width = pixels.shape
    rows = np.sin((np.arange(height) + 0.5) / height * np.pi)
    solid = np.broadcast_to((4 * np.pi * rows / rows.sum() / width)[:, None], pixels.shape).ravel()
    flux = pixels.ravel() * solid
    if flux.sum() <= 0:
        return np.zeros(len(normals)), 1.0, each
    order = np.argsort(-pixels.ravel(), kind="stable")
    sent = np.cumsum(flux[order])
    half = order[: int(np.searchsorted(sent, sent[-1] / 2)) + 1]
    share = float(solid[half].sum() / (4 * np.pi))
    if share > _RARE:
        seen = scene.environment.radiance(away).mean(axis=1) if len(away) else np.zeros(0)
        return mean(seen.astype(np.float64)), share, each
    dark = pixels.copy()
    dark.reshape(-1)[half] = 0.0
    # Texels, not interpolated: what is bright must not be counted twice.
    x = np.arctan2(away[:, 0], -away[:, 2]) / (2 * np.pi) + 0.5
    y = np.arccos(np.clip(away[:, 1], -1, 1)) / np.pi
    column = np.minimum((x * width).astype(int), width - 1)
    row = np.minimum((y * height).astype(int), height - 1)
    total = mean(dark[row, column])
    chosen = half[
        np.searchsorted(np.cumsum(flux[half]) / flux[half].sum(), rng.random(len(normals)))
    ]
    polar = (chosen // width + 0.5) / height * np.pi
    azimuth = ((chosen % width + 0.5) / width - 0.5) * 2 * np.pi
    ring = np.sin(polar)
    towards = np.stack([ring * np.sin(azimuth), np.cos(polar), -ring * np.cos(azimuth)], axis=1)
    cosine = np.maximum((towards * normals).sum(axis=1), 0)
    free = ~scene_tracer(scene).occluded(origins, towards.astype(np.float32))
    return np.asarray(total + cosine * free * flux[half].sum()), share, each


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
