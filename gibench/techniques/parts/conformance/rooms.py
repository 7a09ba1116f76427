"""Scenes and lightmaps small enough to check by brute force, made without any unwrapping."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.scene.environment import Environment
from gibench.scene.lightmap import Fragments, Lightmap, Receivers
from gibench.scene.model import Material, Scene

Quad = tuple[tuple[float, float, float], ...]  # corner, edge u, edge v; the front is along u x v


def box(low: Any, high: Any, inward: bool) -> list[Quad]:
    """The six faces of a box, their fronts inside or outside."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    quads: list[Quad] = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3] = (high - low)[(axis + 1) % 3]
        v[(axis + 2) % 3] = (high - low)[(axis + 2) % 3]
        top = low.copy()
        top[axis] = high[axis]
        for corner, front_is_up in ((low, inward), (top, not inward)):
            a, b = (u, v) if front_is_up else (v, u)
            quads.append((_triple(corner), _triple(a), _triple(b)))
    return quads


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def quad_scene(
    quads: list[Quad],
    side: int,
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **more: Any,
) -> tuple[Scene, Lightmap]:
    """A scene of quads, each with ``side`` x ``side`` texels, a free column between them."""
    q = np.asarray(quads, np.float64)  # (n, 3, 3)
    count = len(q)
    corner, u, v = q[:, 0], q[:, 1], q[:, 2]
    positions = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    base = 4 * np.arange(count)[:, None]
    triangles = (base[:, :, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    scene = Scene(
        name="quads",
        positions=positions.reshape(-1, 3).astype(np.float32),
        normals=np.repeat(normal, 4, axis=0).astype(np.float32),
        uvs=np.zeros((4 * count, 2), np.float32),
        triangles=triangles.astype(np.int32),
        material_ids=np.zeros(2 * count, np.int32),
        object_ids=np.repeat(np.arange(count), 2).astype(np.int32),
        materials=(Material("grey", (0.5, 0.5, 0.5)),),
        environment=Environment.constant(sky),
        **more,
    )
    width = count * (side + 1)
    left = np.arange(count) * (side + 1)
    square = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float64)
    corners_uv = square[None] + np.stack([left, np.zeros(count)], axis=1)[:, None]
    triangle_uvs = corners_uv[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 2)

    cells = np.indices((count, side, side)).reshape(3, -1)
    face, j, i = cells
    texel = j * width + left[face] + i
    order = np.argsort(texel)
    face, j, i, texel = face[order], j[order], i[order], texel[order]

    def at(x: Array, y: Array) -> Array:
        return corner[face] + u[face] * (x / side)[:, None] + v[face] * (y / side)[:, None]

    p00, p10, p11, p01 = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    lower, upper = np.stack([p00, p10, p11], axis=1), np.stack([p00, p11, p01], axis=1)
    area = np.linalg.norm(np.cross(u, v), axis=1)[face] / side**2
    n = len(texel)
    fragments = Fragments(
        start=2 * np.arange(n + 1, dtype=np.int64),
        corners=np.stack([lower, upper], axis=1).reshape(-1, 3, 3).astype(np.float32),
        triangle=np.stack([2 * face + (i < j), 2 * face + (i <= j)], axis=1)
        .reshape(-1)
        .astype(np.int32),
        area=np.repeat(area / 2, 2).astype(np.float32),
    )
    receivers = Receivers(
        texel=texel.astype(np.int32),
        position=at(i + 0.5, j + 0.5).astype(np.float32),
        normal=normal[face].astype(np.float32),
        albedo=np.full((n, 3), 0.5, np.float32),
        emission=np.zeros((n, 3), np.float32),
        area=area.astype(np.float32),
    )
    lightmap = Lightmap(width, side, triangle_uvs.astype(np.float32), receivers, fragments, n)
    return scene, lightmap


def room(side: int = 6, open_top: bool = False, **more: Any) -> tuple[Scene, Lightmap]:
    """A room of 2 x 2.4 x 2.2 m, front faces inside, with a solid block on its floor."""
    quads = box((-1, 0, -1.1), (1, 2.4, 1.1), inward=True)
    if open_top:
        quads = [q for q in quads if not all(p == 2.4 for p in _heights(q))]
    block = box((-0.3, 0.0, -0.5), (0.4, 0.9, 0.2), inward=False)
    block = [q for q in block if not all(p == 0.0 for p in _heights(q))]
    return quad_scene(quads + block, side, **more)


def empty_room(side: int = 6, **more: Any) -> tuple[Scene, Lightmap]:
    """The same room without the block: every point sees every other."""
    return quad_scene(box((-1, 0, -1.1), (1, 2.4, 1.1), inward=True), side, **more)


def _heights(quad: Quad) -> list[float]:
    corner, u, v = (np.asarray(part) for part in quad)
    return [p[1] for p in (corner, corner + u, corner + v, corner + u + v)]
