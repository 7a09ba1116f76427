"""Surfaces that emit by images, or have normal maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibench.scene.glow import Glow, in_first_period
from gibench.scene.lightmap.albedo import covered_mean
from gibench.scene.model import Material, Scene
from gibench.scene.normal_maps import NormalMaps, unit_normals
from support.reference_scenes import DARK, quad, scene_of

SIGN_CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)


def glowing(scene: Scene, rng, share=0.5, images=((3, 5), (16, 9))) -> Scene:
    """The scene with some triangles that emit by random images, some of whose coordinates are a
    point or a line, and some of which repeat theirs many times.
    """
    count = len(scene.triangles)
    triangle = np.flatnonzero(rng.random(count) < share).astype(np.int32)
    uvs = rng.uniform(-2, 2, (len(triangle), 3, 2))
    uvs[::5] = uvs[::5, :1]
    uvs[1::5, 2] = (uvs[1::5, 0] + uvs[1::5, 1]) / 2
    uvs[2::5] *= 9
    glow = Glow(
        tuple((rng.random((*shape, 3)) ** 4 * 20).astype(np.float32) for shape in images),
        triangle,
        rng.integers(0, len(images), len(triangle)).astype(np.int32),
        in_first_period(uvs),
    )
    return with_means(replace(scene, glow=glow))


def bumpy(scene, rng, share=0.7, images=((3, 5), (16, 9)), steep=1.0):
    """The scene with random normal maps at random coordinates, tangents and signs."""
    triangle = np.flatnonzero(rng.random(len(scene.triangles)) < share).astype(np.int32)
    count = len(triangle)
    tangent = rng.normal(size=(count, 3, 3))
    tangent /= np.linalg.norm(tangent, axis=2, keepdims=True)
    sign = np.repeat(rng.choice([-1.0, 1.0], (count, 1, 1)), 3, axis=1)
    vectors = [rng.normal((0.0, 0.0, 1.0), 1.0, (*shape, 3)) for shape in images]
    maps = NormalMaps(
        tuple(unit_normals(v) for v in vectors),
        triangle,
        rng.integers(0, len(images), count).astype(np.int32),
        scale=(steep * rng.uniform(0.2, 1.5, count)).astype(np.float32),
        uvs=rng.uniform(-2, 2, (count, 3, 2)).astype(np.float32),
        tangents=np.concatenate((tangent, sign), axis=2).astype(np.float32),
    )
    return replace(scene, normal_maps=maps)


def with_means(scene: Scene) -> Scene:
    """The scene with a material of its mean for each of its triangles that emits by an image."""
    glow = scene.glow
    assert glow is not None
    materials, ids = list(scene.materials), scene.material_ids.copy()
    for row, triangle in enumerate(glow.triangle.tolist()):
        mean = covered_mean(glow.images[glow.image[row]], glow.uvs[row : row + 1].astype(float))[0]
        ids[triangle] = len(materials)
        own = scene.materials[scene.material_ids[triangle]]
        materials.append(replace(own, emission=tuple(mean.tolist())))
    return replace(scene, materials=tuple(materials), material_ids=ids)


def sign(pixels, corner, along, across, others=(), uvs=SIGN_CORNERS, materials=(DARK,)) -> Scene:
    """A black quad that emits by an image, its front on the side of along x across, and other
    triangles of material 0; the sign's triangles are the last two.
    """
    corners = np.array([*others, *quad(corner, along, across)])
    scene = scene_of(corners, [0] * len(others) + [len(materials)] * 2, [*materials, DARK])
    count = len(others)
    glow = Glow(
        (np.asarray(pixels, np.float32),),
        np.array([count, count + 1], np.int32),
        np.zeros(2, np.int32),
        np.asarray(uvs, np.float32)[np.array([(0, 1, 2), (0, 2, 3)])],
    )
    return with_means(replace(scene, glow=glow))


def checkers(count, fine, bright=(4.0, 2.0, 1.0), dark=(0.1, 0.2, 0.4)):
    """``count`` by ``count`` fields of ``fine`` texels a side; the lower left one is bright."""
    row, column = np.indices((count * fine, count * fine)) // fine
    is_bright = (count - 1 - row + column) % 2 == 0
    return np.where(is_bright[:, :, None], bright, dark).astype(np.float32), is_bright


PLAIN = Material("plain", (0.7, 0.6, 0.5))
