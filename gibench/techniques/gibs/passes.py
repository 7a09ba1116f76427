"""The launches of a GIBS frame after sorting: rays, camera, application, life."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gibench.device import Buffer, Device, Program
from gibench.scene.model import Scene
from gibench.techniques.gibs.grid import SurfelGrid
from gibench.techniques.gibs.settings import FLOORED, GibsSettings
from gibench.techniques.gibs.surfels import Surfels
from gibench.techniques.launching import prepare_launch
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.macros import tiled_pixels
from gibench.techniques.technique import Argument, Launch, LocalMemory, Work

PLACEMENT_TILE = 16  # kernels_cl/gibs/life.cl
COVERAGE_STEPS = 4096
_WIDTHS = (1, 2, 4, 8, 16)


@dataclass(frozen=True)
class CameraView:
    """What the camera sees, per pixel; see kernels_cl/gibs/application.cl.

    Attributes:
        position: (h * w, 4) float32 position, m, and the object's number.
        normal: (h * w, 4) float32.
        albedo: (h * w, 4) float32.
        direct: (h * w, 3) float32 emission, direct light and environment, W/m2/sr.
        indirect: (h * w, 4) float32 indirect irradiance, W/m2, and coverage.
        least: (tiles,) uint32 least coverage and its pixel.
        object_of: (triangles,) int32 object numbers.
    """

    position: Buffer
    normal: Buffer
    albedo: Buffer
    direct: Buffer
    indirect: Buffer
    least: Buffer
    object_of: Buffer

    @staticmethod
    def create(device: Device, scene: Scene, width: int, height: int) -> CameraView:
        """Black images.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        pixels = width * height

        def image(name: str, channels: int) -> Buffer:
            return device.empty(f"gbuffer_{name}", (pixels, channels), np.float32)

        return CameraView(
            position=image("position", 4),
            normal=image("normal", 4),
            albedo=image("albedo", 4),
            direct=image("direct", 3),
            indirect=image("indirect", 4),
            least=device.empty("tile_least", tiles_of(width, height), np.uint32),
            object_of=device.upload("triangle_objects", scene.object_numbers()),
        )

    @staticmethod
    def bytes_of(triangles: int, width: int, height: int) -> int:
        """Bytes it takes, in closed form."""
        return 4 * (19 * width * height + tiles_of(width, height) + triangles)


def tiles_of(width: int, height: int) -> int:
    """Placement tiles of an image."""
    return -(-width // PLACEMENT_TILE) * -(-height // PLACEMENT_TILE)


@dataclass(frozen=True)
class FramePasses:
    """Builds the launches of every pass but the sorting.

    Attributes:
        scene: the scene on the device.
        settings: as set.
        grid: the grid, sorted before.
        surfels: all about them.
        view: what the camera sees.
        alive: tells how many surfels are alive as the frame begins.
        rays: tells how many rays the frame traces.
        workgroup_size: work-items per group.
        far_distance: m, where distance speaks fully for recycling.
    """

    scene: FrameScene
    settings: GibsSettings
    grid: SurfelGrid
    surfels: Surfels
    view: CameraView
    alive: Callable[[], int]
    rays: Callable[[], int]
    workgroup_size: int
    far_distance: float

    @property
    def defines(self) -> Mapping[str, Any]:
        """Macros of the kernels that look surfels up."""
        width = self.scene.device.vector_width
        return {
            **self.grid.defines,
            "VEC": width if width in _WIDTHS else 4,
            "DEPTH": self.settings.depth_moments,
            "GUIDING": self.settings.ray_guiding,
            "FLOORED": self.settings.estimator == FLOORED,
        }

    @property
    def gather_args(self) -> tuple[Argument, ...]:
        """GATHER_PARAMS of kernels_cl/gibs/gather.cl; ``packed`` is not read as published."""
        g, grid = self.surfels.geometry, self.grid
        packed = grid.ids if grid.packed is None else grid.packed
        return (
            grid.table,
            *grid.list_bounds,
            grid.ids,
            packed,
            g.world_position,
            g.world_normal,
            g.radii,
            g.mean,
            self.surfels.moments,
        )

    @property
    def pixel_items(self) -> int:
        """Work-items that visit all pixels in tiled order."""
        return tiled_pixels(self.scene.width, self.scene.height)

    def alive_or_placed(self) -> int:
        """The most surfels there can be after placement."""
        new = tiles_of(self.scene.width, self.scene.height)
        return min(self.alive() + new, self.settings.surfels)

    def irradiance(self) -> list[Launch]:
        """Give each surfel its rays, trace them, add what they find to the surfel's irradiance."""
        s, g = self.surfels, self.surfels.geometry
        program = self._program("irradiance")

        def launch(kernel: str, *args: Argument) -> Launch:
            return Launch(program, kernel, args, items=self.alive)

        rays = (s.ray_first, s.ray_light, s.ray_choice)
        learnt = (s.estimator, s.moments, g.nearest, s.guides)
        return [
            launch("request_rays", g.frame, g.alive_ids, s.estimator, s.seen, s.marks),
            # The first word of `frame` is the number of surfels alive.
            *s.scan.launches(s.marks, g.frame, s.before, self.alive),
            launch("assign_rays", g.frame, s.before, s.ray_first, s.ray_owner),
            self._trace(program),
            launch("update_surfels", g.frame, g.alive_ids, *rays, g.radii, *learnt),
        ]

    def _trace(self, program: Program) -> Launch:
        s, g = self.surfels, self.surfels.geometry
        args = (
            g.frame,
            g.alive_ids,
            s.births,
            s.ray_first,
            s.ray_owner,
            s.estimator,
            s.guides,
            *self.scene.bvh_args,
            *self.scene.surface_args,
            *self.scene.light_args,
            *self.scene.environment_args,
            *self.gather_args,
            s.ray_light,
            s.ray_choice,
        )
        return Launch(program, "trace_rays", args, items=self.rays)

    def with_shadow_rays(self, work: Work, workgroup_size: int) -> Work:
        """The irradiance pass's work with the shadow rays where its rays hit. Surfels recycled at
        the frame's end have left their rays to those that moved to their places in the list.
        """
        device, light = self.scene.device, self.surfels.ray_light
        program = self.scene.program("gibs/irradiance.cl", {**self.defines, "COUNT_RAYS": 1})
        prepare_launch(device, self._trace(program), workgroup_size).enqueue(device.queue)
        shadow_rays = device.read(light)[: self.rays(), 0].sum(dtype=np.float64)
        return replace(work, rays=work.rays + float(shadow_rays))

    def gbuffer(self) -> list[Launch]:
        """Primary rays and direct light."""
        v = self.view
        args = (
            *self.scene.bvh_args,
            *self.scene.surface_args,
            *self.scene.light_args,
            *self.scene.environment_args,
            *self.scene.camera_args,
            v.object_of,
            v.position,
            v.normal,
            v.albedo,
            v.direct,
        )
        return [Launch(self._program("application"), "gbuffer", args, items=self.pixel_items)]

    def application(self) -> list[Launch]:
        """The surfels' light on every pixel, and their coverage of it."""
        v = self.view
        args = (
            self.surfels.geometry.frame,
            *self.gather_args,
            *self.scene.camera_args[1:],
            v.position,
            v.normal,
            v.albedo,
            v.direct,
            self.surfels.seen,
            v.indirect,
            self.scene.image,
        )
        apply = Launch(self._program("application"), "application", args, items=self.pixel_items)
        return [*self.grid.refresh_irradiance(), apply]

    def gather_points(self, position: Buffer, normal: Buffer, out: Buffer) -> Launch:
        """Indirect irradiance and coverage (n, 4) at points (n, 3)."""
        count = position.shape[0]
        args = (*self.gather_args, position, normal, np.int32(count), out)
        return Launch(self._program("application"), "gather_points", args, items=count)

    def coverage(self) -> list[Launch]:
        """The least covered pixel of every tile."""
        v = self.view
        args = (v.position, v.indirect, *self.scene.camera_args[1:], v.least)
        tiles = tiles_of(self.scene.width, self.scene.height)
        return [Launch(self._program("life"), "coverage", args, groups=tiles)]

    def placement(self) -> list[Launch]:
        """New surfels where coverage is low."""
        s, g, v = self.surfels, self.surfels.geometry, self.view
        threshold = round(self.settings.placement_threshold * COVERAGE_STEPS)
        chance = min(round(self.settings.placement_chance * 2**32), 2**32 - 1)
        args = (
            g.frame,
            v.least,
            *self.scene.camera_args[1:],
            np.uint32(min(threshold, 2**24 - 1)),
            np.uint32(chance),
            v.position,
            v.normal,
            g.transforms,
            s.counters,
            s.free_ids,
            g.alive_ids,
            g.object_ids,
            g.local_position,
            g.local_normal,
            s.births,
            s.seen,
            s.estimator,
            s.moments,
            g.nearest,
            s.guides,
            LocalMemory(8 * self.workgroup_size),
        )
        return [Launch(self._program("life"), "placement", args, groups=1)]

    def recycling(self) -> list[Launch]:
        """Surfels that are no longer needed give their IDs back."""
        s, g, settings = self.surfels, self.surfels.geometry, self.settings
        program = self._program("life")

        def launch(kernel: str, *args: Argument) -> Launch:
            return Launch(program, kernel, args, items=self.alive_or_placed)

        heuristic = (
            np.float32(settings.recycle_chance),
            np.float32(settings.recycle_unseen_frames),
            np.float32(self.far_distance),
            np.float32(settings.recycle_pressure_from),
            np.float32(settings.recycle_coverage),
        )
        choose = (g.alive_ids, s.counters, s.seen, s.births, *heuristic, s.marks)
        move = (s.counters, s.marks, s.before, s.survivors, s.free_ids, g.object_ids)
        return [
            launch("recycling_choose", g.frame, *self.gather_args, *choose),
            # The first counter is the number of surfels alive.
            *s.scan.launches(s.marks, s.counters, s.before, self.alive_or_placed),
            launch("recycling_move", g.alive_ids, *move),
            launch("recycling_commit", s.survivors, g.alive_ids, s.counters),
        ]

    def _program(self, name: str) -> Program:
        return self.scene.program(f"gibs/{name}.cl", self.defines)
