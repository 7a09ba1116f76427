"""GIBS as a technique: the whole frame on one screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from gibench.device import Buffer, BufferSpec, Device, Launch, total_bytes
from gibench.errors import CannotRun
from gibench.scene.model import Camera
from gibench.techniques.gibs.camera_view import CameraView, tiles_of
from gibench.techniques.gibs.macros import (
    COUNT_ALIVE,
    COUNT_FREE,
    COUNT_PLACED,
    COUNT_RECYCLED,
    COVERAGE_STEPS,
)
from gibench.techniques.gibs.passes import FramePasses
from gibench.techniques.gibs.radii import grid_of, radii_of
from gibench.techniques.gibs.settings import GibsSettings
from gibench.techniques.gibs.surfels import Surfels, rays_in_frame
from gibench.techniques.gibs.work import FrameSizes, frame_work
from gibench.techniques.job import Job, Known, World
from gibench.techniques.parts.camera_pass import suits_packets
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.steady import Steady
from gibench.techniques.parts.surfel_grid import (
    NEIGHBOURS,
    SurfelGrid,
)
from gibench.techniques.parts.surfels import surfel_words
from gibench.techniques.registry import PUBLISHED
from gibench.techniques.technique import FloatArray, Pass, Work

REST_COVERED = 0.999
"""Share of the visible pixels that are covered as placement wants them: the last ones wait for a
chance that their tile has in every frame, and a thousandth of a picture is not seen."""
REST_GROWTH, REST_WINDOW = 0.005, 4
"""Relative growth of the surfels alive from one window of so many looks to the next that counts as
none: the passes' times go with them, and are known to 5 % at best."""


class Gibs:
    """Surfels placed where the camera looks, each gathering light over time; unless told not to,
    also where their rays hit a surface that none covers, which no camera may ever see.

    Two variants with the same result but for rounding, where ``placement`` is the same.
    ``published``: every surfel in its cell and
    all neighbours, wave-wise scan, every pixel works through all surfels of its cell. ``tuned``:
    surfels only in cells they reach, blocked scan, lists in ID order with the surfels' data beside
    them, worked through a vector at a time. ``tuned`` gives the same result bit for bit with the
    same seed; ``published`` sums in the order in which atomics happened to run.

    The host reads five counters back before each frame, when the queue is empty anyway, so that no
    more is dispatched than surfels are alive.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen.

    Raises:
        CannotRun: scene or surfels do not fit the device's profile.
    """

    name: ClassVar[str] = "gibs"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        settings: GibsSettings = job.settings
        self._job, self._world, self.settings, self.device = job, world, settings, device
        scene, size = world.scene, job.group_size
        published = job.variant == PUBLISHED
        self._refuse_too_many()
        grid = grid_of(scene, settings)
        self.scene = FrameScene.of(device, job.shot, world)
        self._by_rays = settings.by_rays(published)
        self.surfels = Surfels.create(
            device,
            settings,
            self.scene.object_transforms(),
            size,
            grid.cells if self._by_rays else 0,
        )
        entries = entries_of(settings, published)
        self.grid = SurfelGrid(
            device,
            grid,
            self.surfels.geometry,
            published,
            entries,
            settings.normal_stretch,
            size,
        )
        self.view = CameraView.create(device, scene, job.shot.width, job.shot.height)
        diagonal = float(np.linalg.norm(scene.bounds[1] - scene.bounds[0]))
        self._alive, self._rays, self._number = 0, 0, 0
        self._steady = Steady(REST_GROWTH, REST_WINDOW)
        self._passes = FramePasses(
            self.scene,
            settings,
            self.grid,
            self.surfels,
            self.view,
            lambda: self._alive,
            lambda: self._rays,
            size,
            settings.recycle_distance * diagonal,
            packets=not published and suits_packets(device),
        )
        self._receivers: tuple[Buffer, Buffer, Buffer] | None = None

    def passes(self) -> Sequence[Pass]:
        """The passes of a frame, in order. Before any frame no surfel is alive; what they do is
        counted in the frame last run.
        """
        p = self._passes
        work = frame_work(self._sizes())

        def alive() -> int:
            return self._alive

        launches: dict[str, Callable[[], list[Launch]]] = {
            "transform_and_count": lambda: self.grid.transform_and_count(alive),
            "prefix_sum": self.grid.prefix_sum,
            "finalise": lambda: self.grid.finalise(alive),
            "irradiance": p.irradiance,
            "application": p.application,
            "coverage": p.coverage,
            "placement": p.placement,
            "recycling": p.recycling,
        }

        def counted(name: str) -> Callable[[int], Work]:
            def told(size: int) -> Work:
                now = frame_work(self._counted_sizes())[name]
                return p.with_shadow_rays(now, size) if name == "irradiance" else now

            return told

        own = [Pass(name, build, work[name], counted(name)) for name, build in launches.items()]
        # Surfels gather their light before anything is looked at.
        first = list(launches).index("application")
        return [*own[:first], p.camera(), *own[first:]]

    def _sizes(self) -> FrameSizes:
        """What the work of the frame last begun depends on, as far as the host knows it."""
        return FrameSizes(
            alive=self._alive,
            rays=self._rays,
            pixels=self.scene.width * self.scene.height,
            tiles=tiles_of(self.scene.width, self.scene.height),
            cells=self.grid.grid.cells,
            neighbours=self.grid.published,
            depth=self.settings.depth_moments,
            guiding=self.settings.ray_guiding,
            by_rays=self._by_rays,
        )

    def _counted_sizes(self) -> FrameSizes:
        """The same of the frame last run, all of it, read from the device."""
        if not self._number:
            return self._sizes()
        coverage = self.coverage()
        return replace(
            self._sizes(),
            entries=self.grid.entered(),
            surface=int(np.count_nonzero(np.isfinite(coverage))),
            covered=int(np.count_nonzero(coverage > 0)),
            placed=int(self.device.read(self.surfels.counters)[COUNT_PLACED]),
        )

    def begin_frame(self, frame: int) -> None:
        """Move lights, camera and objects, and tell the device what the frame is."""
        self.scene.begin_frame(frame)
        camera = self.scene.camera
        self.device.write(self.grid.table, self.grid.grid.table(camera.position))
        self._alive = int(self.device.read(self.surfels.counters)[COUNT_ALIVE])
        self._rays = rays_in_frame(self.settings, self._alive)
        self._number += 1
        self.device.write(self.surfels.geometry.frame, self._frame_words(camera))

    def look_from(self, camera: Camera) -> None:
        """See the scene from ``camera`` wherever there is no flight."""
        self.scene.look_from(camera)

    def images(self) -> dict[str, FloatArray]:
        """The last frame, its direct and its indirect part, (h, w, 3) W/m2/sr, and the surfels'
        coverage of every pixel, as grey: white is covered thrice.
        """
        shape = (self.scene.height, self.scene.width, -1)
        frame = self.device.read(self.scene.image)
        direct = self.device.read(self.view.direct).reshape(shape)
        covered = self.device.read(self.view.indirect).reshape(shape)[:, :, 3:]
        return {
            "frame": frame,
            "direct only": direct,
            "indirect only": frame - direct,
            "coverage": np.repeat(covered / 3, 3, axis=2),
        }

    def coverage(self) -> FloatArray:
        """Coverage (h, w) of the last frame's pixels; NaN where no surface's front shows."""
        shape = (self.scene.height, self.scene.width)
        covered = self.device.read(self.view.indirect)[:, 3].reshape(shape)
        shows = self.device.read(self.view.position)[:, 3].view(np.int32).reshape(shape) != 0
        return np.where(shows, covered, np.float32(np.nan))

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers, W/m2, by the last frame's surfels; black
        where none covers a receiver, as where the camera has never looked.
        """
        return self.gathered()[:, :3]

    def covered(self) -> npt.NDArray[np.bool_]:
        """Which receivers (n,) a surfel covers in the last frame."""
        return np.asarray(self.gathered()[:, 3] > 0)

    def gathered(self) -> FloatArray:
        """Indirect irradiance, W/m2, and coverage (n, 4) at the receivers."""
        if self._receivers is None:
            receivers = self._world.lightmap.receivers
            self._receivers = (
                self.device.upload("receiver_position", receivers.position),
                self.device.upload("receiver_normal", receivers.normal),
                self.device.empty("receiver_indirect", (len(receivers), 4), np.float32),
            )
        launch = self._passes.gather_points(*self._receivers)
        self.device.enqueue(launch, self._job.group_size)
        return self.device.read(self._receivers[2])

    def life(self) -> dict[str, int]:
        """Surfels alive, free IDs, and how many the last frame placed and recycled; entries
        that found no room in the grid's lists.
        """
        counters = self.device.read(self.surfels.counters)
        return {
            "alive": int(counters[COUNT_ALIVE]),
            "free": int(counters[COUNT_FREE]),
            "placed": int(counters[COUNT_PLACED]),
            "recycled": int(counters[COUNT_RECYCLED]),
            "dropped": self.grid.dropped(),
        }

    def at_rest(self) -> bool:
        """Whether it has filled what the camera sees: the surfels alive no longer grow
        (``REST_GROWTH``), and of the visible pixels ``REST_COVERED`` are covered up to
        ``placement_threshold``, at which nothing further is placed (Ekberg 2022, section 3.1.1).
        Where there are too few surfels for that, every ID must be taken but those that the last
        frame took back.

        It says nothing of light: a surfel's own, or what comes from where no camera looks.
        """
        life, coverage = self.life(), self.coverage()
        steady = self._steady.takes(life["alive"])
        steps = np.rint(coverage[np.isfinite(coverage)] * np.float32(COVERAGE_STEPS))
        wanted = round(self.settings.placement_threshold * COVERAGE_STEPS)
        missing = int(np.count_nonzero(steps < wanted))
        covered = missing <= (1 - REST_COVERED) * steps.size
        used_up = life["free"] <= life["recycled"]
        return steady and (covered or used_up)

    def counts(self) -> dict[str, int]:
        """Surfels alive now, room for them, and the receivers."""
        return {
            "surfels": self.life()["alive"],
            "surfel_capacity": self.settings.surfels,
            "receivers": len(self._world.lightmap.receivers),
        }

    def _frame_words(self, camera: Camera) -> npt.NDArray[np.uint32]:
        """What kernels_cl/gibs/frame.cl reads, (FRAME_WORDS,)."""
        radii = radii_of(self._world.scene, camera, self.settings)
        at = camera.position
        words = surfel_words(self._alive, at, radii.angle, radii.least, radii.most)
        own = [self._number, self._rays, self._job.seed & 0xFFFFFFFF]
        return np.concatenate([words, np.array(own, np.uint32)])

    def _refuse_too_many(self) -> None:
        """Refuse more surfels than the profile's budget holds, before anything is allocated."""
        memory = self.device.memory
        budget = memory.profile.memory_budget_bytes - memory.total_bytes
        world = self._world
        receivers = len(world.lightmap.receivers)
        needed = total_bytes(buffers(Known(self._job, world.scene, receivers, motion=world.motion)))
        if needed > budget:
            raise CannotRun(
                f"{self.settings.surfels:,} surfels and the scene take {needed:,} bytes; "
                f"{budget:,} are left of profile {memory.profile.name}'s budget",
                mend="lower --set gibs.surfels",
            )


def entries_of(settings: GibsSettings, published: bool) -> int:
    """Room in the grid's lists."""
    return settings.surfels * (NEIGHBOURS if published else settings.entries_per_surfel)


def buffers(known: Known) -> list[BufferSpec]:
    """Scene, surfels, grid and camera view; receivers come when they are asked for."""
    job, triangles = known.job, len(known.scene.triangles)
    settings: GibsSettings = job.settings
    published = job.variant == PUBLISHED
    shape = grid_of(known.scene, settings)
    grid = SurfelGrid.buffers(
        shape,
        published,
        entries_of(settings, published),
        layout=known.layout,
        simd_width=job.profile.simd_width,
        workgroup_size=job.group_size,
    )
    return [
        *FrameScene.declared(known, transforms=True),
        *Surfels.buffers(
            settings, job.group_size, shape.cells if settings.by_rays(published) else 0
        ),
        *grid,
        *CameraView.buffers(triangles, job.shot.width, job.shot.height),
    ]
