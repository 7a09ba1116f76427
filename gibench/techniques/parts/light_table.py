"""The lights as kernels read them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gibench.arrays import Floats
from gibench.scene.model import DirectionalLight, Light, PointLight, SpotLight
from gibench.techniques.parts.macros import LIGHT_DIRECTIONAL, LIGHT_FLOATS, LIGHT_POINT, LIGHT_SPOT


def light_table(lights: Sequence[Light]) -> Floats:
    """The lights as kernels_cl/common/lights.cl reads them, (n, 12) float32."""
    table = np.zeros((len(lights), LIGHT_FLOATS), np.float32)
    for row, light in zip(table, lights, strict=True):
        match light:
            case DirectionalLight():
                row[0], row[4:7], row[7:10] = LIGHT_DIRECTIONAL, light.direction, light.irradiance
            case PointLight():
                row[0], row[1:4], row[7:10] = LIGHT_POINT, light.position, light.intensity
            case SpotLight():
                row[0], row[1:4], row[7:10] = LIGHT_SPOT, light.position, light.intensity
                row[4:7] = light.direction
                # glTF, KHR_lights_punctual, "Inner and Outer Cone Angles".
                outer = math.cos(light.outer_angle)
                row[10] = 1.0 / max(0.001, math.cos(light.inner_angle) - outer)
                row[11] = -outer * row[10]
    return table
