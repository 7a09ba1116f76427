"""Shapes made of parts: turned, swept and hung ones."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.scene.builtin.pieces import (
    Piece,
    Point,
    circle,
    flat,
    panel,
    patch,
)

# A profile turns sharply, and gets a crease, where it bends by more than this.
CREASE_DEGREES = 35.0


def loft(name: str, material: str, rings: Doubles) -> Piece:
    """A smooth skin over closed ``rings`` (rows, n, 3), each counter-clockwise from above.

    Its front is outside when the rings go upwards. A ring may shrink to a point.
    """
    # Tangents halve the bend between rings, however far those are apart.
    step = np.diff(rings, axis=0)
    step = step / np.maximum(np.linalg.norm(step, axis=2, keepdims=True), 1e-12)
    across = np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    along = np.roll(rings, -1, axis=1) - np.roll(rings, 1, axis=1)
    normals = np.cross(along, across)
    size = np.linalg.norm(along, axis=2).max(axis=1)
    for row, beside in ((0, 1), (len(rings) - 1, len(rings) - 2)):
        if size[row] < 1e-9:
            unit = normals[beside] / np.linalg.norm(normals[beside], axis=1, keepdims=True)
            normals[row] = unit.mean(axis=0)
    closed = np.concatenate([rings, rings[:, :1]], axis=1)
    return patch(name, material, closed, np.concatenate([normals, normals[:, :1]], axis=1))


def pieces_of(profile: npt.ArrayLike) -> list[Doubles]:
    """A polyline (k, 2) cut where it bends by more than ``CREASE_DEGREES``."""
    points = np.asarray(profile, np.float64)
    step = np.diff(points, axis=0)
    step = step / np.linalg.norm(step, axis=1, keepdims=True)
    bend = np.degrees(np.arccos(np.clip((step[1:] * step[:-1]).sum(axis=1), -1, 1)))
    cuts = [0, *(np.flatnonzero(bend > CREASE_DEGREES) + 1), len(points) - 1]
    return [points[a : b + 1] for a, b in itertools.pairwise(cuts)]


def lathe(
    name: str,
    material: str,
    profile: npt.ArrayLike,
    segments: int,
    center: Point = (0.0, 0.0, 0.0),
    outline: Doubles | None = None,
) -> list[Piece]:
    """A turned body: ``profile`` (k, 2) of radius and height, its front on the right going along.

    ``outline`` (segments, 2) in (x, -z) replaces the unit circle.
    """
    around = circle(1.0, segments=segments) if outline is None else outline
    made = []
    for piece in pieces_of(profile):
        rings = np.zeros((len(piece), len(around), 3))
        rings[..., 0] = piece[:, :1] * around[:, 0]
        rings[..., 1] = piece[:, 1:]
        rings[..., 2] = -piece[:, :1] * around[:, 1]
        made.append(loft(name, material, rings + np.asarray(center, np.float64)))
    return made


def curve(points: npt.ArrayLike, count: int) -> Doubles:
    """``count`` points (count, 2) of the Catmull-Rom curve through ``points`` (k, 2)."""
    p = np.asarray(points, np.float64)
    padded = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    t = np.linspace(0, len(p) - 1, count)
    i = np.minimum(t.astype(np.int64), len(p) - 2)
    f = (t - i)[:, None]
    a, b, c, d = (padded[i + k] for k in range(4))
    return np.asarray(
        b + f / 2 * (c - a + f * (2 * a - 5 * b + 4 * c - d + f * (3 * (b - c) + d - a)))
    )


def superellipse(x: float, z: float, segments: int, power: float = 4.0) -> Doubles:
    """A rounded rectangle (segments, 2) of half sides ``x`` and ``z``."""
    ring = circle(1.0, segments=segments)
    return np.asarray(np.sign(ring) * np.abs(ring) ** (2 / power) * [x, z])


def fluted_shaft(
    name: str,
    material: str,
    radii: tuple[float, float],
    heights: tuple[float, float],
    *,
    flutes: int,
    segments: int,
    rows: int,
) -> Piece:
    """A column's shaft with entasis and flutes that run out to a circle at both ends."""
    t = np.linspace(0, 1, rows + 1)[:, None]
    angle = np.arange(segments) / segments * 2 * np.pi
    radius = radii[0] + (radii[1] - radii[0]) * t**1.6
    fade = np.clip(np.minimum(t, 1 - t) * 10, 0, 1)
    radius = radius * (1 - 0.07 * fade * np.abs(np.sin(angle * flutes / 2)))
    rings = np.empty((rows + 1, segments, 3))
    rings[..., 0] = radius * np.cos(angle)
    rings[..., 1] = heights[0] + (heights[1] - heights[0]) * t
    rings[..., 2] = -radius * np.sin(angle)
    return loft(name, material, rings)


def swept(
    name: str, material: str, profile: Doubles, frames: tuple[Doubles, Doubles, Doubles]
) -> list[Piece]:
    """A profile carried along a path, creased at every corner of the profile.

    Args:
        name: of the object.
        material: its material.
        profile: (k, 2) coordinates (a, b); the front lies on the side (db, -da).
        frames: origin, direction of a, direction of b along the path, each (m, 3).
    """
    origin, a, b = frames
    made = []
    for start, end in itertools.pairwise(profile):
        points = np.stack([origin + p[0] * a + p[1] * b for p in (start, end)])
        d = end - start
        normal = np.broadcast_to(d[1] * a - d[0] * b, points.shape)
        made.append(patch(name, material, points, normal))
    return made


def rim(name: str, material: str, half: tuple[float, float], profile: npt.ArrayLike) -> list[Piece]:
    """A moulding around a rectangular opening, facing its middle, mitred at the corners.

    ``profile`` (k, 2) lists how far it stands into the opening, and the height, going upwards.
    """
    p = np.asarray(profile, np.float64)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float64)
    made = []
    for i in range(4):
        ends = corners[[i, (i + 1) % 4]]
        origin = np.stack([ends[:, 0] * half[0], np.zeros(2), ends[:, 1] * half[1]], axis=1)
        inwards = np.stack([-ends[:, 0], np.zeros(2), -ends[:, 1]], axis=1)
        up = np.tile([0.0, 1.0, 0.0], (2, 1))
        side = swept(name, material, p, (origin, inwards, up))
        # The mitre leans the direction inwards along the side; the side itself is straight.
        across = -(ends[0] + ends[1]) / 2
        made += [_facing(part, across) for part in side]
    return made


def _facing(part: Piece, across: Doubles) -> Piece:
    """A mitred strip with its normal turned square to the side it runs along."""
    keep = np.abs(across) > 0.5
    normals = part.normals * [float(keep[0]), 1.0, float(keep[1])]
    return replace(part, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True))


def post(
    name: str, material: str, ring: Doubles, bottom: Doubles | float, top: Doubles | float
) -> Piece:
    """An upright prism over ``ring`` (n, 2) in (x, -z), without ends."""
    x, z = ring[:, 0], -ring[:, 1]
    rings = np.stack([np.stack([x, np.broadcast_to(y, x.shape), z], axis=1) for y in (bottom, top)])
    return loft(name, material, rings)


def handrail(
    name: str,
    material: str,
    start: Point,
    run: Point,
    size: tuple[float, float],
    posts: Sequence[Doubles],
) -> list[Piece]:
    """A closed bar from ``start`` along ``run``; ``start`` lies in the middle of its underside.

    ``posts`` are rings (n, 2) in (x, -z) of upright posts that carry it; its underside has holes
    there.
    """
    o, d = np.asarray(start, np.float64), np.asarray(run, np.float64)
    length = float(np.linalg.norm(d))
    u = d / length
    side = np.cross(u, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, u)
    level = np.array([u[0], u[2]]) / np.hypot(u[0], u[2])
    slope = float(np.hypot(u[0], u[2]))
    holes = []
    for ring in posts:
        from_start = np.stack([ring[:, 0] - o[0], -ring[:, 1] - o[2]], axis=1)
        along = from_start @ level / slope
        holes.append(np.stack([along, from_start @ side[[0, 2]]], axis=1))
    half, height = size[0] / 2, size[1]
    outline = [(0.0, -half), (length, -half), (length, half), (0.0, half)]
    bar = [flat(name, material, outline, holes, origin=o, u=u, v=side)]
    corners = [o - half * side, o + half * side]
    bar.append(panel(name, material, corners[1], d, height * up))
    bar.append(panel(name, material, corners[0] + d, -d, height * up))
    bar.append(panel(name, material, corners[1] + height * up, d, -2 * half * side))
    bar.append(panel(name, material, corners[0], 2 * half * side, height * up))
    bar.append(panel(name, material, corners[1] + d, -2 * half * side, height * up))
    # The bottom looks down, the others away from the bar.
    middle = o + d / 2 + height / 2 * up
    return [_outwards(part, middle) for part in bar]


def _outwards(part: Piece, middle: Doubles) -> Piece:
    """A plane part with its front turned away from ``middle``."""
    if float((part.positions.mean(axis=0) - middle) @ part.normals[0]) > 0:
        return part
    return replace(part, normals=-part.normals, triangles=part.triangles[:, ::-1])


def curtain(
    name: str,
    material: str,
    *,
    size: tuple[float, float],
    folds: float,
    depth: float,
    grid: tuple[int, int],
    thickness: float = 0.03,
) -> list[Piece]:
    """A hanging cloth, closed: two wavy faces and four thin edges.

    It hangs in the plane z = 0 between x = -width/2 and width/2, its lower edge at y = 0. The folds
    open towards the lower edge.
    """
    width, height = size
    u, v = np.meshgrid(np.linspace(0, 1, grid[0] + 1), np.linspace(0, 1, grid[1] + 1))
    wave = np.sin(2 * np.pi * folds * u + 0.8 * np.sin(3 * v)) * depth * (1 - 0.5 * v)
    # The lower edge hangs in a slight arc.
    y = v * height + (1 - v) * 0.06 * height * (2 * u - 1) ** 2
    front = np.stack([(u - 0.5) * width, y, wave + thickness / 2], axis=2)
    back = front - [0.0, 0.0, thickness]
    uvs = np.stack([u, v], axis=2)
    faces = [
        patch(name, material, front, uvs=uvs),
        patch(name, material, back[:, ::-1], uvs=uvs[:, ::-1]),
    ]
    # Edges run round the cloth counter-clockwise as the front sees it.
    ring = (
        (front[0], back[0], uvs[0]),
        (front[:, -1], back[:, -1], uvs[:, -1]),
        (front[-1, ::-1], back[-1, ::-1], uvs[-1, ::-1]),
        (front[::-1, 0], back[::-1, 0], uvs[::-1, 0]),
    )
    edges = [patch(name, material, np.stack([b, f]), uvs=np.stack([at, at])) for f, b, at in ring]
    return faces + edges
