"""Backs of two-sided surfaces, and faces that lie in one another.

Two rules, applied at load:

- A surface reflects and emits on its front only; its back is black. A *two-sided* material
  (glTF's doubleSided) has a back of its own: the same triangles turned round. Backs that nothing
  can see, on the far side of a closed surface, are left out.
- Of two faces in one plane that look opposite ways and overlap, *a ray meets the one that fronts
  it*. Which of two equal distances is the smaller is a matter of rounding, so each such face is
  moved a little to its front.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gibench.arrays import Array, unique_rows
from gibench.scene.model import Camera, DirectionalLight, Light, Material
from gibench.scene.readers.clean import CleanMesh
from gibench.scene.readers.content import counted

# Shares of the largest coordinate, whose float32 neighbours are 2^-24 to 2^-23 of it away. Faces
# are in one plane when closer than a few of those; they are moved by sixteen times as much, which
# is above the error of a ray's hit and below the offset of rays from surfaces (2^-16).
SAME_PLANE = 2.0**-22
STEP = 2.0**-18
# Normals are in one plane when they are equal to so many steps of their components.
_NORMAL_STEPS = 4096.0
_PAIRS = 1 << 21  # tested at a time


def with_backs(
    mesh: CleanMesh,
    materials: Sequence[Material],
    lights: Sequence[Light],
    cameras: Sequence[Camera],
) -> CleanMesh:
    """The mesh with a back for each triangle of a two-sided material whose back can be seen."""
    two_sided = np.array([material.two_sided for material in materials])[mesh.material_ids]
    if not two_sided.any():
        return mesh
    mine = np.flatnonzero(two_sided)
    points = [light.position for light in lights if not isinstance(light, DirectionalLight)]
    points += [camera.position for camera in cameras]
    mine = mine[_can_be_seen(mesh, mine, np.array(points, np.float64).reshape(-1, 3))]
    if not len(mine):
        return mesh
    used, corner = np.unique(mesh.triangles[mine], return_inverse=True)
    backs = len(mesh.positions) + corner.reshape(-1, 3)[:, ::-1]
    notes = [f"{counted(len(mine), 'triangle')} of two-sided materials: backs added"]
    if mesh.lightmap_uvs is not None:
        notes.append("lightmap UVs ignored: the backs of two-sided surfaces have none")
    return replace(
        mesh,
        positions=np.concatenate((mesh.positions, mesh.positions[used])),
        normals=np.concatenate((mesh.normals, -mesh.normals[used])),
        uvs=np.concatenate((mesh.uvs, mesh.uvs[used])),
        triangles=np.concatenate((mesh.triangles, backs)).astype(np.int32),
        material_ids=np.concatenate((mesh.material_ids, mesh.material_ids[mine])),
        object_ids=np.concatenate((mesh.object_ids, mesh.object_ids[mine])),
        cutouts=_and(mesh.cutouts, mine),
        cutout_uvs=_and(mesh.cutout_uvs, used),
        glow=_and(mesh.glow, mine),
        glow_uvs=_and_turned(mesh.glow_uvs, mine),
        bump=_and(mesh.bump, mine),
        bump_uvs=_and_turned(mesh.bump_uvs, mine),
        # Out on the front is in on the back: the bent normal is turned round as a whole.
        bump_tangents=_and_turned(mesh.bump_tangents, mine, -1.0),
        gloss=_and(mesh.gloss, mine),
        gloss_uvs=_and_turned(mesh.gloss_uvs, mine),
        lightmap_uvs=None,
        warnings=(*mesh.warnings, *notes),
    )


def _and(values: Array | None, again: Array) -> Array | None:
    """The rows with those of ``again`` once more behind them."""
    return None if values is None else np.concatenate((values, values[again]))


def _and_turned(values: Array | None, again: Array, factor: float = 1.0) -> Array | None:
    """The rows of corners (t, 3, k) with those of ``again`` once more behind them, turned round and
    times ``factor``.
    """
    return None if values is None else np.concatenate((values, factor * values[again][:, ::-1]))


def _places(mesh: CleanMesh) -> Array:
    """(v,) a number for each position: vertices at one place have the same."""
    rows = (mesh.positions + np.float32(0)).view(np.int32)
    return unique_rows(rows)[1]


def _can_be_seen(mesh: CleanMesh, mine: Array, points: Array) -> Array:
    """Which of the triangles ``mine`` have a back that light or a camera may reach, (m,) bool.

    All but those of closed surfaces with nothing behind them: solids that contain, or rooms beyond
    which there is, no light, no camera and no corner of another triangle. What boxes cannot tell
    counts as seen.
    """
    corners = _places(mesh)[mesh.triangles[mine]]
    count = int(corners.max()) + 1
    rows = corners[:, [0, 1, 2]].reshape(-1)
    columns = corners[:, [1, 2, 0]].reshape(-1)
    links = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    component = connected_components(links, directed=False)[1][corners[:, 0]]
    # Closed: each edge once in each direction.
    there = rows.astype(np.int64) * count + columns
    back = columns.astype(np.int64) * count + rows
    keys, times = np.unique(there, return_counts=True)
    place = np.searchsorted(keys, back).clip(max=len(keys) - 1)
    paired = (keys[place] == back) & (times[np.searchsorted(keys, there)] == 1)
    paired &= times[place] == 1
    is_open = np.zeros(int(component.max()) + 1, bool)
    np.logical_or.at(is_open, component, ~paired.reshape(-1, 3).all(axis=1))
    if mesh.cutouts is not None:
        np.logical_or.at(is_open, component, mesh.cutouts[mine] >= 0)
    seen = is_open[component]
    positions = mesh.positions.astype(np.float64)
    corners_of_all = positions[mesh.triangles]
    for number in np.unique(component[~seen]).tolist():
        inside = component == number
        own = corners_of_all[mine[inside]]
        others = np.ones(len(mesh.triangles), bool)
        others[mine[inside]] = False
        witnesses = np.concatenate((corners_of_all[others].reshape(-1, 3), points))
        low, high = own.min(axis=(0, 1)), own.max(axis=(0, 1))
        margin = 1e-4 * (high - low)
        volume = np.einsum("tx,tx->", own[:, 0] - low, np.cross(own[:, 1] - low, own[:, 2] - low))
        if volume > 0:  # fronts outside: who is within?
            found = ((witnesses > low + margin) & (witnesses < high - margin)).all(axis=1)
        else:
            found = ((witnesses < low - margin) | (witnesses > high + margin)).any(axis=1)
        seen[inside] = found.any()
    return np.asarray(seen)


def apart(mesh: CleanMesh, backs: int = 0) -> CleanMesh:
    """The mesh with faces in one plane that look opposite ways moved off each other, each to its
    front.

    Args:
        mesh: the mesh.
        backs: how many of its triangles ``with_backs`` has added, of which nothing more is said.
    """
    corners = mesh.positions[mesh.triangles].astype(np.float64)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    scale = float(np.abs(corners).max())
    moved = _coincident(mesh, corners, flat, scale)
    if not moved.any():
        return mesh
    triangles = mesh.triangles.copy()
    used, corner = np.unique(triangles[moved], return_inverse=True)
    corner = corner.reshape(-1, 3)
    direction = np.zeros((len(used), 3))
    for i in range(3):
        np.add.at(direction, corner[:, i], flat[moved])
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-6)
    away = mesh.positions[used].astype(np.float64) + STEP * scale * direction
    triangles[moved] = len(mesh.positions) + corner
    return _compacted(
        replace(
            mesh,
            positions=np.concatenate((mesh.positions, away.astype(np.float32))),
            normals=np.concatenate((mesh.normals, mesh.normals[used])),
            uvs=np.concatenate((mesh.uvs, mesh.uvs[used])),
            triangles=triangles,
            lightmap_uvs=_and(mesh.lightmap_uvs, used),
            cutout_uvs=_and(mesh.cutout_uvs, used),
            warnings=(*mesh.warnings, *_told(int(moved.sum()) - 2 * backs)),
        )
    )


def _told(moved: int) -> list[str]:
    if moved <= 0:
        return []
    told = counted(moved, "triangle")
    return [f"{told} in one plane with others that look the opposite way: moved off them"]


def _compacted(mesh: CleanMesh) -> CleanMesh:
    """The mesh without vertices that no triangle uses."""
    used, triangles = np.unique(mesh.triangles, return_inverse=True)
    lightmap_uvs, cutout_uvs = mesh.lightmap_uvs, mesh.cutout_uvs
    return replace(
        mesh,
        positions=mesh.positions[used],
        normals=mesh.normals[used],
        uvs=mesh.uvs[used],
        triangles=triangles.reshape(-1, 3).astype(np.int32),
        lightmap_uvs=None if lightmap_uvs is None else lightmap_uvs[used],
        cutout_uvs=None if cutout_uvs is None else cutout_uvs[used],
    )


def _coincident(mesh: CleanMesh, corners: Array, flat: Array, scale: float) -> Array:
    """Which triangles lie in one plane with one that looks the opposite way and overlaps, (t,)."""
    main = np.abs(flat).argmax(axis=1)
    front = flat[np.arange(len(flat)), main] > 0
    normal = np.where(front[:, None], flat, -flat)
    distance = np.einsum("tx,tx->t", normal, corners.mean(axis=1))
    # Shifted by a third, so that normals along axes are not at the border between two steps.
    steps = np.floor(normal * _NORMAL_STEPS + 1 / 3).astype(np.int64)
    steps += int(_NORMAL_STEPS) + 1  # from 0, so that three of them are one number
    base = 2 * int(_NORMAL_STEPS) + 3
    direction = (steps[:, 2] * base + steps[:, 1]) * base + steps[:, 0]
    order = np.lexsort((distance, direction))
    jump = np.diff(direction[order]) != 0
    jump |= np.diff(distance[order]) > SAME_PLANE * scale
    plane = np.concatenate(([0], np.cumsum(jump)))
    moved = _twins(mesh)
    fronts = np.bincount(plane, weights=front[order])
    sizes = np.bincount(plane)
    unknown = np.bincount(plane, weights=~moved[order])
    starts = np.concatenate(([0], np.cumsum(sizes)))
    for number in np.flatnonzero((fronts > 0) & (fronts < sizes) & (unknown > 0)).tolist():
        mine = order[starts[number] : starts[number + 1]]
        axes = np.delete(np.arange(3), main[mine[0]])
        outlines = corners[mine][:, :, axes]
        overlapping = _overlapping(outlines, front[mine], SAME_PLANE * scale)
        moved[mine] |= overlapping
    return moved


def _twins(mesh: CleanMesh) -> Array:
    """Which triangles have one with the same three corners, turned round, (t,) bool."""
    corners = _places(mesh)[mesh.triangles]
    first = corners.argmin(axis=1)
    turned = np.stack([np.roll(np.arange(3), -k) for k in range(3)])[first]
    key = np.take_along_axis(corners, turned, axis=1)
    ways = np.concatenate((key, key[:, [0, 2, 1]]))
    first, group = unique_rows(ways)
    own, other = group[: len(key)], group[len(key) :]
    turned_round = np.zeros(len(first), np.bool_)
    turned_round[other] = True
    return np.asarray(turned_round[own])


def _overlapping(outlines: Array, front: Array, margin: float) -> Array:
    """Which of the triangles (m, 3, 2) of a plane overlap one of the other side, (m,) bool."""
    result = np.zeros(len(outlines), bool)
    a, b = np.flatnonzero(front), np.flatnonzero(~front)
    low, high = outlines.min(axis=1), outlines.max(axis=1)
    # Both from left to right, so that those which some can meet are a stretch of the others.
    a, b = (mine[np.argsort(low[mine, 0])] for mine in (a, b))
    left = low[b, 0]
    widest = float((high[b, 0] - left).max(initial=0.0))
    start = 0
    while start < len(a):
        first = int(np.searchsorted(left, low[a[start], 0] - widest))
        rows = _rows_from(a, start, low, high, left, first)
        some = a[start : start + rows]
        near = b[first : int(np.searchsorted(left, high[some, 0].max()))]
        start += rows
        meet = np.ones((len(some), len(near)), bool)
        for axis in (0, 1):
            meet &= low[some, axis][:, None] < high[near, axis] - margin
            meet &= low[near, axis] < high[some, axis][:, None] - margin
        i, j = np.nonzero(meet)
        i, j = some[i], near[j]
        hit = _overlap(outlines[i], outlines[j], margin)
        result[i[hit]] = result[j[hit]] = True
    return result


def _rows_from(a: Array, start: int, low: Array, high: Array, left: Array, first: int) -> int:
    """How many of ``a`` from ``start`` on are tested at once: at least one, at most ``_PAIRS``
    pairs.
    """
    rows = len(a) - start
    while rows > 1:
        reach = high[a[start : start + rows], 0].max()
        if rows * (int(np.searchsorted(left, reach)) - first) <= _PAIRS:
            break
        rows = (rows + 1) // 2
    return rows


def _overlap(a: Array, b: Array, margin: float) -> Array:
    """Whether triangles a and b (k, 3, 2) overlap by more than ``margin``: no edge of either
    separates them (the separating axis theorem).
    """
    apart_ = np.zeros(len(a), bool)
    for one in (a, b):
        for i in range(3):
            edge = one[:, (i + 1) % 3] - one[:, i]
            axis = np.stack((-edge[:, 1], edge[:, 0]), axis=1)
            axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-30)
            x, y = (np.einsum("kcx,kx->kc", t, axis) for t in (a, b))
            apart_ |= x.max(axis=1) - margin <= y.min(axis=1)
            apart_ |= y.max(axis=1) - margin <= x.min(axis=1)
    return ~apart_
