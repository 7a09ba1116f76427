"""The scene on the device: what the passes of every technique share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gibench.device import Argument, Buffer, Device, ProgramSpec, integer, reads
from gibench.device.build import Define
from gibench.rays.bvh import Bvh, build_bvh
from gibench.rays.device_bvh import DeviceBvh
from gibench.scene.model import Camera, Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.camera_path import Flight
from gibench.techniques.job import Shot, World
from gibench.techniques.parts.camera_table import CAMERA_FLOATS, camera_table
from gibench.techniques.parts.light_table import light_table
from gibench.techniques.parts.macros import LIGHT_FLOATS, SCENE_MACROS
from gibench.techniques.parts.moving_geometry import (
    TRANSFORM_FLOATS,
    MovingGeometry,
    transform_table,
)
from gibench.techniques.parts.surfaces import Surfaces
from gibench.techniques.technique import Pass


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
    triangles = len(scene.triangles)
    tree = -(-triangles // 8) * 320 if bvh is None else bvh.nodes.nbytes + bvh.blocks.nbytes
    cut = 0 if scene.cutouts is None else scene.cutouts.packed_bytes(triangles)
    moving = 0
    if motion is not None:
        moving = 4 * TRANSFORM_FLOATS * motion.objects + MovingGeometry.bytes_of(scene, motion, bvh)
    return int(
        tree
        + cut
        + moving
        + Surfaces.bytes_of(scene)
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
        surfaces: geometry, materials, textures; all that kernels read of a surface.
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
        cutouts = scene.cutouts
        packed = None if cutouts is None else cutouts.packed(len(scene.triangles))
        tree = DeviceBvh.upload(device, self.bvh, cutouts=packed)
        self.bvh_args, self._tree_defines = tree.args, tree.defines
        self.surfaces = Surfaces.upload(device, scene)
        rows, columns = scene.environment.pixels.shape[:2]
        environment = device.upload("environment", scene.environment.pixels)
        self.environment_args: tuple[Argument, ...] = (
            reads("environment", environment),
            integer("environment_width", columns),
            integer("environment_height", rows),
        )
        self._lights = device.upload("lights", light_table(scene.lights_at(0)))
        self.light_args: tuple[Argument, ...] = (
            reads("lights", self._lights),
            integer("light_count", len(scene.lights)),
        )
        self._view = device.upload("camera", camera_table(camera, width, height))
        self.size_args: tuple[Argument, ...] = (
            integer("width", width),
            integer("height", height),
        )
        self.camera_args: tuple[Argument, ...] = (reads("camera", self._view), *self.size_args)
        self.image = device.empty("image", (height, width, 3), np.float32)
        self._transforms: Buffer | None = None
        self._moving: MovingGeometry | None = None
        if motion is not None:
            self._moving = MovingGeometry.create(
                device,
                scene,
                motion,
                tree,
                transforms=self.object_transforms(),
                positions=self.surfaces.positions,
                normals=self.surfaces.normals,
                triangles=self.surfaces.triangles,
            )

    @staticmethod
    def of(device: Device, shot: Shot, world: World) -> FrameScene:
        """What ``shot`` sees of ``world``.

        Raises:
            CannotRun: the scene does not fit the device's profile.
        """
        return FrameScene(
            device,
            world.scene,
            shot.width,
            shot.height,
            world.camera,
            flight=world.flight,
            motion=world.motion,
        )

    @property
    def surface_args(self) -> tuple[Argument, ...]:
        """The surfaces in the order of SURFACE_PARAMS."""
        return self.surfaces.args

    def program(self, path: str, defines: Mapping[str, Define] | None = None) -> ProgramSpec:
        """A program that reads the scene, with the macros that such programs need."""
        return ProgramSpec(path, {**SCENE_MACROS, **self._tree_defines, **(defines or {})})

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
