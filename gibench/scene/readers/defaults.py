"""What a scene gets that its file does not give: lights, sky, camera, numbers of receivers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.arrays import Array, Ints
from gibench.scene.cutouts import Cutouts
from gibench.scene.environment import Environment
from gibench.scene.gloss import GlossMaps
from gibench.scene.glow import Glow, in_first_period
from gibench.scene.model import MOST_UNFOLDED, DirectionalLight, Material, Scene
from gibench.scene.normal_maps import NormalMaps
from gibench.scene.readers.clean import CleanMesh
from gibench.scene.readers.content import Content, unit
from gibench.scene.readers.viewpoint import suggested_camera

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
_LARGEST = (246_325, 150)

# From so many triangles on a scene says what it needs. As measured on displaced grids
# (tests/support/large_scenes.py): a million's memory at its peak and minutes of one core, and the
# bytes of tree a triangle.
LARGE = 2_500_000
GIB_PER_MILLION = 1.6
MINUTES_PER_MILLION = 0.5
TREE_BYTES = 70


def suggested_sizes(triangles: int) -> tuple[int, int]:
    """Numbers of receivers and of probes for a scene of so many triangles."""
    for limit, receivers, probes in _SIZES:
        if triangles <= limit:
            return receivers, probes
    return _LARGEST


def size_remarks(mesh: CleanMesh) -> list[str]:
    """What a scene of very many triangles means for a run."""
    count = len(mesh.triangles)
    said = []
    if count > MOST_UNFOLDED and mesh.lightmap_uvs is None:
        said.append(
            f"{count:,} triangles: unwrapped by projection along axes, as xatlas takes minutes for "
            f"more than {MOST_UNFOLDED:,}"
        )
    if count > LARGE:
        millions = count / 1e6
        said.append(
            f"{count:,} triangles: a run needs about {GIB_PER_MILLION * millions:.0f} GiB of host "
            f"memory, {MINUTES_PER_MILLION * millions:.0f} minutes to unwrap and to build the ray "
            f"tracing tree, and {TREE_BYTES * count / 2**20:,.0f} MiB of tree on the device"
        )
    return said


def glows(mesh_materials: tuple[Material, ...], used: Array) -> bool:
    """Whether any of the ``used`` materials emits."""
    return any(any(mesh_materials[i].emission) for i in np.unique(used))


def _with_images(numbers: Array) -> tuple[Ints, Array, Ints]:
    """Triangles that have an image, of ``numbers`` (t,) with -1 for none; which images those are;
    and of each triangle its place among them.
    """
    triangle = np.flatnonzero(numbers >= 0).astype(np.int32)
    used, image = np.unique(numbers[triangle], return_inverse=True)
    return triangle, used, image.reshape(-1).astype(np.int32)


def _cutouts_of(mesh: CleanMesh, content: Content) -> Cutouts | None:
    if mesh.cutouts is None or mesh.cutout_uvs is None:
        return None
    triangle, used, image = _with_images(mesh.cutouts)
    return Cutouts(
        images=tuple(content.cutouts[number] for number in used),
        triangle=triangle,
        image=image,
        uvs=np.ascontiguousarray(mesh.cutout_uvs[mesh.triangles[triangle]], np.float32),
    )


def _glow_of(mesh: CleanMesh, content: Content) -> Glow | None:
    if mesh.glow is None or mesh.glow_uvs is None:
        return None
    triangle, used, image = _with_images(mesh.glow)
    return Glow(
        images=tuple(content.glows[number] for number in used),
        triangle=triangle,
        image=image,
        uvs=in_first_period(mesh.glow_uvs[triangle]),
    )


def _normal_maps_of(mesh: CleanMesh, content: Content) -> NormalMaps | None:
    if mesh.bump is None or mesh.bump_uvs is None or mesh.bump_tangents is None:
        return None
    triangle, used, image = _with_images(mesh.bump)
    return NormalMaps(
        images=tuple(content.normal_maps[number][0] for number in used),
        triangle=triangle,
        image=image,
        scale=np.array([content.normal_maps[n][1] for n in used], np.float32)[image],
        uvs=in_first_period(mesh.bump_uvs[triangle]),
        tangents=mesh.bump_tangents[triangle].astype(np.float32),
    )


def _gloss_maps_of(mesh: CleanMesh, content: Content) -> GlossMaps | None:
    if mesh.gloss is None or mesh.gloss_uvs is None:
        return None
    triangle, used, image = _with_images(mesh.gloss)
    return GlossMaps(
        images=tuple(content.gloss_maps[number] for number in used),
        triangle=triangle,
        image=image,
        uvs=in_first_period(mesh.gloss_uvs[triangle]),
    )


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
        object_names=content.object_names,
        receivers=receivers,
        warnings=(*content.warnings, *mesh.warnings, *size_remarks(mesh)),
        cutouts=_cutouts_of(mesh, content),
        glow=_glow_of(mesh, content),
        normal_maps=_normal_maps_of(mesh, content),
        gloss_maps=_gloss_maps_of(mesh, content),
    )
    scene = replace(scene, probes=replace(scene.probes, count=probes, automatic=True))
    if not scene.lights and not glows(scene.materials, scene.material_ids):
        said = (*scene.warnings, "no light and nothing that glows: a swinging sun and a sky added")
        scene = replace(scene, lights=(SUN,), environment=SKY, warnings=said)
    if not scene.cameras:
        scene = replace(scene, cameras=(suggested_camera(scene),))
    return scene
