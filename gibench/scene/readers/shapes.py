"""Simple shapes for scene files, in the sizes and places Mitsuba gives them.

Each is one part with flat or exact normals, to be moved by a transform (Jakob et al., Mitsuba 3
documentation, "Shapes").
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibench.scene.readers.content import Part

_DISK_SIDES = 64
_SPHERE_RINGS = 24


def rectangle() -> Part:
    """The square from (-1, -1, 0) to (1, 1, 0); its front faces +z."""
    positions = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    return Part(
        positions,
        np.array([[0, 1, 2], [0, 2, 3]], np.int64),
        normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        uvs=positions[:, :2] / 2 + 0.5,
    )


def disk() -> Part:
    """The unit disk in z = 0 as a polygon of the same area; its front faces +z."""
    angle = np.arange(_DISK_SIDES) * (2 * np.pi / _DISK_SIDES)
    # A regular polygon of n sides in a circle of radius r has area n/2 r^2 sin(2 pi/n).
    radius = np.sqrt(np.pi / (_DISK_SIDES / 2 * np.sin(2 * np.pi / _DISK_SIDES)))
    rim = radius * np.column_stack((np.cos(angle), np.sin(angle), np.zeros(_DISK_SIDES)))
    i = np.arange(_DISK_SIDES)
    positions = np.concatenate((np.zeros((1, 3)), rim))
    return Part(
        positions,
        np.column_stack((np.zeros_like(i), i + 1, (i + 1) % _DISK_SIDES + 1)),
        normals=np.tile([0.0, 0.0, 1.0], (_DISK_SIDES + 1, 1)),
        uvs=positions[:, :2] / 2 + 0.5,
    )


def cube() -> Part:
    """The cube from (-1, -1, -1) to (1, 1, 1); its fronts face outwards."""
    face = rectangle()
    positions, normals = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            # Columns: where x, y and z of the rectangle go; a rotation, so that fronts stay out.
            frame = np.zeros((3, 3))
            frame[axis, 2] = sign
            frame[(axis + 1) % 3, 0] = sign
            frame[(axis + 2) % 3, 1] = 1.0
            positions.append((face.positions + np.array([0.0, 0.0, 1.0])) @ frame.T)
            normals.append(np.tile(frame[:, 2], (4, 1)))
    starts = 4 * np.arange(6)[:, None, None]
    assert face.uvs is not None
    return Part(
        np.concatenate(positions),
        (face.triangles[None] + starts).reshape(-1, 3),
        normals=np.concatenate(normals),
        uvs=np.tile(face.uvs, (6, 1)),
    )


def sphere() -> Part:
    """The unit sphere by latitude and longitude, poles on y; its front faces outwards."""
    rows, columns = _SPHERE_RINGS, 2 * _SPHERE_RINGS
    v, u = np.meshgrid(np.arange(rows + 1) / rows, np.arange(columns + 1) / columns, indexing="ij")
    polar, azimuth = np.pi * (1 - v.ravel()), 2 * np.pi * u.ravel()
    points = np.column_stack(
        (np.sin(polar) * np.sin(azimuth), np.cos(polar), np.sin(polar) * np.cos(azimuth))
    )
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (i * (columns + 1) + j).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    # At the poles one triangle of each quad has no area.
    upper = np.column_stack((a, c, d))[i.ravel() < rows - 1]
    lower = np.column_stack((a, b, c))[i.ravel() > 0]
    return Part(
        points,
        np.concatenate((lower, upper)),
        normals=points,
        uvs=np.column_stack((u.ravel(), v.ravel())),
    )


SHAPES: dict[str, Callable[[], Part]] = {
    "rectangle": rectangle,
    "disk": disk,
    "cube": cube,
    "sphere": sphere,
}
