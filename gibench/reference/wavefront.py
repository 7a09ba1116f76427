"""Path tracing in waves: OpenCL kernels shade, Embree traces, queue after queue.

The integrals are those of Kajiya 1986, "The Rendering Equation", for diffuse surfaces, with
next-event estimation at every vertex and multiple importance sampling (Veach 1997, chapter 9).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.rays.tracer import RayTracer
from gibench.reference.host_cl import HostProgram, Shared, host_program
from gibench.reference.packed import PackedFragments, PackedScene

# Paths and shadow rays of one wave: enough that the short queues at a wave's end cost little,
# few enough that the queues stay under some 300 MB.
WAVE_PATHS = 1 << 20
_WAVE_SHADOW_RAYS = 1 << 21
# "Any number of bounces"; Russian roulette ends every path long before.
UNLIMITED = 0x7FFFFFFF

_DRAWN = 5  # numbers drawn ahead for a vertex or a start
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


@dataclass(frozen=True)
class ReceiverStart:
    """Paths start on the receivers and estimate indirect irradiance over pi."""

    fragments: PackedFragments

    @property
    def owners(self) -> int:
        """Number of receivers."""
        return len(self.fragments.start) - 1


@dataclass(frozen=True)
class CameraStart:
    """Paths start at the camera and estimate radiance.

    Attributes:
        plane: (4, 3), see :func:`gibench.reference.camera.image_plane`.
        width: pixels.
        height: pixels.
        indirect_only: leave out emission seen directly and light straight from delta lights.
        plain: take albedo 1 at the visible surface: irradiance over pi.
    """

    plane: Doubles
    width: int
    height: int
    indirect_only: bool
    plain: bool

    @property
    def owners(self) -> int:
        """Number of pixels."""
        return self.width * self.height


class Wavefront:
    """Traces waves of paths through one scene.

    Args:
        scene: packed for one frame.
        tracer: of the same triangles.
        start: where paths start.
        bounces: most reflections between a light and the surface whose irradiance is meant; None
            for any number.
        wave_paths: most paths at once.
    """

    def __init__(
        self,
        scene: PackedScene,
        tracer: RayTracer,
        start: ReceiverStart | CameraStart,
        bounces: int | None,
        wave_paths: int = WAVE_PATHS,
    ) -> None:
        self.program: HostProgram = host_program()
        self.tracer = tracer
        self.start = start
        self.last_vertex = UNLIMITED if bounces is None else bounces
        self.work = Work()
        self._queues: _Queues | None = None
        share = self.program.share
        self._delta = len(scene.lights)
        self._emitters = len(scene.emitters.triangle)
        self._sampled = int(scene.environment_table.sampled)
        self._has_area_light = scene.has_area_light
        self._slots = self._delta + (self._emitters > 0) + self._sampled
        self.capacity = max(1, min(wave_paths, _WAVE_SHADOW_RAYS // max(1, self._slots)))
        height, width = scene.environment.shape[:2]
        table = scene.environment_table
        self._triangles = share(scene.triangles)
        self._materials = share(scene.materials)
        self._textures = (share(scene.texture_pixels), share(scene.images))
        self._environment = (np.int32(width), np.int32(height), share(scene.environment))
        self._density = share(table.density)
        self._light_tables: tuple[Any, ...] = (
            share(scene.lights),
            np.uint32(self._emitters),
            share(scene.emitters.triangle),
            share(scene.emitters.table),
            *self._environment,
            self._density,
            share(table.rows),
            share(table.columns),
            share(table.edges),
        )
        if isinstance(start, ReceiverStart):
            f = start.fragments
            self._start: tuple[Shared, ...] = tuple(
                share(a) for a in (f.start, f.table, f.corners, f.triangle)
            )
        else:
            self._start = (share(start.plane.astype(np.float32)),)

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
        at_once = max(1, min(self.capacity // samples, owners))
        # Kept between rounds: fresh memory costs as much to touch as a kernel to run.
        if self._queues is None or self._queues.paths < at_once * samples:
            self._queues = _Queues(self.program, at_once * samples, self._slots)
        queues = self._queues
        for first in range(0, owners, at_once):
            count = min(at_once, owners - first)
            self._wave(queues, first, count, samples, seed)
            mean[first : first + count] = queues.mean.array[:count]
            advance(count * samples)
        self.work.seconds += time.perf_counter() - began
        return mean

    def _wave(self, q: _Queues, first: int, owners: int, samples: int, seed: int) -> None:
        run, count = self.program.run, owners * samples
        which = (np.uint32(first), np.uint32(samples), np.uint32(seed))
        at, after = q.vertices
        vertex, kind = 0, FROM_VERTEX
        path_state = (q.throughput, q.collected)
        run("draw_starts", -(-count // self.program.lanes), np.uint32(count), *which, *q.drawn)
        if isinstance(self.start, ReceiverStart):
            run(
                "start_at_receivers",
                count,
                *(np.uint32(count), *which[:2], self._triangles, *self._start, *q.drawn),
                *(*path_state, *at.surface),
            )
            self._go_on(q, at, count, vertex, which)
        else:
            size = (np.uint32(self.start.width), np.uint32(self.start.height))
            run(
                "start_at_camera",
                count,
                *(np.uint32(count), *which[:2], *size, *self._start, *q.drawn),
                *(*path_state, *at.rays),
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
        run("average", owners, np.uint32(owners), np.uint32(samples), q.collected, q.mean)
        self.program.queue.finish()

    def _go_on(
        self, q: _Queues, at: _Vertices, count: int, vertex: int, which: tuple[Any, ...]
    ) -> None:
        """Directions for the rays that leave ``at``, and the numbers drawn ahead there."""
        choose = (1 if self._emitters else 0) + (2 if self._sampled else 0)
        self.program.run(
            "scatter",
            -(-count // self.program.lanes),
            *(np.uint32(n) for n in (count, vertex, choose)),
            *(*which, at.path, at.shading, at.geometric, at.direction, at.density, *q.drawn),
        )
        self.program.queue.finish()

    def _connect(self, q: _Queues, at: _Vertices, count: int, vertex: int) -> None:
        direct = isinstance(self.start, CameraStart) and not self.start.indirect_only
        first_light = 0 if vertex > 0 or direct else self._delta
        slots = self._slots - first_light
        if not slots:
            return
        q.counter.array[0] = 0
        self.program.run(
            "connect",
            count * slots,
            *(np.uint32(n) for n in (count, slots, first_light, self._delta)),
            *(self._triangles, self._materials, *self._light_tables, *q.drawn, q.throughput),
            *(at.origin, at.shading, at.geometric, at.path, q.ray_of, q.weight),
            *(q.shadow_origin, q.shadow_direction, q.shadow_limit, q.counter),
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
            *(np.uint32(count), np.uint32(slots), at.path, q.ray_of, q.weight, q.blocked),
            q.collected,
        )

    def _follow(
        self,
        q: _Queues,
        at: _Vertices,
        after: _Vertices,
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
            *(np.uint32(n) for n in (count, vertex, self.last_vertex, kind, plain)),
            *(self._triangles, self._materials, *self._textures, *self._environment),
            *(self._density, np.int32(self._sampled)),
            *(self.program.share(part) for part in hits),
            *(at.direction, at.density, at.path, *q.drawn, q.throughput, q.collected),
            *(*after.surface, q.counter),
        )
        self.program.queue.finish()
        return int(q.counter.array[0])

    def _traced(self, rays: int, began: float) -> None:
        self.work.rays += rays
        self.work.ray_seconds += time.perf_counter() - began


class _Vertices:
    """Surface points that paths have reached, and the rays that leave them."""

    def __init__(self, program: HostProgram, paths: int) -> None:
        self.origin = program.empty((paths, 3), np.float32)
        self.direction = program.empty((paths, 3), np.float32)
        self.shading = program.empty((paths, 3), np.float32)
        self.geometric = program.empty((paths, 3), np.float32)
        self.path = program.empty(paths, np.int32)
        self.density = program.empty(paths, np.float32)
        self.rays = (self.origin, self.direction, self.path, self.density)
        self.surface = (self.origin, self.shading, self.geometric, self.path)


class _Queues:
    """All that a wave of paths needs."""

    def __init__(self, program: HostProgram, paths: int, slots: int) -> None:
        self.paths = paths
        connections = max(1, paths * slots)
        self.vertices = (_Vertices(program, paths), _Vertices(program, paths))
        self.throughput = program.empty((paths, 3), np.float32)
        self.collected = program.empty((paths, 3), np.float32)
        self.mean = program.empty((paths, 3), np.float32)
        # Random numbers (kernels_cl/reference/path.cl, DRAWN_...), planes of `paths` numbers.
        self.drawn = (np.uint32(paths), program.empty((_DRAWN, paths), np.float32))
        self.counter = program.empty(1, np.int32)
        self.ray_of = program.empty(connections, np.int32)
        self.weight = program.empty((connections, 3), np.float32)
        self.shadow_origin = program.empty((connections, 3), np.float32)
        self.shadow_direction = program.empty((connections, 3), np.float32)
        self.shadow_limit = program.empty(connections, np.float32)
        self.blocked = program.empty(connections, np.uint8)
