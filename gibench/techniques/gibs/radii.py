"""How large surfels are in a scene, and how many of them cover it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gibench.scene.model import Camera, Scene
from gibench.techniques.gibs.settings import PERSPECTIVE, GibsSettings
from gibench.techniques.parts.free_space import points_on_surfaces
from gibench.techniques.parts.surfel_grid import Grid, PerspectiveGrid, UniformGrid

_POINTS = 2048


@dataclass(frozen=True)
class Radii:
    """What a surfel's radius is (kernels_cl/parts/surfels.cl, ``surfel_radius``).

    Attributes:
        angle: radius per metre from the camera.
        least: m.
        most: m.
    """

    angle: float
    least: float
    most: float


def grid_of(scene: Scene, settings: GibsSettings) -> Grid:
    """The grid's shape for a scene."""
    if settings.grid == PERSPECTIVE:
        return PerspectiveGrid.around(scene.bounds, settings.grid_cells)
    return UniformGrid.around(scene.bounds, settings.grid_cells)


def radii_of(scene: Scene, camera: Camera, settings: GibsSettings) -> Radii:
    """The radii of surfels that ``camera`` looks at."""
    low, high = scene.bounds
    most = grid_of(scene, settings).largest_radius
    angle = 2 * math.tan(math.radians(camera.fov_degrees) / 2) * settings.radius_share
    return Radii(
        angle, min(settings.smallest_radius * float(np.linalg.norm(high - low)), most), most
    )


def covering_surfels(scene: Scene, camera: Camera, settings: GibsSettings) -> float:
    """How many surfels lie once over the whole scene, side by side, by area."""
    points, _ = points_on_surfaces(scene, np.random.default_rng(17), _POINTS)
    radii = radii_of(scene, camera, settings)
    away = np.linalg.norm(points - np.asarray(camera.position), axis=1)
    radius = np.clip(radii.angle * away, radii.least, radii.most)
    c = scene.corners.astype(np.float64)
    area = np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum() / 2
    return float(area * (1 / (np.pi * radius**2)).mean())
