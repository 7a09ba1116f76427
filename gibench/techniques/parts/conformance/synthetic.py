"""Random scenes and lightmaps, of every kind of material and light."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gibench.arrays import Floats, Vec3
from gibench.scene.environment import Environment
from gibench.scene.lightmap import Fragments, Lightmap, Receivers
from gibench.scene.model import (
    Camera,
    DirectionalLight,
    Material,
    PointLight,
    Scene,
    SpotLight,
    Texture,
)
from gibench.scene.poses import Keyframes


def random_unit(rng: np.random.Generator, count: int) -> Floats:
    """Directions (count, 3), evenly over the sphere."""
    v = rng.normal(size=(count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True), np.float32)


def random_scene(rng: np.random.Generator, triangles: int = 60) -> Scene:
    """A soup of triangles with textures, emission, all kinds of lights and an environment."""
    centre = rng.uniform(-1, 1, (triangles, 1, 3))
    corners = (centre + rng.uniform(-0.4, 0.4, (triangles, 3, 3))).astype(np.float32)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    normals = np.repeat(faces, 3, axis=0) + 0.2 * rng.normal(size=(3 * triangles, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Scene(
        name="soup",
        positions=corners.reshape(-1, 3),
        normals=normals.astype(np.float32),
        uvs=rng.uniform(-2, 3, (3 * triangles, 2)).astype(np.float32),
        triangles=np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3),
        material_ids=rng.integers(0, 3, triangles).astype(np.int32),
        object_ids=np.zeros(triangles, np.int32),
        materials=(
            Material("plain", (0.7, 0.5, 0.3)),
            Material("glowing", (0.4, 0.4, 0.4), (1.0, 2.0, 0.5)),
            Material("textured", (0.9, 0.8, 1.0), texture=0),
        ),
        textures=(Texture("noise", rng.uniform(0, 1, (5, 7, 3)).astype(np.float32)),),
        lights=(
            DirectionalLight((0.0, -0.6, 0.8), (3.0, 2.0, 1.0), swing_degrees=30),
            PointLight((0.3, 1.4, -0.2), (2.0, 3.0, 4.0), orbit_radius=0.5),
            SpotLight((-1.5, 1.0, 0.5), (0.8, -0.6, 0.0), (9.0, 8.0, 7.0), 0.3, 0.7),
        ),
        environment=Environment(rng.uniform(0, 1, (6, 9, 3)).astype(np.float32)),
        cameras=(Camera((0.2, 0.1, 3.5), (0.0, 0.0, 0.0)),),
    )


def random_motion(
    name: str,
    rng: np.random.Generator,
    frames: int = 4,
    low: Vec3 = (-3.0, -3.0, -3.0),
    high: Vec3 = (3.0, 3.0, 3.0),
) -> Keyframes:
    """Any rigid poses of an object, one in every frame, shifted by ``low`` to ``high`` m."""
    turns = Rotation.random(frames, random_state=int(rng.integers(1 << 31))).as_matrix().tolist()
    shifts = rng.uniform(low, high, (frames, 3)).tolist()
    return Keyframes(
        name,
        tuple(range(frames)),
        tuple((x, y, z) for x, y, z in shifts),
        tuple(tuple((a, b, c) for a, b, c in turn) for turn in turns),  # type: ignore[misc]
    )


def random_lightmap(
    rng: np.random.Generator, scene: Scene, receivers: int, width: int, height: int
) -> Lightmap:
    """Receivers at random texels on random triangles; triangles scattered over the atlas."""
    count = len(scene.triangles)
    texel = np.sort(rng.choice(width * height, receivers, replace=False)).astype(np.int32)
    triangle = rng.integers(0, count, receivers)
    weights = rng.dirichlet((1, 1, 1), receivers)
    position = np.einsum("nc,ncd->nd", weights, scene.corners[triangle])
    a, b, c = np.moveaxis(scene.corners[triangle].astype(np.float64), 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    uvs = rng.uniform(0, (width, height), (count, 3, 2)).astype(np.float32)
    uvs[0] = np.nan
    return Lightmap(
        width,
        height,
        uvs,
        Receivers(
            texel,
            position.astype(np.float32),
            normal.astype(np.float32),
            rng.uniform(0, 1, (receivers, 3)).astype(np.float32),
            rng.uniform(0, 0.1, (receivers, 3)).astype(np.float32),
            np.ones(receivers, np.float32),
        ),
        Fragments(
            np.zeros(receivers + 1, np.int64),
            np.zeros((0, 3, 3), np.float32),
            np.zeros(0, np.int32),
            np.zeros(0, np.float32),
        ),
    )
