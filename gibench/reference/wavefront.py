"""Path tracing in waves: OpenCL kernels shade, Embree traces, queue after queue.

The integrals are those of Kajiya 1986, "The Rendering Equation", for diffuse surfaces, with
next-event estimation at every vertex and multiple importance sampling (Veach 1997, chapter 9).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gibench.device import Argument, integer, reads, unsigned, updates, writes
from gibench.rays.tracer import RayTracer
from gibench.reference.host_cl import HostProgram, host_program
from gibench.reference.packed import PackedScene
from gibench.reference.queues import Queues, Vertices
from gibench.reference.starts import CameraStart, RayStart, ReceiverStart

# Paths and shadow rays of one wave: enough that the short queues at a wave's end cost little,
# few enough that the queues stay under some 300 MB.
WAVE_PATHS = 1 << 20
_WAVE_SHADOW_RAYS = 1 << 21
# "Any number of bounces"; Russian roulette ends every path long before.
UNLIMITED = 0x7FFFFFFF

FROM_VERTEX, CAMERA_REFLECTED, CAMERA_ALL = 0, 1, 2


@dataclass
class Work:
    """What the tracing has cost so far.

    Attributes:
        rays: rays traced, shadow rays included.
        ray_seconds: time in the ray tracer.
        seconds: time altogether.
    """

    rays: int = 0
    ray_seconds: float = 0.0
    seconds: float = 0.0


def wave_capacity(scene: PackedScene, wave_paths: int = WAVE_PATHS) -> int:
    """Paths that one wave takes at most."""
    return max(1, min(wave_paths, _WAVE_SHADOW_RAYS // max(1, _slots(scene))))


def owners_at_once(capacity: int, owners: int, samples: int) -> int:
    """Owners whose ``samples`` paths each make a wave."""
    return max(1, min(capacity // samples, owners))


def _slots(scene: PackedScene) -> int:
    """Shadow rays of a path's vertex."""
    sampled = int(scene.environment_table.sampled)
    return len(scene.lights) + (len(scene.emitters.triangle) > 0) + sampled


class Wavefront:
    """Traces waves of paths through one scene.

    Args:
        scene: packed for one frame.
        tracer: of the same triangles.
        start: where paths start.
        bounces: most reflections between a light and the surface whose irradiance is meant; None
            for any number.
        wave_paths: most paths at once.
        program: the kernels, where not those of the first CPU device.
    """

    def __init__(
        self,
        scene: PackedScene,
        tracer: RayTracer,
        start: ReceiverStart | CameraStart | RayStart,
        bounces: int | None,
        wave_paths: int = WAVE_PATHS,
        program: HostProgram | None = None,
    ) -> None:
        self.program: HostProgram = program or host_program(
            cutouts=scene.cutouts is not None,
            glow=scene.emitters.glow is not None,
            normal_maps=scene.normal_maps is not None,
            scale=scene.scale,
        )
        self.tracer = tracer
        self.start = start
        self.last_vertex = UNLIMITED if bounces is None else bounces
        self.work = Work()
        self._queues: Queues | None = None
        share = self.program.share
        self._delta = len(scene.lights)
        self._emitters = len(scene.emitters.triangle)
        self._sampled = int(scene.environment_table.sampled)
        self._has_area_light = scene.has_area_light
        self._slots = _slots(scene)
        self.capacity = wave_capacity(scene, wave_paths)
        height, width = scene.environment.shape[:2]
        table = scene.environment_table
        self._triangles = reads("triangles", share(scene.triangles))
        self._materials = reads("materials", share(scene.materials))
        self._textures = (
            reads("texture_pixels", share(scene.texture_pixels)),
            reads("images", share(scene.images)),
        )
        self._environment = (
            integer("width", width),
            integer("height", height),
            reads("environment", share(scene.environment)),
            reads("environment_density_", share(table.density)),
        )
        self._light_tables = (
            reads("lights", share(scene.lights)),
            unsigned("emitter_count", self._emitters),
            reads("emitters", share(scene.emitters.triangle)),
            reads("emitter_table", share(scene.emitters.table)),
            *self._environment,
            reads("environment_rows", share(table.rows)),
            reads("environment_columns", share(table.columns)),
            reads("environment_edges", share(table.edges)),
        )
        self._cutouts: tuple[Argument, ...] = ()
        if scene.cutouts is not None:
            self._cutouts = (reads("cutouts", share(scene.cutouts)),)
        self._glow: tuple[Argument, ...] = ()
        self._pieces: tuple[Argument, ...] = ()
        if scene.emitters.glow is not None:
            self._glow = (reads("glow", share(scene.emitters.glow)),)
            self._pieces = (reads("emitter_pieces", share(scene.emitters.pieces)),)
        self._normal_maps: tuple[Argument, ...] = ()
        if scene.normal_maps is not None:
            self._normal_maps = (reads("normal_maps", share(scene.normal_maps)),)
        self._start: tuple[Argument, ...]
        if isinstance(start, ReceiverStart):
            f = start.fragments
            self._start = (
                reads("fragment_start", share(f.start)),
                reads("fragment_table", share(f.table)),
                reads("fragment_corners", share(f.corners)),
                reads("fragment_triangle", share(f.triangle)),
            )
        elif isinstance(start, CameraStart):
            self._start = (reads("camera", share(start.plane.astype(np.float32))),)

    def round(
        self, samples: int, seed: int, advance: Callable[[int], None] = lambda paths: None
    ) -> npt.NDArray[np.float64]:
        """One independent randomisation of ``samples`` paths for every owner.

        Args:
            samples: paths per owner.
            seed: of this randomisation, 32 bits.
            advance: told the number of paths done.

        Returns:
            (owners, 3) mean of what the paths collected.
        """
        began = time.perf_counter()
        owners = self.start.owners
        mean = np.empty((owners, 3), np.float64)
        at_once = owners_at_once(self.capacity, owners, samples)
        for first in range(0, owners, at_once):
            count = min(at_once, owners - first)
            mean[first : first + count] = self._part(first, count, at_once, samples, seed)
            advance(count * samples)
        self.work.seconds += time.perf_counter() - began
        return mean

    def tile(self, first: int, samples: int, seed: int) -> npt.NDArray[np.float64]:
        """Of :meth:`round` the owners from ``first`` on that one wave traces."""
        began = time.perf_counter()
        at_once = owners_at_once(self.capacity, self.start.owners, samples)
        count = min(at_once, self.start.owners - first)
        mean = self._part(first, count, at_once, samples, seed).astype(np.float64)
        self.work.seconds += time.perf_counter() - began
        return mean

    def _part(
        self, first: int, count: int, at_once: int, samples: int, seed: int
    ) -> npt.NDArray[np.float32]:
        # Kept between rounds: fresh memory costs as much to touch as a kernel to run.
        if self._queues is None or self._queues.paths < at_once * samples:
            self._queues = Queues(self.program, at_once * samples, self._slots)
        self._wave(self._queues, first, count, samples, seed)
        means: npt.NDArray[np.float32] = self._queues.mean.array[:count]
        return means

    def _wave(self, q: Queues, first: int, owners: int, samples: int, seed: int) -> None:
        run, count = self.program.run, owners * samples
        paths = (unsigned("first", first), unsigned("samples", samples))
        which = (*paths, unsigned("round_seed", seed))
        at, after = q.vertices
        vertex, kind = 0, FROM_VERTEX
        path_state = (writes("throughput", q.throughput), writes("collected", q.collected))
        number = unsigned("count", count)
        numbers = (q.stride, updates("drawn", q.drawn))
        run("draw_starts", -(-count // self.program.lanes), number, *which, *numbers)
        if isinstance(self.start, ReceiverStart):
            run(
                "start_at_receivers",
                count,
                number,
                *paths,
                self._triangles,
                *self._start,
                *q.drawn_before,
                *path_state,
                *at.reached,
                *self._normal_maps,
            )
            self._go_on(q, at, count, vertex, which)
        elif isinstance(self.start, RayStart):
            rays = slice(first, first + count)
            q.throughput.array[:count], q.collected.array[:count] = 1.0, 0.0
            at.origin.array[:count] = self.start.origins[rays]
            at.direction.array[:count] = self.start.directions[rays]
            at.path.array[:count], at.density.array[:count] = np.arange(count), 1.0
            kind = CAMERA_ALL
        else:
            run(
                "start_at_camera",
                count,
                number,
                *paths,
                unsigned("width", self.start.width),
                unsigned("height", self.start.height),
                *self._start,
                *q.drawn_before,
                *path_state,
                writes("origin", at.origin),
                writes("direction", at.direction),
                writes("path", at.path),
                writes("density", at.density),
            )
            kind = CAMERA_REFLECTED if self.start.indirect_only else CAMERA_ALL
        self.program.queue.finish()
        while count:
            if not kind:
                self._connect(q, at, count, vertex)
                if vertex >= self.last_vertex and not self._has_area_light:
                    break
                vertex += 1
            plain = isinstance(self.start, CameraStart) and self.start.plain and vertex == 0
            count = self._follow(q, at, after, count, vertex, kind, plain)
            if count:
                self._go_on(q, after, count, vertex, which)
            kind = FROM_VERTEX
            at, after = after, at
        run(
            "average",
            owners,
            unsigned("owners", owners),
            unsigned("samples", samples),
            reads("collected", q.collected),
            writes("mean", q.mean),
        )
        self.program.queue.finish()

    def _go_on(
        self, q: Queues, at: Vertices, count: int, vertex: int, which: tuple[Argument, ...]
    ) -> None:
        """Directions for the rays that leave ``at``, and the numbers drawn ahead there."""
        choose = (1 if self._emitters else 0) + (2 if self._sampled else 0)
        self.program.run(
            "scatter",
            -(-count // self.program.lanes),
            unsigned("count", count),
            unsigned("vertex", vertex),
            unsigned("choose", choose),
            *which,
            reads("path", at.path),
            reads("shading", at.shading),
            reads("geometric", at.geometric),
            writes("direction", at.direction),
            writes("density", at.density),
            q.stride,
            updates("drawn", q.drawn),
        )
        self.program.queue.finish()

    def _connect(self, q: Queues, at: Vertices, count: int, vertex: int) -> None:
        start = self.start
        direct = not isinstance(start, ReceiverStart)
        if isinstance(start, CameraStart):
            direct = not start.indirect_only
        first_light = 0 if vertex > 0 or direct else self._delta
        slots = self._slots - first_light
        if not slots:
            return
        q.counter.array[0] = 0
        self.program.run(
            "connect",
            count * slots,
            unsigned("count", count),
            unsigned("slots", slots),
            unsigned("first_light", first_light),
            unsigned("delta_lights", self._delta),
            self._triangles,
            self._materials,
            *self._light_tables,
            *q.drawn_before,
            reads("throughput", q.throughput),
            reads("origin", at.origin),
            reads("shading", at.shading),
            reads("geometric", at.geometric),
            reads("path", at.path),
            writes("ray_of", q.ray_of),
            writes("weight", q.weight),
            writes("ray_origin", q.shadow_origin),
            writes("ray_direction", q.shadow_direction),
            writes("ray_limit", q.shadow_limit),
            updates("rays", q.counter),
            *self._cutouts,
            *self._glow,
            *self._pieces,
        )
        self.program.queue.finish()
        rays = int(q.counter.array[0])
        if not rays:
            return
        began = time.perf_counter()
        q.blocked.array[:rays] = self.tracer.occluded(
            q.shadow_origin.array[:rays],
            q.shadow_direction.array[:rays],
            q.shadow_limit.array[:rays],
        )
        self._traced(rays, began)
        self.program.run(
            "resolve",
            count,
            unsigned("count", count),
            unsigned("slots", slots),
            reads("path", at.path),
            reads("ray_of", q.ray_of),
            reads("weight", q.weight),
            reads("blocked", q.blocked),
            updates("collected", q.collected),
        )

    def _follow(
        self,
        q: Queues,
        at: Vertices,
        after: Vertices,
        count: int,
        vertex: int,
        kind: int,
        plain: bool,
    ) -> int:
        self.program.queue.flush()
        began = time.perf_counter()
        hits = self.tracer.closest(at.origin.array[:count], at.direction.array[:count])
        self._traced(count, began)
        q.counter.array[0] = 0
        self.program.run(
            "shade",
            count,
            unsigned("count", count),
            unsigned("vertex", vertex),
            unsigned("last_vertex", self.last_vertex),
            unsigned("from_camera", kind),
            unsigned("plain", plain),
            self._triangles,
            self._materials,
            *self._textures,
            *self._environment,
            integer("environment_sampled", self._sampled),
            reads("hit_triangle", self.program.share(hits.triangle)),
            reads("hit_distance", self.program.share(hits.distance)),
            reads("hit_u", self.program.share(hits.u)),
            reads("hit_v", self.program.share(hits.v)),
            reads("ray_direction", at.direction),
            reads("ray_density", at.density),
            reads("ray_path", at.path),
            *q.drawn_before,
            updates("throughput", q.throughput),
            updates("collected", q.collected),
            *after.reached,
            updates("vertices", q.counter),
            *self._glow,
            *self._normal_maps,
        )
        self.program.queue.finish()
        return int(q.counter.array[0])

    def _traced(self, rays: int, began: float) -> None:
        self.work.rays += rays
        self.work.ray_seconds += time.perf_counter() - began
