"""The small formulas of glTF 2.0: lights, primitive modes, node and texture transforms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gibench.arrays import Array, Vec3
from gibench.scene.model import (
    DirectionalLight,
    Light,
    PointLight,
    SpotLight,
)
from gibench.scene.readers.content import vec3


def punctual_light(entry: dict[str, Any]) -> Light | None:
    """A KHR_lights_punctual light in its node's space: it shines along -z."""
    color = np.asarray(entry.get("color", [1.0, 1.0, 1.0]), np.float64)
    power: Vec3 = vec3(color * float(entry.get("intensity", 1.0)))
    if not np.isfinite(power).all() or min(power) < 0:
        raise ValueError(f"light intensity {power}")
    kind = entry.get("type")
    if kind == "directional":
        return DirectionalLight((0.0, 0.0, -1.0), power)
    if kind == "point":
        return PointLight((0.0, 0.0, 0.0), power)
    if kind == "spot":
        spot = entry.get("spot", {})
        return SpotLight(
            (0.0, 0.0, 0.0),
            (0.0, 0.0, -1.0),
            power,
            float(spot.get("innerConeAngle", 0.0)),
            float(spot.get("outerConeAngle", math.pi / 4)),
        )
    return None


def triangles(indices: Array, mode: int) -> Array:
    """(t, 3) of a list (4), strip (5) or fan (6): glTF 2.0 specification, 3.7.2.1."""
    if mode == 4:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(len(indices) - 2, 0)
    i = np.arange(count)
    if mode == 5:
        odd = i % 2
        return np.column_stack((indices[i], indices[i + 1 + odd], indices[i + 2 - odd]))
    first = np.full(count, indices[0] if count else 0)
    return np.column_stack((indices[i + 1], indices[i + 2], first))


def local_matrix(node: Any) -> Array:
    """The (4, 4) transform of a node, from its matrix or its translation, rotation and scale."""
    if node.matrix is not None:
        return np.asarray(node.matrix, np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    if node.scale is not None:
        matrix[:3, :3] = np.diag(np.asarray(node.scale, np.float64))
    if node.rotation is not None:
        matrix[:3, :3] = _rotation(np.asarray(node.rotation, np.float64)) @ matrix[:3, :3]
    if node.translation is not None:
        matrix[:3, 3] = node.translation
    return matrix


def _rotation(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion x, y, z, w, which need not be quite of unit length."""
    length = np.linalg.norm(quaternion)
    if quaternion.shape != (4,) or not np.isfinite(length) or length == 0:
        raise ValueError(f"rotation {quaternion.tolist()}")
    x, y, z, w = quaternion / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def uv_matrix(extension: dict[str, Any]) -> Array:
    """KHR_texture_transform: translation * rotation * scale, in glTF's own coordinates."""
    angle = float(extension.get("rotation", 0.0))
    scale = extension.get("scale", [1.0, 1.0])
    offset = extension.get("offset", [0.0, 0.0])
    c, s = math.cos(angle), math.sin(angle)
    shift = np.array([[1, 0, offset[0]], [0, 1, offset[1]], [0, 0, 1]], np.float64)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], np.float64)
    return np.asarray(shift @ turn @ np.diag([scale[0], scale[1], 1.0]))
