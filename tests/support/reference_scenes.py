"""Small scenes whose light is known in closed form, and receivers on their triangles."""

from dataclasses import replace

import numpy as np

from gibench.scene.environment import Environment
from gibench.scene.lightmap import Fragments, Lightmap, Receivers
from gibench.scene.model import (
    BLACK,
    DirectionalLight,
    Material,
    PointLight,
    Scene,
    SpotLight,
    Texture,
)

DARK = Material("dark", (0.0, 0.0, 0.0))


def scene_of(
    corners, material_ids, materials, *, lights=(), environment=None, uvs=None, textures=()
):
    """A flat-shaded scene of triangles (t, 3, 3)."""
    corners = np.asarray(corners, np.float32)
    count = len(corners)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Scene(
        "test",
        corners.reshape(-1, 3),
        np.repeat(normal, 3, axis=0).astype(np.float32),
        np.zeros((3 * count, 2), np.float32) if uvs is None else np.asarray(uvs, np.float32),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.broadcast_to(np.asarray(material_ids, np.int32), (count,)).copy(),
        np.zeros(count, np.int32),
        tuple(materials),
        lights=tuple(lights),
        textures=tuple(textures),
        environment=environment or Environment.constant(BLACK),
    )


def quad(corner, along, across):
    """Two triangles; the front is on the side of along x across."""
    a, e, f = (np.asarray(v, float) for v in (corner, along, across))
    return [[a, a + e, a + e + f], [a, a + e + f, a + f]]


def box(size=(1.0, 1.0, 1.0), *, inside=True):
    """The twelve triangles of a box from the origin, fronts on the inside."""
    x, y, z = (np.diag(size)[i] for i in range(3))
    o = np.zeros(3)
    faces = [(o, x, y), (z, y, x), (o, z, x), (y, x, z), (o, y, z), (x, z, y)]
    triangles = np.array([t for face in faces for t in quad(*face)])
    return triangles if inside else triangles[:, ::-1]


def sphere(subdivisions=2):
    """A unit sphere of triangles, fronts outwards (an octahedron cut in four again and again)."""
    tips = np.vstack((np.eye(3), -np.eye(3)))
    faces = []
    for sx in (0, 3):
        for sy in (1, 4):
            for sz in (2, 5):
                face = tips[[sx, sy, sz]]
                faces.append(face if np.linalg.det(face) > 0 else face[::-1])
    faces = np.array(faces)
    for _ in range(subdivisions):
        a, b, c = faces[:, 0], faces[:, 1], faces[:, 2]
        ab, bc, ca = a + b, b + c, c + a
        cut = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(t, axis=1) for t in cut])
        faces /= np.linalg.norm(faces, axis=2, keepdims=True)
    return faces


def disc(radius, height, segments=720):
    """A disc at y = height that faces down, of the same area as the circle."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    reach = radius * np.sqrt(2 * np.pi / segments / np.sin(2 * np.pi / segments))
    rim = np.stack((reach * np.cos(angle), 0 * angle, reach * np.sin(angle)), axis=1)
    centre = np.zeros((segments, 3))
    return np.stack((centre, rim[:-1], rim[1:]), axis=1) + np.array((0.0, height, 0.0))


def patch(point, normal, size=1e-3):
    """A tiny triangle around a point."""
    n = np.asarray(normal, float)
    n = n / np.linalg.norm(n)
    t = np.cross(n, [1.0, 0, 0] if abs(n[0]) < 0.5 else [0, 1.0, 0])
    t /= np.linalg.norm(t)
    b = np.cross(n, t)
    turns = 2 * np.pi * np.arange(3) / 3
    return np.array([point + size * (np.cos(a) * t + np.sin(a) * b) for a in turns])


def lightmap_of(scene, groups):
    """One receiver per group of triangles, each a whole triangle as a fragment."""
    groups = [np.atleast_1d(np.asarray(g, np.int32)) for g in groups]
    triangle = np.concatenate(groups)
    corners = scene.corners[triangle]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    start = np.concatenate(([0], np.cumsum([len(g) for g in groups]))).astype(np.int64)
    of_group = np.add.reduceat(area, start[:-1])
    centroid = np.add.reduceat(corners.mean(axis=1) * area[:, None], start[:-1])
    normal = np.add.reduceat(cross, start[:-1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    count = len(groups)
    receivers = Receivers(
        np.arange(count, dtype=np.int32),
        (centroid / of_group[:, None]).astype(np.float32),
        normal.astype(np.float32),
        np.full((count, 3), 0.5, np.float32),
        np.zeros((count, 3), np.float32),
        of_group.astype(np.float32),
    )
    fragments = Fragments(start, corners, triangle, area.astype(np.float32))
    uvs = np.full((len(scene.triangles), 3, 2), np.nan, np.float32)
    return Lightmap(count, 1, uvs, receivers, fragments, count)


def plain_texture(rgb, shape=(2, 3)):
    return Texture("plain", np.broadcast_to(np.asarray(rgb, np.float32), (*shape, 3)).copy())


def unit(v):
    """A vector at length 1."""
    return v / np.linalg.norm(v)


def random_scene(rng):
    """Two emissive panels in a textured room with tilted normals, every light, a sky."""
    panels = [
        *quad((0.2, 0.9, 0.2), (0.3, 0, 0), (0, 0, 0.3)),
        *quad((0.9, 0.2, 0.2), (0, 0, 0.5), (0, 0.2, 0)),
    ]
    corners = np.array([*box(), *panels])
    ids = [0] * 6 + [1] * 6 + [2, 2, 3, 3]
    materials = (
        Material("wall", (0.5, 0.6, 0.7), texture=1),
        Material("plain", (0.9, 0.8, 0.2)),
        Material("warm", (0.1, 0.1, 0.1), (4.0, 3.0, 1.0)),
        Material("cold", (0.0, 0.0, 0.0), (0.5, 0.5, 2.0), texture=0),
    )
    aim = unit(rng.normal(size=3))
    lights = (
        DirectionalLight(tuple(unit(rng.normal(size=3))), (3.0, 2.0, 1.0)),
        PointLight((0.4, 0.7, 0.6), (0.5, 1.0, 0.7)),
        SpotLight((0.6, 0.6, 0.3), tuple(aim), (2.0, 1.0, 5.0), 0.4, 1.2),
    )
    scene = scene_of(
        corners,
        ids,
        materials,
        lights=lights,
        uvs=rng.normal(size=(len(corners) * 3, 2)) * 2,
        textures=[Texture(str(n), rng.random((n, n + 1, 3)).astype(np.float32)) for n in (3, 5)],
        environment=Environment(rng.random((6, 9, 3)).astype(np.float32)),
    )
    tilted = scene.normals + 0.3 * rng.normal(size=scene.normals.shape)
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    return replace(scene, normals=tilted.astype(np.float32))
