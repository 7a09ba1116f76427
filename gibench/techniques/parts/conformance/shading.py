"""Shading in float64 NumPy with Embree's visibility: what the frame's kernels are held against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Array
from gibench.rays.embree import EmbreeTracer
from gibench.scene.glow import decoded, shared_exponents
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, DirectionalLight, Light, PointLight, Scene, SpotLight

# The light at a hit is gathered so many roundings back along its ray (sampling.cl, back_along_ray).
STEP_BACK = 256


def light_gain(light: Light, position: Array) -> tuple[Array, Array, Array]:
    """Direction to the light, distance and unoccluded irradiance on a facing surface."""
    if isinstance(light, DirectionalLight):
        towards = np.broadcast_to(-np.array(light.direction), position.shape)
        return towards, np.full(len(position), np.inf), np.broadcast_to(light.irradiance, (1, 3))
    offset = np.array(light.position) - position
    distance = np.linalg.norm(offset, axis=1)
    towards = offset / distance[:, None]
    gain = np.array(light.intensity) / distance[:, None] ** 2
    if isinstance(light, SpotLight):
        outer = np.cos(light.outer_angle)
        share = (-(towards @ np.array(light.direction)) - outer) / (
            np.cos(light.inner_angle) - outer
        )
        gain = gain * np.clip(share, 0, 1)[:, None] ** 2
    assert isinstance(light, PointLight | SpotLight)
    return towards, distance, gain


@dataclass
class Lit:
    """Direct light at points."""

    irradiance: Array  # (n, 3)
    certain: Array  # (n,) no edge within a hair of a shadow ray, nor a light that a hair changes
    rays: Array  # (n,) shadow rays it takes: lights that the surface faces and that reach it


def unshadowed(lights: Sequence[Light], position: Array, normal: Array) -> Array:
    """Irradiance (n, 3) at points (n, 3) that nothing shadows."""
    total = np.zeros((len(position), 3))
    for light in lights:
        towards, _, gain = light_gain(light, position)
        total += np.maximum(np.einsum("ij,ij->i", normal, towards), 0)[:, None] * gain
    return total


def direct_irradiance(
    scene: Scene,
    frame: int,
    position: Array,
    normal: Array,
    geometric: Array,
    roundings: float = 0,
) -> Lit:
    """Direct light at points (n, 3) with shading and geometric normals.

    ``roundings``: how far off a point kernels may gather its light, in units in the last place of
    its largest coordinate. Where that moves the light, it is not certain.
    """
    tracer = EmbreeTracer(scene.corners)
    position = np.asarray(position, np.float64)
    total = np.zeros((len(position), 3))
    certain, rays = np.ones(len(position), bool), np.zeros(len(position), int)
    rng = np.random.default_rng(5)
    for light in scene.lights_at(frame):
        towards, distance, gain = light_gain(light, position)
        cosine = np.einsum("ij,ij->i", normal, towards)
        facing = (cosine > 0) & (np.einsum("ij,ij->i", geometric, towards) > 0)
        certain &= np.abs(np.einsum("ij,ij->i", geometric, towards)) > 1e-4
        answers = []
        for jitter in (0, *(1,) * 12):
            # Shadow rays start up to twice 256 roundings off the point, on its front (sampling.cl).
            reach = 512 * 2.0**-23 * np.abs(position).max(axis=1, keepdims=True)
            off = jitter * reach * rng.uniform(-1, 1, position.shape)
            off -= np.minimum(np.einsum("ij,ij->i", off, geometric), 0)[:, None] * geometric
            origin = position + 2e-5 * geometric + off
            limit = np.minimum(distance * 0.9999, 1e6)
            answers.append(
                tracer.occluded(
                    origin.astype(np.float32),
                    np.ascontiguousarray(towards, np.float32),
                    limit.astype(np.float32),
                )
            )
        certain &= np.all(answers[0] == np.array(answers), axis=0)
        rays += facing & (np.broadcast_to(gain, total.shape).sum(axis=1) > 0)
        total += np.where(facing & ~answers[0], cosine, 0.0)[:, None] * gain
    step = roundings * 2.0**-23 * np.abs(position).max(axis=1, keepdims=True)
    here = unshadowed(scene.lights_at(frame), position, normal)
    for way in (*np.eye(3), *-np.eye(3)):
        there = unshadowed(scene.lights_at(frame), position + step * way, normal)
        certain &= (np.abs(there - here) <= 1e-5 + 2e-4 * total).all(axis=1)
    return Lit(total, certain, rays)


def bilinear(image: Array, x: Array, y: Array, wrap: bool) -> Array:
    """Values at continuous texel coordinates whose centres are whole numbers; (h, w, k) image."""
    height, width = image.shape[:2]
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]

    def at(row: Array, column: Array) -> Array:
        if wrap:
            return np.asarray(image[row % height, column % width])
        return np.asarray(image[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)])

    top = at(y0, x0) * (1 - fx) + at(y0, x0 + 1) * fx
    end = at(y0 + 1, x0) * (1 - fx) + at(y0 + 1, x0 + 1) * fx
    return np.asarray(top * (1 - fy) + end * fy)


def quantised(pixels: Array) -> Array:
    """What a texture's values are after 8-bit sRGB."""
    code = np.where(
        pixels <= 0.0031308,
        12.92 * pixels,
        1.055 * np.asarray(pixels, np.float64) ** (1 / 2.4) - 0.055,
    )
    code = np.rint(code * 255) / 255
    return np.asarray(np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4))


@dataclass
class Surface:
    """Interpolated attributes at points of triangles."""

    position: Array  # (n, 3), m
    normal: Array  # (n, 3), of shading
    geometric: Array  # (n, 3)
    albedo: Array  # (n, 3)
    emission: Array  # (n, 3)


def _mixed(corners: Array, u: Array, v: Array) -> Array:
    """Attributes of corners (n, 3, d) at barycentric coordinates."""
    weights = np.stack([1 - u - v, u, v], axis=1)
    return np.asarray(np.einsum("nk,nkd->nd", weights, np.asarray(corners, np.float64)))


def surface(scene: Scene, triangle: Array, u: Array, v: Array) -> Surface:
    """Attributes of the surface at barycentric coordinates of triangles (n,)."""
    corner = scene.triangles[triangle]
    position = _mixed(scene.positions[corner], u, v)
    normal, uv = _mixed(scene.normals[corner], u, v), _mixed(scene.uvs[corner], u, v)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    c = scene.positions[corner].astype(np.float64)
    geometric = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    geometric /= np.linalg.norm(geometric, axis=1, keepdims=True)
    albedo, emission = np.empty((len(u), 3)), np.empty((len(u), 3))
    for i, material in enumerate(scene.materials):
        mine = scene.material_ids[triangle] == i
        albedo[mine], emission[mine] = material.base_color, material.emission
        if material.texture >= 0:
            image = quantised(scene.textures[material.texture].pixels)
            tx = uv[mine, 0] * image.shape[1] - 0.5
            ty = (1 - uv[mine, 1]) * image.shape[0] - 0.5
            albedo[mine] *= bilinear(image, tx, ty, wrap=True)
    if scene.glow is not None:
        rows = scene.glow.rows(len(scene.triangles))[triangle]
        for i, pixels in enumerate(scene.glow.images):
            mine = np.flatnonzero((rows >= 0) & (scene.glow.image[rows] == i))
            glow: Array = np.asarray(decoded(*shared_exponents(pixels))).reshape(pixels.shape)
            at = _mixed(scene.glow.uvs[rows[mine]], u[mine], v[mine])
            tall, wide = glow.shape[:2]
            tx, ty = at[:, 0] * wide - 0.5, (1 - at[:, 1]) * tall - 0.5
            emission[mine] = bilinear(glow, tx, ty, wrap=True)
    return Surface(position, normal, geometric, albedo, emission)


@dataclass
class PlaneHits:
    """Where rays meet the planes of triangles, in float64, and what single precision makes of it.

    Moller and Trumbore (1997) divide triple products by the determinant; the products round by some
    units in the last place of the lengths that they multiply, so a hit on a sliver, or at a grazing
    angle, is known the less the smaller the determinant is. ``slack_*`` bound that.
    """

    t: Array  # (n,)
    u: Array  # (n,)
    v: Array  # (n,)
    geometric: Array  # (n, 3) unit normals
    slack_t: Array  # (n,)
    slack_u: Array  # (n,)
    slack_v: Array  # (n,)

    @classmethod
    def of(cls, corners: Array, origin: Array, direction: Array) -> PlaneHits:
        """Of rays from origin (3,) or (n, 3) with direction (n, 3) and triangles (n, 3, 3)."""
        c = np.asarray(corners, np.float64)
        e1, e2 = c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]
        p = np.cross(direction, e2)
        determinant = np.einsum("ij,ij->i", p, e1)
        s = origin - c[:, 0]
        q = np.cross(s, e1)
        geometric = np.cross(e1, e2)
        geometric /= np.linalg.norm(geometric, axis=1, keepdims=True)
        # Four roundings: of the corners' difference, the cross and the dot product, the quotient.
        eps = 4 * 2.0**-23 / np.abs(determinant)
        from_corner, along_1, along_2 = (np.linalg.norm(each, axis=1) for each in (s, e1, e2))
        return cls(
            np.einsum("ij,ij->i", e2, q) / determinant,
            np.einsum("ij,ij->i", s, p) / determinant,
            np.einsum("ij,ij->i", direction, q) / determinant,
            geometric,
            eps * from_corner * along_1 * along_2,
            eps * from_corner * along_2,
            eps * from_corner * along_1,
        )


@dataclass
class View:
    """A camera image, its parts apart."""

    direct: Array  # (h, w, 3) emission, direct light and environment
    indirect: Array  # (h, w, 3)
    certain: Array  # (h, w)
    shadow_rays: Array  # (h, w)


def pixel_directions(
    camera: Camera, width: int, height: int, dx: float = 0.0, dy: float = 0.0
) -> Array:
    """Unit directions (h * w, 3) through points (dx, dy) pixels right of and below the centres."""
    eye, target = np.array(camera.position), np.array(camera.target)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, camera.up)
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    half = np.tan(np.radians(camera.fov_degrees / 2))
    y, x = np.divmod(np.arange(width * height), width)
    sx = ((x + 0.5 + dx) / width * 2 - 1) * half * width / height
    sy = (1 - (y + 0.5 + dy) / height * 2) * half
    d = forward + sx[:, None] * right + sy[:, None] * up
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


def render(
    scene: Scene,
    frame: int,
    width: int,
    height: int,
    lightmap: Lightmap | None = None,
    values: Array | None = None,
) -> View:
    """The camera image; ``values`` (h, w, 3) is the lightmap that is looked up.

    A pixel is certain where its ray and its shadow rays pass no edge within a hair, and where what
    single precision does to the hit on its triangle moves no light by over a ten thousandth.
    """
    camera = scene.cameras[0]
    eye = np.array(camera.position)

    def directions(dx: float, dy: float) -> Array:
        return pixel_directions(camera, width, height, dx, dy)

    tracer = EmbreeTracer(scene.corners)
    d = directions(0, 0)
    origin = np.broadcast_to(eye, d.shape).astype(np.float32)
    hits = tracer.closest(origin, d.astype(np.float32))
    certain = np.ones(len(d), bool)
    for dx, dy in ((1e-3, 1e-3), (-1e-3, 1e-3), (1e-3, -1e-3), (-1e-3, -1e-3)):
        near = tracer.closest(origin, directions(dx, dy).astype(np.float32))
        certain &= near.triangle == hits.triangle
    direct, indirect = scene.environment.radiance(d), np.zeros((len(d), 3))
    hit = np.flatnonzero(hits.triangle >= 0)
    triangle = hits.triangle[hit]
    plane = PlaneHits.of(scene.corners[triangle], eye, d[hit])
    normal = plane.geometric
    front = (np.einsum("ij,ij->i", normal, d[hit]) < 0)[:, None]

    def seen(u: Array, v: Array) -> tuple[Surface, Array]:
        found = surface(scene, triangle, u, v)
        if lightmap is None or values is None:
            return found, np.zeros((len(hit), 3))
        at = _mixed(lightmap.triangle_uvs[triangle], u, v)
        placed = ~np.isnan(at[:, 0])
        x, y = np.nan_to_num(at).T - 0.5
        reflected = found.albedo / np.pi * bilinear(values, x, y, wrap=False)
        return found, np.where(front & placed[:, None], reflected, 0)

    def unoccluded(found: Surface) -> Array:
        lit = unshadowed(scene.lights_at(frame), found.position, found.normal)
        return np.where(front, found.emission + found.albedo / np.pi * lit, 0)

    found, indirect[hit] = seen(plane.u, plane.v)
    lit = direct_irradiance(scene, frame, found.position, found.normal, normal, STEP_BACK)
    certain[hit] &= lit.certain | ~front[:, 0]
    direct[hit] = np.where(front, found.emission + found.albedo / np.pi * lit.irradiance, 0)
    for du, dv in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        moved, looked_up = seen(plane.u + du * plane.slack_u, plane.v + dv * plane.slack_v)
        for value, other in (
            (unoccluded(found), unoccluded(moved)),
            (indirect[hit], looked_up),
        ):
            certain[hit] &= (np.abs(other - value) <= 1e-5 + 1e-4 * np.abs(direct[hit])).all(axis=1)
    rays = np.zeros(len(d), int)
    rays[hit] = np.where(front[:, 0], lit.rays, 0)
    shape = (height, width, 3)
    images = direct.reshape(shape), indirect.reshape(shape)
    return View(*images, certain.reshape(shape[:2]), rays.reshape(shape[:2]))
