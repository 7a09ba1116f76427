"""What a scene gets that its file does not give: lights, sky, camera, numbers of receivers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gibench.scene.clean import CleanMesh
from gibench.scene.model import Camera, DirectionalLight, Environment, Material, Scene
from gibench.scene.parts import Array, Content, unit, vec3

# A high sun that swings, so that every frame differs, five times as strong on a horizontal surface
# as the sky: roughly a clear day. Units are as good as any other, since the image is tone-mapped.
SUN = DirectionalLight(
    direction=unit(np.array([0.35, -1.0, 0.2])), irradiance=(8.0, 7.6, 6.8), swing_degrees=40.0
)
SKY = Environment.gradient(zenith=(0.35, 0.5, 0.8), horizon=(0.6, 0.65, 0.7), ground=(0.1, 0.1, 0.1))

# Receivers and probes for a scene of at most so many triangles. The last row is the paper's for
# Sponza (Silvennoinen and Timonen... "Real-time Global Illumination by Precomputed Local
# Reconstruction from Sparse Radiance Probes", 2017, table 1), the first near its Cornell Box.
_SIZES = ((2_000, 40_000, 27), (100_000, 100_000, 100))
_LARGEST = (246_000, 150)


def suggested_sizes(triangles: int) -> tuple[int, int]:
    """Numbers of receivers and of probes for a scene of so many triangles."""
    for limit, receivers, probes in _SIZES:
        if triangles <= limit:
            return receivers, probes
    return _LARGEST


def glows(mesh_materials: tuple[Material, ...], used: Array) -> bool:
    """Whether any of the ``used`` materials emits."""
    return any(any(mesh_materials[i].emission) for i in np.unique(used))


def scene_of(name: str, mesh: CleanMesh, content: Content) -> Scene:
    """A scene with the file's lights and cameras, and defaults for what the file lacks.

    Without any light or emissive surface: a swinging sun and a sky. Without a camera: one inside
    an interior, or outside a closed object.
    """
    receivers, probes = suggested_sizes(len(mesh.triangles))
    scene = Scene(
        name=name,
        positions=mesh.positions,
        normals=mesh.normals,
        uvs=mesh.uvs,
        triangles=mesh.triangles,
        material_ids=mesh.material_ids,
        object_ids=mesh.object_ids,
        materials=content.materials,
        textures=content.textures,
        lights=content.lights,
        cameras=content.cameras,
        lightmap_uvs=mesh.lightmap_uvs,
        receivers=receivers,
        warnings=(*content.warnings, *mesh.warnings),
    )
    scene = replace(scene, probes=replace(scene.probes, count=probes))
    if not scene.lights and not glows(scene.materials, scene.material_ids):
        scene = replace(scene, lights=(SUN,), environment=SKY)
    if not scene.cameras:
        scene = replace(scene, cameras=(suggested_camera(scene),))
    return scene


def suggested_camera(scene: Scene) -> Camera:
    """A view of the scene: along the longest horizontal axis from inside, or from outside."""
    low, high = scene.bounds
    centre, size = (low + high) / 2, high - low
    if is_interior(scene):
        axis = 0 if size[0] >= size[2] else 2
        position, target = centre.copy(), centre.copy()
        position[1] = target[1] = low[1] + 0.35 * size[1]
        position[axis] = low[axis] + 0.2 * size[axis]
        target[axis] = high[axis]
        return Camera(vec3(position), vec3(target), 60.0)
    fov = 40.0
    # The bounding sphere just fits into the view.
    distance = 1.05 * float(np.linalg.norm(size)) / 2 / math.sin(math.radians(fov / 2))
    direction = np.asarray(unit(np.array([0.6, 0.45, 1.0])))
    return Camera(vec3(centre + distance * direction), vec3(centre), fov)


def is_interior(scene: Scene) -> bool:
    """Whether the surfaces nearest to the sides of the bounding box rather face inwards.

    Walls of a room show their fronts to the inside, the hull of an object to the outside.
    """
    low, high = scene.bounds
    margin = 0.1 * (high - low)
    corners = scene.corners.astype(np.float64)
    centroid = corners.mean(axis=1)
    area_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    score = 0.0
    for axis in range(3):
        near_low = centroid[:, axis] < low[axis] + margin[axis]
        near_high = centroid[:, axis] > high[axis] - margin[axis]
        score += area_normal[near_low, axis].sum() - area_normal[near_high, axis].sum()
    return bool(score > 0)
