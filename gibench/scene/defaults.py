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
SKY = Environment.gradient(
    zenith=(0.35, 0.5, 0.8), horizon=(0.6, 0.65, 0.7), ground=(0.1, 0.1, 0.1)
)

# (triangles at most, receivers, probes): the first row is near the published Cornell Box (40 564
# receivers, 27 probes), the second near the published Modern Hall (103 605, 108); then Sponza's.
_SIZES = ((2_000, 40_000, 27), (100_000, 100_000, 100))
# Silvennoinen and Lehtinen 2017, "Real-time Global Illumination by Precomputed Local Reconstruction
# from Sparse Radiance Probes": Sponza with 246 325 receivers and 150 probes.
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
    """A view of the scene: along the longest horizontal axis from inside, or from outside.

    In an interior the camera stands at the more open of the two ends, and before the opening where
    a whole side of the room is missing, as in a Cornell Box.
    """
    low, high = scene.bounds
    centre, size = (low + high) / 2, high - low
    if winding_number(scene, centre) < INTERIOR_WINDING:
        fov = 60.0
        axis = 0 if size[0] >= size[2] else 2
        walls = _wall_shares(scene, axis)
        near, far = (low, high) if walls[0] <= walls[1] else (high, low)
        towards = np.sign(far[axis] - near[axis])
        open_front = min(walls) < 0.05
        position, target = centre.copy(), centre.copy()
        position[1] = target[1] = low[1] + (0.5 if open_front else 0.35) * size[1]
        inset = -size[1] / 2 / math.tan(math.radians(fov / 2)) if open_front else 0.2 * size[axis]
        position[axis] = near[axis] + towards * inset
        target[axis] = far[axis]
        return Camera(vec3(position), vec3(target), fov)
    fov = 40.0
    # The bounding sphere just fits into the view.
    distance = 1.05 * float(np.linalg.norm(size)) / 2 / math.sin(math.radians(fov / 2))
    direction = np.asarray(unit(np.array([0.6, 0.45, 1.0])))
    return Camera(vec3(centre + distance * direction), vec3(centre), fov)


# Below this winding number the middle of the scene counts as the inside of a room: half of a
# closed room's -1 would be the middle of a floor without walls.
INTERIOR_WINDING = -0.5


def winding_number(scene: Scene, point: Array) -> float:
    """Generalised winding number at ``point`` (Jacobson, Kavan and Sorkine-Hornung 2013, eq. 5).

    The share of the sphere of directions that the triangles cover, fronts negative, backs
    positive: -1 inside a closed room, 1 inside a closed object, 0 outside both.
    """
    a, b, c = np.moveaxis(scene.corners.astype(np.float64) - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    bottom = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    return float(2 * np.arctan2(top, bottom).sum() / (4 * np.pi))


def _wall_shares(scene: Scene, axis: int) -> tuple[float, float]:
    """How much of the low and the high end of the bounding box on ``axis`` has a wall facing in."""
    low, high = scene.bounds
    size = high - low
    corners = scene.corners.astype(np.float64)
    centroid = corners.mean(axis=1)[:, axis]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.cross(ab, ac)[:, axis] / 2
    side = float(np.prod(np.delete(size, axis))) or 1.0
    near_low = (centroid < low[axis] + 0.1 * size[axis]) & (area > 0)
    near_high = (centroid > high[axis] - 0.1 * size[axis]) & (area < 0)
    return float(area[near_low].sum()) / side, float(-area[near_high].sum()) / side
