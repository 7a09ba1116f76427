"""A scene in another unit of length: the same picture, the same irradiance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gibench.scene.model import Camera, DirectionalLight, Light, PointLight, Scene, SpotLight


def scaled(scene: Scene, factor: float) -> Scene:
    """``scene`` with all lengths times ``factor``, intensities so that irradiance stays."""
    positions = scene.probes.positions
    moved = None if positions is None else (positions * factor).astype(np.float32)
    return replace(
        scene,
        positions=(scene.positions.astype(np.float64) * factor).astype(np.float32),
        lights=tuple(_light(light, factor) for light in scene.lights),
        cameras=tuple(_camera(camera, factor) for camera in scene.cameras),
        probes=replace(scene.probes, positions=moved),
    )


def _times(values: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    x, y, z = (float(v) * factor for v in values)
    return x, y, z


def _camera(camera: Camera, factor: float) -> Camera:
    return replace(
        camera, position=_times(camera.position, factor), target=_times(camera.target, factor)
    )


def _light(light: Light, factor: float) -> Light:
    if isinstance(light, DirectionalLight):
        return light
    changed: dict[str, Any] = {
        "position": _times(light.position, factor),
        "intensity": _times(light.intensity, factor**2),
    }
    if isinstance(light, PointLight):
        changed["orbit_radius"] = light.orbit_radius * factor
    assert isinstance(light, PointLight | SpotLight)
    return replace(light, **changed)
