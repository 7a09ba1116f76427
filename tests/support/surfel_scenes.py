"""Small scenes and bakes for surfel caches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.model import Camera, Scene
from gibench.techniques.surfel_cache.bake.hierarchy import hierarchy_of
from gibench.techniques.surfel_cache.bake.links import Linker
from gibench.techniques.surfel_cache.bake.surfels import sample_surface, surface_areas
from support.tiny_scenes import quad_scene


def looking(scene: Scene) -> Scene:
    """With a camera in the middle of the room."""
    return replace(scene, cameras=(Camera((0.0, 1.2, 0.9), (0.0, 1.2, 0.0), 70.0),))


def triangle_areas(scene: Scene) -> np.ndarray:
    """(t,) m2, in float64."""
    c = scene.corners.astype(np.float64)
    return np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1) / 2


def linker_of(scene: Scene, lightmap, surfels: int, kind: str = "clustering") -> Linker:
    """A linker over surfels of ``scene`` that were not relaxed."""
    areas = surface_areas(scene, lightmap)
    found = sample_surface(scene, areas, surfels)
    tree = hierarchy_of(found, kind)
    ordered = found.taken(tree.leaf)
    return Linker(ordered, tree, scene_tracer(scene), scene.corners, surface_offset(scene))


def ceiling(width: float, depth: float, height: float):
    """A rectangle at ``height`` whose front faces down, its corner over the origin."""
    return quad_scene([((0, height, 0), (width, 0, 0), (0, 0, depth))], 4)


def polygon(scene: Scene, radius: float, height: float, sides: int) -> Scene:
    """``scene`` with its triangles replaced by a regular polygon's that faces down."""
    angle = 2 * np.pi * np.arange(sides) / sides
    rim = np.stack([radius * np.cos(angle), np.full(sides, height), radius * np.sin(angle)], axis=1)
    positions = np.concatenate([[[0, height, 0]], rim]).astype(np.float32)
    i = np.arange(sides)
    triangles = np.stack([np.zeros(sides, int), 1 + i, 1 + (i + 1) % sides], axis=1)
    return replace(
        scene,
        positions=positions,
        normals=np.tile(np.float32([0, -1, 0]), (sides + 1, 1)),
        uvs=np.zeros((sides + 1, 2), np.float32),
        triangles=triangles.astype(np.int32),
        material_ids=np.zeros(sides, np.int32),
        object_ids=np.zeros(sides, np.int32),
    )
