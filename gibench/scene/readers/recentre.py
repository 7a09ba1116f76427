"""Scenes far from their file's origin (maps in UTM, geodetic frames) brought to ours.

float32 positions keep 24 bits. A room of 4 m at 450 km has 3 cm between neighbouring numbers, and
even at 1 km the 256 units in the last place by which rays start off a surface are 1.5 cm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.arrays import Array, Vec3
from gibench.scene.colours import Change, Colours
from gibench.scene.model import Scene
from gibench.scene.readers.content import Content, vec3

# A scene is recentred where its middle lies further from the origin than so many of its diagonals:
# five of float32's 24 bits are then lost to the offset.
FAR = 32.0
# Beyond float32's range a coordinate is as good as infinite.
_LARGEST = float(np.finfo(np.float32).max)


def recentred(content: Content) -> tuple[Content, Vec3]:
    """The content moved to the origin in float64 where it lies far from it.

    It is moved by whole multiples of a power of two near its diagonal, so that a scene whose
    coordinates are exact stays exact.

    Returns:
        The content, lights and cameras with it, and the point that has become the origin.
    """
    low, high = _bounds(content)
    if not (low < high).any():  # nothing finite, or a point: left to the cleaning
        return content, (0.0, 0.0, 0.0)
    diagonal = float(np.linalg.norm(high - low))
    middle = (low + high) / 2
    if float(np.linalg.norm(middle)) <= FAR * diagonal:
        return content, (0.0, 0.0, 0.0)
    step = 2.0 ** np.floor(np.log2(diagonal))
    origin = np.round(middle / step) * step
    matrix = np.eye(4)
    matrix[:3, 3] = -origin
    x, y, z = origin.tolist()
    warning = f"far from the origin: {x:.12g}, {y:.12g}, {z:.12g} m subtracted from all positions"
    moved = content.transformed(matrix)
    return replace(moved, warnings=(*moved.warnings, warning)), vec3(origin)


def _bounds(content: Content) -> tuple[Array, Array]:
    """Smallest and largest finite corner of all triangles, float64."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for part in content.parts:
        inside = (part.triangles >= 0) & (part.triangles < len(part.positions))
        used = part.positions[np.unique(part.triangles[inside])].astype(np.float64)
        used = used[(np.abs(used) < _LARGEST).all(axis=1)]
        if len(used):
            low, high = np.minimum(low, used.min(axis=0)), np.maximum(high, used.max(axis=0))
    return low, high


def points_from_file(points: Array, origin: Vec3) -> Array:
    """Points (n, 3) of the file's space in the scene's."""
    return np.asarray(points, np.float64) - origin


def motions_from_file(motions: tuple[Change, ...], scene: Scene) -> tuple[Change, ...]:
    """Motions whose pivots are points of the file's space, as motions of ``scene``."""
    return (
        tuple(_moved(motion, scene.origin) for motion in motions) if any(scene.origin) else motions
    )


def _moved(motion: Change, origin: Vec3) -> Change:
    if isinstance(motion, Colours) or motion.through is None:
        return motion
    return replace(motion, through=vec3(np.subtract(motion.through, origin)))
