"""Scenes with objects that move, and where float64 puts them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.rays.bvh import Bvh
from gibench.scene.model import Camera, Material, PointLight
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import IDENTITY, Keyframes
from support.gibs_scenes import box_parts, furnished, scene_of
from support.rays_oracle import soup

LEFT, RIGHT = "left box", "right box"
NAMES = ("room", LEFT, RIGHT)


def furnished_room():
    """The furnished room, its objects named."""
    return replace(furnished(), object_names=NAMES)


def matrix3(matrix):
    a, b, c = (tuple(row) for row in np.asarray(matrix, float).tolist())
    return a, b, c


def jump(name, shift, frame):
    """At rest until ``frame``, and from it on moved by ``shift``."""
    return Keyframes(
        name, (frame - 1, frame), ((0.0, 0.0, 0.0), tuple(map(float, shift))), (IDENTITY,) * 2
    )


def soup_part(count, rng, **size):
    """Triangles of their own vertices with random unit normals, as a part of a scene."""
    corners = soup(count, rng, **size)
    normals = rng.normal(size=(3 * count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return corners.reshape(-1, 3), normals, np.arange(3 * count).reshape(-1, 3)


def crowd(rng, triangles=(400, 1, 97, 300), names=("still", "one", "some", "still too")):
    """Soups that lie among each other, objects of their own, and a box with shared corners."""
    parts = [(soup_part(n, rng, extent=6.0), 0) for n in triangles]
    parts.append((box_parts((2, 2, 2), (4, 3.5, 5), inwards=False), 0))
    # Objects' numbers need not be dense.
    scene = scene_of(parts, (Material("grey"),), cameras=(Camera((0, 0, -9), (3, 3, 3)),))
    ids = 3 * scene.object_ids + 2
    dense = [*names, "box"]
    spread = [""] * (3 * len(dense) + 2)
    for number, name in enumerate(dense):
        spread[3 * number + 2] = name
    return replace(scene, object_ids=ids.astype(np.int32), object_names=tuple(spread))


def moved_in(scene, motion: MovingObjects, frame):
    """Positions and normals (v, 3) of all vertices in ``frame``, in float64."""
    positions = scene.positions.astype(np.float64)
    normals = scene.normals.astype(np.float64)
    vertices, objects = motion.vertices(scene)
    m = motion.transforms_in(frame)[objects]
    positions[vertices] = np.einsum("nij,nj->ni", m[:, :, :3], positions[vertices]) + m[:, :, 3]
    normals[vertices] = np.einsum("nij,nj->ni", m[:, :, :3], normals[vertices])
    return positions, normals


def scene_in(scene, motion, frame):
    """The scene as it lies in ``frame``, at rest there."""
    positions, normals = moved_in(scene, motion, frame)
    return replace(
        scene, positions=positions.astype(np.float32), normals=normals.astype(np.float32)
    )


def begin(frame_scene, frame, size):
    """The passes that move a :class:`FrameScene`'s objects to where they are in ``frame``."""
    frame_scene.begin_frame(frame)
    for item in frame_scene.passes():
        for launch in item.launches():
            frame_scene.device.enqueue(launch, size)


def read_tree(frame_scene) -> Bvh:
    """The tree as it lies on the device now."""
    nodes, blocks = (frame_scene.device.read(a.value) for a in frame_scene.bvh_args)
    return replace(frame_scene.bvh, nodes=nodes, blocks=blocks)


def read_corners(frame_scene):
    """The triangles (t, 3, 3) as they lie on the device now."""
    return frame_scene.device.read(frame_scene.surfaces.positions)[frame_scene.scene.triangles]


def shaded_room():
    """A room with a lamp under its ceiling, and a black plate in a corner that can be put under the
    lamp: most of the room is then in the shadow.
    """
    materials = (Material("wall", (0.7, 0.7, 0.7)), Material("plate", (0.02, 0.02, 0.02)))
    parts = [
        (box_parts((-1, 0, -1), (1, 2, 1), inwards=True), 0),
        (box_parts((-0.99, 0.02, -0.99), (-0.39, 0.06, -0.39), inwards=False), 1),
    ]
    camera = Camera((0.9, 1.3, 0.9), (-0.2, 0.5, -0.2), fov_degrees=70)
    lamp = PointLight((0.0, 1.7, 0.0), (2.0, 2.0, 2.0))
    return scene_of(parts, materials, lights=(lamp,), cameras=(camera,),
                    object_names=("room", "plate"))  # fmt: skip


UNDER_THE_LAMP = (0.69, 1.5, 0.69)
"""Where the plate goes from its corner, m."""
