"""How much of a scene's light falls where a camera looks, or where rays from there come."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.model import Camera, Scene
from gibench.techniques.parts.free_space import emitted_at, lamps_at, points_on_surfaces, sky_at

_POINTS: Final = 700
_FOUND: Final = 0.05  # share of what a place sees whose rays find it soon
_REFLECTED: Final = 0.5  # of light, by any surface: about what rooms have
_BOUNCES: Final = 3


def light_in_reach(
    scene: Scene, cameras: Camera | Sequence[Camera], aspect: float, hops: bool
) -> float:
    """Share of the indirect light that falls on what cameras show, or with ``hops`` on what is
    found from there by rays from surface to surface in a few hundred frames; 1 where none falls.

    Indirect light is taken as that of the sky, of emitting surfaces and of what half of it and of
    the lamps' light is reflected to in three bounces.

    Args:
        scene: the scene.
        cameras: the view, or several one after another.
        aspect: width over height of its image.
        hops: whether rays go on.
    """
    rng = np.random.default_rng(11)
    lift = surface_offset(scene)
    points, normals = points_on_surfaces(scene, rng, _POINTS)
    origins = points + lift * normals
    views = [cameras] if isinstance(cameras, Camera) else cameras
    shown = [_shown(scene, camera, aspect, origins, normals) for camera in views]
    reached = np.logical_or.reduce(shown)
    factors = _view_factors(scene, origins, normals, _area(scene) / _POINTS)
    if hops:
        reached = _spread(reached, factors)
    light, _ = _indirect(scene, points, normals, origins, factors, rng)
    return float(light[reached].sum() / light.sum()) if light.sum() > 0 else 1.0


def indirect_light(scene: Scene) -> tuple[Doubles, Doubles]:
    """Indirect irradiance (n,) at points spread over all fronts by area, and that of it which comes
    of point, spot and directional lights, W/m2: by few rays and bounces, good for shares of it.

    Args:
        scene: the scene.
    """
    rng = np.random.default_rng(11)
    points, normals = points_on_surfaces(scene, rng, _POINTS)
    origins = points + surface_offset(scene) * normals
    factors = _view_factors(scene, origins, normals, _area(scene) / _POINTS)
    return _indirect(scene, points, normals, origins, factors, rng)


def _indirect(
    scene: Scene, points: Doubles, normals: Doubles, origins: Doubles, factors: Doubles,
    rng: np.random.Generator,
) -> tuple[Doubles, Doubles]:  # fmt: skip
    """Indirect irradiance (n,), about, and that of it which lights send, W/m2."""
    starts = origins.astype(np.float32)
    sent = sky_at(scene, normals, starts, rng)[0]
    sent = sent + emitted_at(scene, points, normals, starts, rng)[0]
    lamps = lamps_at(scene, points, normals, starts)
    # What points stand for overlaps where they are close: no point sees more than all there is.
    seen = factors / np.maximum(factors.sum(axis=0), 1.0)
    found, of_lamps = sent, np.zeros(len(sent))
    for _ in range(_BOUNCES):
        found = sent + _REFLECTED * (found + lamps) @ seen
        of_lamps = _REFLECTED * (of_lamps + lamps) @ seen
    return np.asarray(found), np.asarray(of_lamps)


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


def _spread(begun: npt.NDArray[np.bool_], factors: Doubles) -> npt.NDArray[np.bool_]:
    """``begun`` and all that sees enough of what was there before, over and over."""
    now = begun
    while True:
        wider = now | (factors[now].sum(axis=0) > _FOUND)
        if (wider == now).all():
            return np.asarray(now)
        now = wider
