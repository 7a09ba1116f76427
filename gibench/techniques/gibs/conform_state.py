"""GIBS with random surfels on a random scene, for `gibench conform`: how it is set up, and the
random choices that its kernels make.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gibench.arrays import Array
from gibench.techniques.gibs import SPEC
from gibench.techniques.gibs.conform_oracle import frame_words, gathered
from gibench.techniques.parts.conformance.case import Bench, created, run_pass
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene

SEED = 7
"""The third word of the frame's own (conform_oracle.frame_words)."""
OBJECTS = 3
CAPACITY, ALIVE = 300, 240
RADII = (0.1, 0.4)
"""m; no larger than a cell of :func:`alive_surfels`."""


def random_words(a: Array | int, b: Array | int, c: Array | int) -> Array:
    """(..., 3) uint32 (Jarzynski and Olano 2020, pcg3d)."""
    words = np.broadcast_arrays(*(np.asarray(word).astype(np.uint32) for word in (a, b, c)))
    x, y, z = (np.atleast_1d(word) * np.uint32(1664525) + np.uint32(1013904223) for word in words)
    for shift in (True, False):
        x = x + y * z
        y = y + z * x
        z = z + x * y
        if shift:
            x, y, z = (word ^ (word >> np.uint32(16)) for word in (x, y, z))
    return np.stack([x, y, z], axis=-1)


def unit(words: Array) -> Array:
    """In [0, 1), exactly as float32 has it."""
    return np.asarray((words >> np.uint32(8)).astype(np.float64) / 2**24)


@dataclass(frozen=True)
class Sorted:
    """A technique whose surfels are sorted into its grid; what they are, by ID, in float64."""

    technique: Any
    ids: Array  # (ALIVE,) in the list's order
    camera: Array  # (3,)
    angle: float  # radius per metre from the camera
    position: Array  # (CAPACITY, 3), m
    normal: Array  # (CAPACITY, 3)
    radius: Array  # (CAPACITY,), m
    irradiance: Array  # (CAPACITY, 3), W/m2
    transforms: Array  # (OBJECTS, 3, 4)

    def begin(self, frame: int, rays: int = 0, alive: int = ALIVE) -> None:
        """Tell the device what the frame is."""
        least, most = RADII
        words = frame_words(
            alive, self.camera.tolist(), self.angle, least, most, frame=frame, rays=rays
        )
        self.technique.device.write(self.technique.surfels.geometry.frame, words)
        self.technique._alive, self.technique._rays = alive, rays

    def lookup(self, position: Array, normal: Array) -> Array:
        """Irradiance and coverage (n, 4) at points from all surfels there are."""
        on = self.ids
        held = self.position[on], self.normal[on], self.radius[on], self.irradiance[on]
        rows = [gathered(x, n, *held, None) for x, n in zip(position, normal, strict=True)]
        return np.array(rows).reshape(-1, 4)

    def weights(self, position: Array, normal: Array) -> tuple[Array, Array]:
        """What says whether surfels count at points, (n, ALIVE) each: they do where both are
        positive. 1 - distance / radius, and the cosine between the normals.
        """
        o = position[:, None] - self.position[self.ids]
        m = self.normal[self.ids]
        h = np.einsum("nsx,sx->ns", o, m)
        stretch = self.technique.settings.normal_stretch
        d = np.sqrt((o * o).sum(axis=2) + (stretch**2 - 1) * h * h)
        return 1 - d / self.radius[self.ids], normal @ m.T

    def radius_at(self, position: Array) -> Array:
        """The radius (n,) of surfels at points, m."""
        away = np.linalg.norm(position - self.camera, axis=1)
        return np.asarray(np.clip(away * self.angle, *RADII))


def alive_surfels(
    bench: Bench,
    rng: np.random.Generator,
    size: int,
    variant: str,
    image: tuple[int, int] = (24, 16),
    **settings: Any,
) -> Sorted:
    """Surfels of moved objects on a scene's triangles, sorted by groups of ``size``."""
    scene = random_scene(rng, 40)
    objects = rng.permutation(np.arange(40) % OBJECTS).astype(np.int32)
    scene = replace(scene, object_ids=objects)
    lightmap = random_lightmap(rng, scene, 20, 8, 8)
    known = {"surfels": CAPACITY, "grid_cells": 6, "depth_moments": False, "ray_guiding": False}
    chosen = SPEC.settings({**known, "rays_per_surfel": 4.0, **settings})
    device = bench.open()
    technique = created(SPEC, device, scene, lightmap, chosen, None, variant, size, image)
    technique.begin_frame(0)

    triangle = rng.integers(0, 40, CAPACITY)
    corners = scene.corners[triangle].astype(np.float64)
    place = np.einsum("nc,ncx->nx", rng.dirichlet((1, 1, 1), CAPACITY), corners)
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    face += 0.1 * rng.normal(size=face.shape)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    transforms = np.zeros((OBJECTS, 3, 4))
    turns = Rotation.random(OBJECTS, random_state=int(rng.integers(1 << 31)))
    transforms[:, :, :3] = turns.as_matrix()
    transforms[:, :, 3] = rng.uniform(-1, 1, (OBJECTS, 3))
    transforms = transforms.astype(np.float32).astype(np.float64)
    owner = rng.integers(0, OBJECTS, CAPACITY)

    geometry = technique.surfels.geometry
    ids = rng.permutation(CAPACITY)[:ALIVE]
    alive = np.zeros(CAPACITY, np.uint32)
    alive[:ALIVE] = ids
    placed = np.zeros(CAPACITY, np.int32)
    placed[ids] = owner[ids] + 1
    local, turned = into_objects(transforms, owner, place, face)
    estimator = rng.uniform(0.05, 1, technique.surfels.estimator.shape).astype(np.float32)
    estimator[11] = rng.choice([0, 30, 63, 64, 100], CAPACITY)
    for buffer, values in (
        (geometry.alive_ids, alive),
        (geometry.object_ids, placed),
        (geometry.transforms, transforms.reshape(OBJECTS, 12).astype(np.float32)),
        (geometry.local_position, local.T.astype(np.float32)),
        (geometry.local_normal, turned.T.astype(np.float32)),
        (technique.surfels.estimator, estimator),
    ):
        device.write(buffer, values)
    found = Sorted(
        technique,
        ids,
        rng.uniform(-1, 1, 3).astype(np.float32).astype(np.float64),
        float(np.float32(0.2)),
        place,
        face,
        np.zeros(CAPACITY),
        estimator[:3].T.astype(np.float64),
        transforms,
    )
    found.begin(1)
    for name in ("transform_and_count", "prefix_sum", "finalise"):
        run_pass(technique, name, size)
    # Judged by the cases of sorting: what is looked up is what the device holds.
    position, normal = (
        device.read(one).T.astype(np.float64)
        for one in (geometry.world_position, geometry.world_normal)
    )
    return replace(
        found,
        position=position,
        normal=normal,
        radius=device.read(geometry.radii).astype(np.float64),
    )


def into_objects(
    transforms: Array, owner: Array, position: Array, normal: Array
) -> tuple[Array, Array]:
    """World positions and normals (n, 3) in the spaces of their objects."""
    m = transforms[owner]
    local = np.einsum("nij,ni->nj", m[:, :, :3], position - m[:, :, 3])
    return local, np.einsum("nij,ni->nj", m[:, :, :3], normal)
