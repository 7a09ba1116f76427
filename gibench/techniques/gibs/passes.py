"""The launches of a GIBS frame after sorting: rays, camera, application, life."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gibench.device import (
    Argument,
    Buffer,
    Launch,
    ProgramSpec,
    count_rays,
    integer,
    local,
    reads,
    scalar,
    updates,
    writes,
)
from gibench.techniques.gibs.camera_view import CameraView, tiles_of
from gibench.techniques.gibs.macros import COVERAGE_MOST, COVERAGE_STEPS, GIBS_MACROS
from gibench.techniques.gibs.settings import FLOORED, GibsSettings
from gibench.techniques.gibs.surfels import Surfels
from gibench.techniques.parts.camera_pass import camera_pass
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.macros import tiled_pixels
from gibench.techniques.parts.surfel_grid import SurfelGrid
from gibench.techniques.technique import Pass, Work

_WIDTHS = (1, 2, 4, 8, 16)


def _chance(share: float) -> np.uint32:
    """A chance as the kernels compare it, of 2^32."""
    return np.uint32(min(round(share * 2**32), 2**32 - 1))


def _steps(coverage: float) -> int:
    """Coverage as the kernels compare it."""
    return min(round(coverage * COVERAGE_STEPS), COVERAGE_MOST)


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
        packets: whether the camera pass traces packets.
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
    packets: bool

    @property
    def defines(self) -> Mapping[str, Any]:
        """Macros of the kernels that look surfels up."""
        width = self.scene.device.vector_width
        return {
            **GIBS_MACROS,
            **self.grid.defines,
            "VEC": width if width in _WIDTHS else 4,
            "DEPTH": self.settings.depth_moments,
            "GUIDING": self.settings.ray_guiding,
            "FLOORED": self.settings.estimator == FLOORED,
            "BY_RAYS": self.surfels.cell_ray is not None,
        }

    @property
    def gather_args(self) -> tuple[Argument, ...]:
        """GATHER_PARAMS of kernels_cl/gibs/gather.cl; ``packed`` is not read as published."""
        g, grid = self.surfels.geometry, self.grid
        packed = grid.ids if grid.packed is None else grid.packed
        return (
            reads("grid", grid.table),
            reads("starts", grid.starts),
            reads("ends", grid.counts),
            reads("ids", grid.ids),
            reads("packed", packed),
            reads("world_position", g.world_position),
            reads("world_normal", g.world_normal),
            reads("radii", g.radii),
            reads("mean", g.mean),
            reads("moments", self.surfels.moments),
        )

    @property
    def pixel_items(self) -> int:
        """Work-items that visit all pixels in tiled order."""
        return tiled_pixels(self.scene.width, self.scene.height)

    def alive_or_placed(self) -> int:
        """The most surfels there can be after placement."""
        new = tiles_of(self.scene.width, self.scene.height)
        if self.surfels.cell_ray is not None:
            new += self.surfels.cell_ray.shape[0]
        return min(self.alive() + new, self.settings.surfels)

    def irradiance(self) -> list[Launch]:
        """Give each surfel its rays, trace them, add what they find to the surfel's irradiance."""
        s, g = self.surfels, self.surfels.geometry
        program = self._program("irradiance")

        def launch(kernel: str, *args: Argument) -> Launch:
            return Launch(program, kernel, args, items=self.alive)

        frame = reads("frame", g.frame)
        alive_ids = reads("alive_ids", g.alive_ids)
        return [
            launch(
                "request_rays",
                frame,
                alive_ids,
                reads("estimator", s.estimator),
                reads("seen", s.seen),
                writes("requests", s.marks),
            ),
            # The first word of `frame` is the number of surfels alive.
            *s.scan.launches(s.marks, g.frame, s.before, self.alive),
            launch(
                "assign_rays",
                frame,
                reads("before", s.before),
                writes("ray_first", s.ray_first),
                writes("ray_owner", s.ray_owner),
            ),
            self._trace(),
            launch(
                "update_surfels",
                frame,
                alive_ids,
                reads("ray_first", s.ray_first),
                reads("ray_light", s.ray_light),
                reads("ray_choice", s.ray_choice),
                reads("radii", g.radii),
                updates("estimator", s.estimator),
                updates("moments", s.moments),
                updates("nearest", g.nearest),
                updates("guides", s.guides),
            ),
        ]

    def _trace(self) -> Launch:
        s, g = self.surfels, self.surfels.geometry
        args = (
            reads("frame", g.frame),
            reads("alive_ids", g.alive_ids),
            reads("births", s.births),
            reads("ray_first", s.ray_first),
            reads("ray_owner", s.ray_owner),
            reads("estimator", s.estimator),
            reads("guides", s.guides),
            *self.scene.bvh_args,
            *self.scene.surface_args,
            *self.scene.light_args,
            *self.scene.environment_args,
            *self.gather_args,
            *self._bare_args(),
            writes("ray_light", s.ray_light),
            writes("ray_choice", s.ray_choice),
        )
        return Launch(self._program("irradiance"), "trace_rays", args, items=self.rays)

    def _bare_args(self) -> tuple[Argument, ...]:
        """BARE_PARAMS of kernels_cl/gibs/bare.cl."""
        s = self.surfels
        if s.ray_hit is None or s.cell_ray is None:
            return ()
        return (
            scalar("bare", np.uint32(_steps(self.settings.bare_threshold))),
            updates("ray_hit", s.ray_hit),
            updates("cell_ray", s.cell_ray),
        )

    def with_shadow_rays(self, work: Work, workgroup_size: int) -> Work:
        """The irradiance pass's work with the shadow rays where its rays hit. Surfels recycled at
        the frame's end have left their rays to those that moved to their places in the list.
        """
        traced = count_rays(self.scene.device, self._trace(), workgroup_size)
        return replace(work, rays=work.rays + traced.occluded)

    def camera(self) -> Pass:
        """Primary rays and direct light, and the surfaces that the surfels are placed on."""
        return camera_pass(self.scene, self.view, self.view.direct, self.packets)

    def application(self) -> list[Launch]:
        """The surfels' light on every pixel, and their coverage of it."""
        v = self.view
        args = (
            reads("frame", self.surfels.geometry.frame),
            *self.gather_args,
            *self.scene.size_args,
            reads("g_position", v.position),
            reads("g_normal", v.normal),
            reads("g_albedo", v.albedo),
            reads("direct", v.direct),
            updates("seen", self.surfels.seen),
            writes("indirect", v.indirect),
            writes("image", self.scene.image),
        )
        apply = Launch(self._program("application"), "application", args, items=self.pixel_items)
        return [*self.grid.refresh_irradiance(self.alive), apply]

    def gather_points(self, position: Buffer, normal: Buffer, out: Buffer) -> Launch:
        """Indirect irradiance and coverage (n, 4) at points (n, 3)."""
        count = position.shape[0]
        args = (
            *self.gather_args,
            reads("position", position),
            reads("normal", normal),
            integer("count", count),
            writes("indirect", out),
        )
        return Launch(self._program("application"), "gather_points", args, items=count)

    def coverage(self) -> list[Launch]:
        """The least covered pixel of every tile."""
        v = self.view
        args = (
            reads("g_position", v.position),
            reads("indirect", v.indirect),
            *self.scene.size_args,
            writes("least", v.least),
        )
        tiles = tiles_of(self.scene.width, self.scene.height)
        return [Launch(self._program("life"), "coverage", args, groups=tiles)]

    def placement(self) -> list[Launch]:
        """New surfels where coverage is low, in the image and where rays hit."""
        s, g, v = self.surfels, self.surfels.geometry, self.view
        seen = (
            reads("frame", g.frame),
            reads("least", v.least),
            *self.scene.size_args,
            scalar("threshold", np.uint32(_steps(self.settings.placement_threshold))),
            scalar("chance", _chance(self.settings.placement_chance)),
            reads("g_position", v.position),
            reads("g_normal", v.normal),
        )
        placed = (
            reads("transforms", g.transforms),
            updates("counters", s.counters),
            reads("free_ids", s.free_ids),
            updates("alive_ids", g.alive_ids),
            updates("object_ids", g.object_ids),
            updates("local_position", g.local_position),
            updates("local_normal", g.local_normal),
            updates("births", s.births),
            updates("seen", s.seen),
            updates("estimator", s.estimator),
            updates("moments", s.moments),
            updates("nearest", g.nearest),
            updates("guides", s.guides),
            local("partial", 8 * self.workgroup_size),
        )
        found = [Launch(self._program("life"), "placement", (*seen, *placed), groups=1)]
        if s.ray_hit is not None and s.cell_ray is not None:
            most = self.settings.recycle_pressure_from * self.settings.surfels
            bare = (
                reads("frame", g.frame),
                updates("cell_ray", s.cell_ray),
                reads("ray_hit", s.ray_hit),
                *self.scene.surfaces.shape_args,
                reads("object_of", v.object_of),
                scalar("chance", _chance(self.settings.bare_chance)),
                scalar("most_alive", np.uint32(int(most))),
            )
            found.append(
                Launch(self._program("life"), "placement_by_rays", (*bare, *placed), groups=1)
            )
        return found

    def recycling(self) -> list[Launch]:
        """Surfels that are no longer needed give their IDs back."""
        s, g, settings = self.surfels, self.surfels.geometry, self.settings
        program = self._program("life")

        def launch(kernel: str, *args: Argument) -> Launch:
            return Launch(program, kernel, args, items=self.alive_or_placed)

        heuristic = (
            scalar("chance", np.float32(settings.recycle_chance)),
            scalar("unseen_frames", np.float32(settings.recycle_unseen_frames)),
            scalar("far_distance", np.float32(self.far_distance)),
            scalar("pressure_from", np.float32(settings.recycle_pressure_from)),
            scalar("most_coverage", np.float32(settings.recycle_coverage)),
        )
        alive_ids = reads("alive_ids", g.alive_ids)
        return [
            launch(
                "recycling_choose",
                reads("frame", g.frame),
                *self.gather_args,
                alive_ids,
                reads("counters", s.counters),
                reads("seen", s.seen),
                reads("births", s.births),
                *heuristic,
                writes("keep", s.marks),
            ),
            # The first counter is the number of surfels alive.
            *s.scan.launches(s.marks, s.counters, s.before, self.alive_or_placed),
            launch(
                "recycling_move",
                alive_ids,
                updates("counters", s.counters),
                reads("keep", s.marks),
                reads("before", s.before),
                writes("survivors", s.survivors),
                updates("free_ids", s.free_ids),
                updates("object_ids", g.object_ids),
            ),
            launch(
                "recycling_commit",
                reads("survivors", s.survivors),
                updates("alive_ids", g.alive_ids),
                updates("counters", s.counters),
            ),
        ]

    def _program(self, name: str) -> ProgramSpec:
        return self.scene.program(f"gibs/{name}.cl", self.defines)
