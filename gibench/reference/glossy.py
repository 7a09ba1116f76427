"""The truth of gloss: what surfaces reflect glossily of indirect light towards the camera.

The same reflectance as kernels_cl/common/ggx.cl, written down a second time: facets distributed by
Trowbridge and Reitz (1975), Schlick's shadowing and Fresnel terms (1994). Directions are drawn as
the facets are (Walter et al. 2007, section 5.2), and what comes along each is path-traced. All
later bounces are diffuse, as everywhere here; normal maps have no part.

And the same of a lobe cos^n, which surfel caches reflect besides their diffuse light.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from gibench.arrays import Doubles, Longs
from gibench.errors import BadInput
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.reference.camera import image_plane
from gibench.reference.packed import pack_scene
from gibench.reference.path_tracer import LEAST_ROUNDS, Reference
from gibench.reference.starts import RayStart
from gibench.reference.wavefront import Wavefront
from gibench.scene.gloss import DIELECTRIC_F0, LEAST_ALPHA, gloss_at
from gibench.scene.lightmap.albedo import bilinear
from gibench.scene.model import Camera, Scene

_BATCH = 1 << 18
"""Paths at once."""


class _Seen(NamedTuple):
    """What camera rays hit, of those that hit a front: (n, 3) each but for alpha (n,)."""

    path: Longs
    position: Doubles
    normal: Doubles
    geometric: Doubles
    view: Doubles
    f0: Doubles
    alpha: Doubles


_Scatter = Callable[[_Seen, np.random.Generator], tuple[Doubles, Doubles]]


def reference_gloss(
    scene: Scene,
    camera: Camera,
    width: int,
    height: int,
    *,
    frame: int = 0,
    paths: int = 256,
    seed: int = 1,
) -> Reference:
    """A path-traced image of glossily reflected indirect light, box-filtered over each pixel.

    Args:
        scene: the scene.
        camera: one of its cameras or another.
        width: pixels.
        height: pixels.
        frame: the lights are where they are in this frame.
        paths: per pixel, rounded up to whole rounds.
        seed: of the randomisation.

    Returns:
        Radiance (height, width, 3) in W/m2/sr, and its standard error.

    Raises:
        BadInput: too few paths, or a camera that makes no image.
        CannotRun: there is no OpenCL runtime for the CPU.
    """
    return _reflected(scene, camera, width, height, _scattered, frame, paths, seed)


def reference_lobe(
    scene: Scene,
    camera: Camera,
    width: int,
    height: int,
    exponent: float,
    *,
    half_vector: bool = False,
    frame: int = 0,
    paths: int = 256,
    seed: int = 1,
) -> Reference:
    """A path-traced image of indirect light under a lobe cos^n of volume one, whatever the
    materials (Jendersie et al. 2016, section 3.2); nothing comes from below a surface.

    n is Phong's, of the angle between what comes in and the mirrored direction, or Blinn's, of the
    angle between the normal and the half vector. Half vectors turn half as much: n of Blinn's is
    about as wide as n / 4 of Phong's.

    Args:
        scene: the scene.
        camera: one of its cameras or another.
        width: pixels.
        height: pixels.
        exponent: n.
        half_vector: whether it is Blinn's (1977) n, else Phong's (1975).
        frame: the lights are where they are in this frame.
        paths: per pixel, rounded up to whole rounds.
        seed: of the randomisation.

    Returns:
        Radiance (height, width, 3) in W/m2/sr, and its standard error.

    Raises:
        BadInput: too few paths, or a camera that makes no image.
        CannotRun: there is no OpenCL runtime for the CPU.
    """
    scatter = partial(_about_half if half_vector else _in_lobe, exponent=exponent)
    return _reflected(scene, camera, width, height, scatter, frame, paths, seed)


def _reflected(
    scene: Scene,
    camera: Camera,
    width: int,
    height: int,
    scatter: _Scatter,
    frame: int,
    paths: int,
    seed: int,
) -> Reference:
    """What ``scatter`` reflects towards the camera of the light that comes along its directions."""
    if paths < LEAST_ROUNDS:
        raise BadInput(f"{paths} paths give no standard error", mend=f"give {LEAST_ROUNDS} or more")
    began = time.perf_counter()
    plane, packed = image_plane(camera, width, height), pack_scene(scene, frame)
    each, pixels = -(-paths // LEAST_ROUNDS), width * height
    means = np.zeros((LEAST_ROUNDS, pixels, 3))
    rays, ray_seconds = 0, 0.0
    for number in range(LEAST_ROUNDS):
        rng = np.random.default_rng([seed, number])
        at_once = max(1, _BATCH // each)
        for first in range(0, pixels, at_once):
            chosen = np.arange(first, min(first + at_once, pixels))
            owner = np.repeat(chosen, each)
            seen = _seen(scene, plane, width, height, owner, rng)
            directions, weight = scatter(seen, rng)
            go = weight.any(axis=1)
            if not go.any():
                continue
            origins = seen.position[go] + surface_offset(scene) * seen.geometric[go]
            start = RayStart(origins, directions[go])
            front = Wavefront(packed, scene_tracer(scene), start, None)
            found = front.round(1, int(rng.integers(1 << 31))) * weight[go]
            np.add.at(means[number], owner[seen.path[go]], found / each)
            rays, ray_seconds = rays + front.work.rays, ray_seconds + front.work.ray_seconds
    shape = (height, width, 3)
    error = means.std(axis=0, ddof=1) / np.sqrt(LEAST_ROUNDS)
    return Reference(
        value=means.mean(axis=0).reshape(shape),
        stderr=error.reshape(shape),
        paths=each * LEAST_ROUNDS,
        rounds=LEAST_ROUNDS,
        rays=rays,
        seconds=time.perf_counter() - began,
        ray_seconds=ray_seconds,
        key="",
    )


def _seen(
    scene: Scene,
    plane: Doubles,
    width: int,
    height: int,
    owner: Longs,
    rng: np.random.Generator,
) -> _Seen:
    """What rays through random points of the pixels ``owner`` (n,) see."""
    within = rng.random((len(owner), 2))
    x = 2 * (owner % width + within[:, 0]) / width - 1
    y = 1 - 2 * (owner // width + within[:, 1]) / height
    directions = plane[1] + x[:, None] * plane[2] + y[:, None] * plane[3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.broadcast_to(plane[0], directions.shape).astype(np.float32)
    hits = scene_tracer(scene).closest(origins, directions.astype(np.float32))
    path = np.flatnonzero(hits.triangle >= 0)
    triangle = hits.triangle[path]
    u, v = hits.u[path].astype(np.float64), hits.v[path].astype(np.float64)
    weights = np.stack([1 - u - v, u, v], axis=1)
    corners = scene.triangles[triangle]
    points = scene.positions[corners].astype(np.float64)
    geometric = _unit(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))
    normal = _unit(np.einsum("nk,nkx->nx", weights, scene.normals[corners].astype(np.float64)))
    view = -directions[path]
    n_v = np.einsum("nx,nx->n", normal, view)
    front = (np.einsum("nx,nx->n", geometric, view) > 0) & (n_v > 0)
    material = scene.material_ids[triangle]
    color = np.array([m.base_color for m in scene.materials])[material]
    texture = np.array([m.texture for m in scene.materials])[material]
    for number, image in enumerate(scene.textures):
        own = np.flatnonzero(texture == number)
        if len(own):
            uvs = np.einsum("nk,nkx->nx", weights[own], scene.uvs[corners[own]].astype(np.float64))
            color[own] *= bilinear(image.pixels.astype(np.float64), uvs)
    gloss = np.array([(m.roughness, m.metalness) for m in scene.materials])[material]
    if scene.gloss_maps is not None:
        gloss = gloss_at(scene.gloss_maps, gloss, triangle, weights)
    f0 = DIELECTRIC_F0 + (color - DIELECTRIC_F0) * gloss[:, 1:]
    return _Seen(
        path[front],
        np.einsum("nk,nkx->nx", weights, points)[front],
        normal[front],
        geometric[front],
        view[front],
        f0[front],
        np.maximum(gloss[front, 0] ** 2, LEAST_ALPHA),
    )


def _scattered(seen: _Seen, rng: np.random.Generator) -> tuple[Doubles, Doubles]:
    """Directions (n, 3), and reflectance times cosine over their density (n, 3)."""
    turn, share = 2 * np.pi * rng.random(len(seen.alpha)), rng.random(len(seen.alpha))
    n_h = np.sqrt((1 - share) / (1 + (seen.alpha**2 - 1) * share))
    across = np.sqrt(np.maximum(1 - n_h**2, 0))
    tangent = _unit(np.cross(seen.normal, np.eye(3)[np.abs(seen.normal).argmin(axis=1)]))
    other = np.cross(seen.normal, tangent)
    half = (
        (across * np.cos(turn))[:, None] * tangent
        + (across * np.sin(turn))[:, None] * other
        + n_h[:, None] * seen.normal
    )
    v_h = np.einsum("nx,nx->n", seen.view, half)
    directions = 2 * v_h[:, None] * half - seen.view
    n_l = np.einsum("nx,nx->n", seen.normal, directions)
    n_v = np.einsum("nx,nx->n", seen.normal, seen.view)
    above = np.einsum("nx,nx->n", seen.geometric, directions) > 0
    k = seen.alpha / 2
    masking = 1 / ((n_v * (1 - k) + k) * (np.maximum(n_l, 0) * (1 - k) + k))
    fresnel = seen.f0 + (1 - seen.f0) * (np.clip(1 - v_h, 0, 1) ** 5)[:, None]
    # D n_h / (4 v_h) is the density; n_v and n_l are in the shadowing and under it.
    weight = np.where((n_l > 0) & above & (v_h > 0), masking * n_l * v_h / n_h, 0.0)
    return directions, weight[:, None] * fresnel


def _in_lobe(seen: _Seen, rng: np.random.Generator, exponent: float) -> tuple[Doubles, Doubles]:
    """Directions (n, 3) by cos^n about the mirrored ones, and 1 (n, 1) above the surface."""
    n_v = np.einsum("nx,nx->n", seen.normal, seen.view)
    mirrored = 2 * n_v[:, None] * seen.normal - seen.view
    directions = _by_power(mirrored, rng, exponent)
    return directions, _above(seen, directions)


def _about_half(seen: _Seen, rng: np.random.Generator, exponent: float) -> tuple[Doubles, Doubles]:
    """Directions (n, 3) mirrored at half vectors that are drawn by cos^n about the normal, and 1
    (n, 1) above the surface.
    """
    half = _by_power(seen.normal, rng, exponent)
    v_h = np.einsum("nx,nx->n", seen.view, half)
    directions = 2 * v_h[:, None] * half - seen.view
    return directions, _above(seen, directions) * (v_h > 0)[:, None]


def _by_power(axes: Doubles, rng: np.random.Generator, exponent: float) -> Doubles:
    """Directions (n, 3) by (n + 1) / (2 pi) cos^n of the angle to unit ``axes`` (n, 3)."""
    turn, cosine = 2 * np.pi * rng.random(len(axes)), rng.random(len(axes))
    cosine = cosine ** (1 / (exponent + 1))
    across = np.sqrt(np.maximum(1 - cosine**2, 0))
    tangent = _unit(np.cross(axes, np.eye(3)[np.abs(axes).argmin(axis=1)]))
    return np.asarray(
        (across * np.cos(turn))[:, None] * tangent
        + (across * np.sin(turn))[:, None] * np.cross(axes, tangent)
        + cosine[:, None] * axes
    )


def _above(seen: _Seen, directions: Doubles) -> Doubles:
    """1 where a direction goes away from the surface, else 0, (n, 1)."""
    goes = np.einsum("nx,nx->n", seen.geometric, directions) > 0
    return np.asarray(goes[:, None], np.float64)


def _unit(vectors: Doubles) -> Doubles:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
