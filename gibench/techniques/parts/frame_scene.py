"""The scene on the device: what the passes of every technique share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gibench.device import Argument, Buffer, BufferSpec, Device, ProgramSpec, integer, reads
from gibench.device.build import Define
from gibench.rays.bvh import Bvh, build_bvh
from gibench.rays.device_bvh import DeviceBvh
from gibench.rays.offset import ray_scale
from gibench.scene.model import Camera, Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.camera_path import Flight
from gibench.techniques.clock import Clock
from gibench.techniques.job import Known, Shot, World
from gibench.techniques.parts.camera_table import CAMERA_FLOATS, camera_table
from gibench.techniques.parts.light_table import light_table
from gibench.techniques.parts.macros import LIGHT_FLOATS, SCENE_MACROS
from gibench.techniques.parts.material_table import material_table
from gibench.techniques.parts.moving_geometry import (
    TRANSFORM_FLOATS,
    MovingGeometry,
    transform_table,
)
from gibench.techniques.parts.surfaces import Surfaces
from gibench.techniques.technique import Pass


def transforms_buffer(scene: Scene) -> BufferSpec:
    """Of a transform for every object, moving or not."""
    objects = len(np.unique(scene.object_ids))
    return BufferSpec.of("object_transforms", (objects, TRANSFORM_FLOATS), np.float32)


def with_own_materials(scene: Scene, motion: MovingObjects | None) -> Scene:
    """``scene`` with a material of its own for each surface whose colours change, as in frame 0."""
    if motion is None or motion.materials is None:
        return scene
    return motion.materials.scene_in(scene, motion.frame_of(0))


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
        motion: of its objects and materials; None where all rest.
        clock: tells which of the scene's frames a frame shows; None where it is that of its number.

    Attributes:
        surfaces: geometry, materials, textures; all that kernels read of a surface.
        camera: the view of the frame last begun.
        frame: the scene's frame that was last begun; 0 before any.

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
        clock: Clock | None = None,
    ) -> None:
        self.device, self.scene = device, scene
        self._clock = clock or Clock()
        self.camera = self._resting = camera
        self.frame = 0
        self._flight, self._motion = flight, motion
        self.width, self.height = width, height
        self._ray_scale = ray_scale(scene)
        self.bvh = build_bvh(scene.corners) if bvh is None else bvh
        cutouts = scene.cutouts
        packed = None if cutouts is None else cutouts.packed(len(scene.triangles))
        tree = DeviceBvh.upload(device, self.bvh, cutouts=packed)
        self.bvh_args, self._tree_defines = tree.args, tree.defines
        self.surfaces = Surfaces.upload(device, with_own_materials(scene, motion))
        rows, columns = scene.environment.pixels.shape[:2]
        held = device.allocate(
            self._views(scene, width, height),
            {
                "environment": scene.environment.pixels,
                "lights": light_table(scene.lights_at(0)),
                "camera": camera_table(camera, width, height),
            },
        )
        self.environment_args: tuple[Argument, ...] = (
            reads("environment", held["environment"]),
            integer("environment_width", columns),
            integer("environment_height", rows),
        )
        self._lights = held["lights"]
        self.light_args: tuple[Argument, ...] = (
            reads("lights", self._lights),
            integer("light_count", len(scene.lights)),
        )
        self._view = held["camera"]
        self.size_args: tuple[Argument, ...] = (
            integer("width", width),
            integer("height", height),
        )
        self.camera_args: tuple[Argument, ...] = (reads("camera", self._view), *self.size_args)
        self.image = held["image"]
        self._transforms: Buffer | None = None
        self._moving: MovingGeometry | None = None
        if motion is not None and motion.moves:
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
            clock=world.clock,
        )

    @property
    def surface_args(self) -> tuple[Argument, ...]:
        """The surfaces in the order of SURFACE_PARAMS."""
        return self.surfaces.args

    def program(self, path: str, defines: Mapping[str, Define] | None = None) -> ProgramSpec:
        """A program that reads the scene, with the macros that such programs need."""
        known: dict[str, Define] = {**SCENE_MACROS, **self._tree_defines, **self.surfaces.defines}
        known["RAY_SCALE"] = self._ray_scale
        return ProgramSpec(path, {**known, **(defines or {})})

    @staticmethod
    def buffers(
        scene: Scene,
        width: int,
        height: int,
        bvh: Bvh | None = None,
        motion: MovingObjects | None = None,
        transforms: bool = False,
    ) -> list[BufferSpec]:
        """The buffers it takes.

        Args:
            scene: the scene.
            width: of the image, pixels.
            height: of the image, pixels.
            bvh: its tree; without it they are a lower bound.
            motion: what moves and changes in it.
            transforms: its objects' transforms are asked for, whether anything moves or not.
        """
        triangles, words = len(scene.triangles), 0
        if scene.cutouts is not None:
            words = scene.cutouts.packed_words(triangles)
        if bvh is None:
            tree = DeviceBvh.least_buffers(triangles, cutout_words=words)
        else:
            tree = DeviceBvh.buffers(bvh, cutout_words=words)
        found = [
            *tree,
            *Surfaces.buffers(with_own_materials(scene, motion)),
            *FrameScene._views(scene, width, height),
        ]
        moves = motion is not None and motion.moves
        if transforms or moves:
            found.append(transforms_buffer(scene))
        if motion is not None and moves:
            found += MovingGeometry.buffers(scene, motion, bvh)
        return found

    @staticmethod
    def declared(known: Known, transforms: bool = False) -> list[BufferSpec]:
        """The buffers of the job's scene and image."""
        shot = known.job.shot
        return FrameScene.buffers(
            known.scene,
            shot.width,
            shot.height,
            bvh=known.bvh,
            motion=known.motion,
            transforms=transforms,
        )

    @staticmethod
    def _views(scene: Scene, width: int, height: int) -> list[BufferSpec]:
        """What lights it, and how it is seen."""
        of, f32 = BufferSpec.of, np.float32
        return [
            BufferSpec.like("environment", scene.environment.pixels),
            of("lights", (len(scene.lights), LIGHT_FLOATS), f32),
            of("camera", CAMERA_FLOATS, f32),
            of("image", (height, width, 3), f32),
        ]

    def object_transforms(self) -> Buffer:
        """Every object's transform from object space to the world in the frame last begun, 3 x 4
        row-major, (objects, 12) float32, in the order of :meth:`Scene.object_numbers`; on the
        device from the first time it is asked for.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        if self._transforms is None:
            spec = transforms_buffer(self.scene)
            at_rest = np.tile(np.eye(3, 4, dtype=np.float32), (spec.shape[0], 1, 1))
            self._transforms = self.device.create(spec, transform_table(at_rest))
        return self._transforms

    def passes(self) -> list[Pass]:
        """The passes that move its objects, which come before all others; none at rest."""
        return [] if self._moving is None else self._moving.passes()

    def begin_frame(self, frame: int) -> None:
        """Move lights and camera to where they are in what ``frame`` shows (:class:`Clock`), and
        tell where the objects are and what colours materials have.
        """
        self.frame = frame = self._clock.shows(frame)
        self.device.write(self._lights, light_table(self.scene.lights_at(frame)))
        if self._moving is not None and self._motion is not None:
            self._moving.move(self._motion.transforms_in(frame))
        if self._motion is not None and (changing := self._motion.materials) is not None:
            now = changing.materials_in(self.scene, self._motion.frame_of(frame))
            self.device.write(self.surfaces.materials, material_table(now))
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
