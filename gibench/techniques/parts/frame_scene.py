"""The scene on the device: what the passes of every technique share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.device import Buffer, Device
from gibench.rays.bvh import Bvh, build_bvh
from gibench.rays.device_bvh import DeviceBvh
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import (
    Camera,
    DirectionalLight,
    Light,
    PointLight,
    Scene,
    SpotLight,
)
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.camera_path import Flight
from gibench.techniques.parts.moving_geometry import (
    TRANSFORM_FLOATS,
    MovingGeometry,
    transform_table,
)
from gibench.techniques.technique import Argument, Pass

LIGHT_FLOATS = 12  # kernels_cl/common/lights.cl
CAMERA_FLOATS = 12  # kernels_cl/common/camera.cl
MATERIAL_FLOATS = 6  # kernels_cl/common/material.cl


def light_table(lights: Sequence[Light]) -> Floats:
    """The lights as kernels_cl/common/lights.cl reads them, (n, 12) float32."""
    table = np.zeros((len(lights), LIGHT_FLOATS), np.float32)
    for row, light in zip(table, lights, strict=True):
        match light:
            case DirectionalLight():
                row[4:7], row[7:10] = light.direction, light.irradiance
            case PointLight():
                row[0], row[1:4], row[7:10] = 1, light.position, light.intensity
            case SpotLight():
                row[0], row[1:4], row[7:10] = 2, light.position, light.intensity
                row[4:7] = light.direction
                # glTF, KHR_lights_punctual, "Inner and Outer Cone Angles".
                outer = math.cos(light.outer_angle)
                row[10] = 1.0 / max(0.001, math.cos(light.inner_angle) - outer)
                row[11] = -outer * row[10]
    return table


def camera_table(camera: Camera, width: int, height: int) -> Floats:
    """The camera as kernels_cl/common/camera.cl reads it, (12,) float32."""
    position = np.asarray(camera.position, np.float64)
    forward = np.asarray(camera.target, np.float64) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(camera.up, np.float64))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    half = math.tan(math.radians(camera.fov_degrees) / 2)
    parts = (position, forward, right * half * width / height, up * half)
    return np.concatenate(parts).astype(np.float32)


def srgb_to_linear() -> Floats:
    """What each of the 256 sRGB codes means (IEC 61966-2-1), (256,) float32."""
    code = np.arange(256) / 255.0
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def srgb_codes(linear: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """The nearest sRGB codes of ``linear`` values, any shape; values outside [0, 1] are clamped."""
    x = np.clip(np.asarray(linear, np.float32), 0.0, 1.0)
    code = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055)
    return np.rint(code * 255.0).astype(np.uint8)


def pack_textures(scene: Scene) -> tuple[Ints, npt.NDArray[np.uint8]]:
    """Where each material's texture lies (m, 3) int32, and all texels (n, 4) uint8, sRGB."""
    sizes = [texture.pixels.shape[0] * texture.pixels.shape[1] for texture in scene.textures]
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    texels = np.zeros((int(first[-1]), 4), np.uint8)
    for texture, start, size in zip(scene.textures, first, sizes, strict=False):
        texels[start : start + size, :3] = srgb_codes(texture.pixels.reshape(-1, 3))
    table = np.full((len(scene.materials), 3), -1, np.int32)
    for row, material in zip(table, scene.materials, strict=True):
        if material.texture >= 0:
            height, width = scene.textures[material.texture].pixels.shape[:2]
            row[:] = first[material.texture], width, height
    return table, texels


def frame_scene_bytes(
    scene: Scene,
    width: int,
    height: int,
    bvh: Bvh | None = None,
    motion: MovingObjects | None = None,
) -> int:
    """Bytes that a :class:`FrameScene` takes.

    Args:
        scene: the scene.
        width: of the image, pixels.
        height: of the image, pixels.
        bvh: its tree; without it, the tree counts as its full leaf blocks alone (8 triangles in
            320 bytes, kernels_cl/common/bvh.cl), a lower bound.
        motion: what moves in it; nothing of this is counted at rest.
    """
    vertices, triangles = len(scene.positions), len(scene.triangles)
    tree = -(-triangles // 8) * 320 if bvh is None else bvh.nodes.nbytes + bvh.blocks.nbytes
    texels = sum(t.pixels.shape[0] * t.pixels.shape[1] for t in scene.textures)
    moving = 0
    if motion is not None:
        moving = 4 * TRANSFORM_FLOATS * motion.objects + MovingGeometry.bytes_of(scene, motion, bvh)
    return int(
        tree
        + moving
        + 4 * (8 * vertices + 4 * triangles)
        + 4 * (MATERIAL_FLOATS + 3) * len(scene.materials)
        + 4 * texels
        + 4 * 256
        + 4 * scene.environment.pixels.size
        + 4 * (LIGHT_FLOATS * len(scene.lights) + CAMERA_FLOATS)
        + 4 * 3 * width * height
    )


class FrameScene:
    """Geometry, tree, materials, lights, environment, camera and image on a device.

    Kernel arguments come as tuples in the order of the macros of the same name in
    ``kernels_cl/common``: ``bvh_args`` (BVH_PARAMS), ``surface_args`` (SURFACE_PARAMS),
    ``light_args`` (LIGHT_PARAMS), ``environment_args`` (ENVIRONMENT_PARAMS) and ``camera_args``
    (camera, width, height).

    Args:
        device: where it lies.
        scene: the scene.
        width: of the image, pixels.
        height: of the image, pixels.
        camera: the view, at rest.
        bvh: the scene's tree, where it is already built.
        flight: that takes the camera along; None where it rests.
        motion: of its objects; None where they rest.

    Attributes:
        camera: the view of the frame last begun.
        frame: the frame last begun; 0 before any.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    def __init__(
        self,
        device: Device,
        scene: Scene,
        width: int,
        height: int,
        camera: Camera,
        bvh: Bvh | None = None,
        flight: Flight | None = None,
        motion: MovingObjects | None = None,
    ) -> None:
        self.device, self.scene = device, scene
        self.camera = self._resting = camera
        self.frame = 0
        self._flight, self._motion = flight, motion
        self.width, self.height = width, height
        self.bvh = build_bvh(scene.corners) if bvh is None else bvh
        tree = DeviceBvh.upload(device, self.bvh)
        materials = np.array([(*m.base_color, *m.emission) for m in scene.materials], np.float32)
        textures, texels = pack_textures(scene)
        self.bvh_args: tuple[Buffer, ...] = tree.args
        positions = device.upload("positions", scene.positions)
        normals = device.upload("normals", scene.normals)
        triangles = device.upload("triangles", scene.triangles)
        self.surface_args: tuple[Buffer, ...] = (
            positions,
            normals,
            device.upload("uvs", scene.uvs),
            triangles,
            device.upload("material_ids", scene.material_ids),
            device.upload("materials", materials),
            device.upload("material_textures", textures),
            device.upload("texels", texels),
            device.upload("srgb_to_linear", srgb_to_linear()),
        )
        rows, columns = scene.environment.pixels.shape[:2]
        environment = device.upload("environment", scene.environment.pixels)
        self.environment_args: tuple[Argument, ...] = (
            environment,
            np.int32(columns),
            np.int32(rows),
        )
        self._lights = device.upload("lights", light_table(scene.lights_at(0)))
        self.light_args: tuple[Argument, ...] = (self._lights, np.int32(len(scene.lights)))
        self._view = device.upload("camera", camera_table(camera, width, height))
        self.camera_args: tuple[Argument, ...] = (self._view, np.int32(width), np.int32(height))
        self.image = device.empty("image", (height, width, 3), np.float32)
        self._transforms: Buffer | None = None
        self._moving: MovingGeometry | None = None
        if motion is not None:
            geometry = (positions, normals, triangles)
            self._moving = MovingGeometry.create(
                device, scene, motion, tree, self.object_transforms(), *geometry
            )

    @property
    def nbytes(self) -> int:
        """Bytes it takes on the device, in closed form."""
        known = frame_scene_bytes(self.scene, self.width, self.height, self.bvh, self._motion)
        at_rest = self._motion is None and self._transforms is not None
        return known + (4 * TRANSFORM_FLOATS * self.objects if at_rest else 0)

    @property
    def objects(self) -> int:
        """Number of objects, moving or not."""
        return len(np.unique(self.scene.object_ids))

    def object_transforms(self) -> Buffer:
        """Every object's transform from object space to the world in the frame last begun, 3 x 4
        row-major, (objects, 12) float32, in the order of :meth:`Scene.object_numbers`; on the
        device from the first time it is asked for.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        if self._transforms is None:
            at_rest = np.tile(np.eye(3, 4, dtype=np.float32), (self.objects, 1, 1))
            self._transforms = self.device.upload("object_transforms", transform_table(at_rest))
        return self._transforms

    def passes(self) -> list[Pass]:
        """The passes that move its objects, which come before all others; none at rest."""
        return [] if self._moving is None else self._moving.passes()

    def begin_frame(self, frame: int) -> None:
        """Move lights and camera to where they are in ``frame``, and tell where the objects are."""
        self.frame = frame
        self.device.write(self._lights, light_table(self.scene.lights_at(frame)))
        if self._moving is not None and self._motion is not None:
            self._moving.move(self._motion.transforms_in(frame))
        if self._flight is not None:
            self._see(self._flight.camera_in(frame, self._resting))

    def look_from(self, camera: Camera) -> None:
        """See the scene from ``camera`` wherever there is no flight."""
        self._resting = camera
        self._see(camera)

    def _see(self, camera: Camera) -> None:
        if camera != self.camera:
            self.camera = camera
            self.device.write(self._view, camera_table(camera, self.width, self.height))


def border_texels(lightmap: Lightmap) -> Ints:
    """Flat indices of the invalid texels with a valid one among their 8 neighbours, ascending."""
    valid = np.zeros((lightmap.height + 2, lightmap.width + 2), np.bool_)
    inner = valid[1:-1, 1:-1]
    rows, columns = np.divmod(lightmap.receivers.texel, lightmap.width)
    valid[rows + 1, columns + 1] = True
    near = np.zeros_like(inner)
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            near |= valid[dy : dy + lightmap.height, dx : dx + lightmap.width]
    return np.flatnonzero(near & ~inner).astype(np.int32)


@dataclass(frozen=True)
class FrameLightmap:
    """The atlas and its receivers on a device.

    Attributes:
        device: where it lies.
        lightmap: what was uploaded.
        uvs: (t, 6) float32 the triangles' corners in texels, negative without a place.
        position: (n, 3) float32 of the receivers, m.
        normal: (n, 3) float32.
        albedo: (n, 3) float32.
        emission: (n, 3) float32, W/m2/sr.
        texel: (n,) int32.
    """

    device: Device
    lightmap: Lightmap
    uvs: Buffer
    position: Buffer
    normal: Buffer
    albedo: Buffer
    emission: Buffer
    texel: Buffer

    @staticmethod
    def upload(device: Device, lightmap: Lightmap) -> FrameLightmap:
        """Upload ``lightmap``.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        uvs = np.nan_to_num(lightmap.triangle_uvs, nan=-1.0).astype(np.float32)
        receivers = lightmap.receivers
        return FrameLightmap(
            device,
            lightmap,
            device.upload("lightmap_uvs", uvs.reshape(-1, 6)),
            device.upload("receiver_position", receivers.position),
            device.upload("receiver_normal", receivers.normal),
            device.upload("receiver_albedo", receivers.albedo),
            device.upload("receiver_emission", receivers.emission),
            device.upload("receiver_texel", receivers.texel),
        )

    @staticmethod
    def bytes_of(triangles: int, receivers: int) -> int:
        """Bytes that one of this size takes, maps not included."""
        return 4 * (6 * triangles + 13 * receivers)

    @staticmethod
    def map_bytes(texels: int) -> int:
        """Bytes of one map of ``texels`` texels."""
        return 16 * texels

    @property
    def nbytes(self) -> int:
        """Bytes it takes on the device, in closed form; maps not included."""
        return self.bytes_of(len(self.lightmap.triangle_uvs), len(self.lightmap.receivers))

    @property
    def texels(self) -> int:
        """Texels of a map."""
        return self.lightmap.width * self.lightmap.height

    def new_map(self, name: str, extra: int = 0) -> Buffer:
        """A black map (texels + extra, 4) float32 whose fourth component marks the receivers.

        Args:
            name: in the ledger.
            extra: further black entries behind the texels.
        """
        data = np.zeros((self.texels + extra, 4), np.float32)
        data[self.lightmap.receivers.texel, 3] = 1.0
        return self.device.upload(name, data)

    def at_receivers(self, values: Buffer) -> Floats:
        """A map's colour at the receivers, (n, 3) float32."""
        texels = self.device.read(values).reshape(-1, 4)
        return np.ascontiguousarray(texels[self.lightmap.receivers.texel, :3])
