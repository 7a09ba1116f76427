"""Transport coefficients (Bennett 2019, section 5.6): rays by Embree, the rest by OpenCL.

Per chunk of receivers: primary rays (kernel), closest hits (Embree), validity and what the
visibility tables settle (kernel), rays for the pairs they leave open (Embree), accumulation
(kernels). ``kernels_cl/srp/bake.cl`` has the layouts.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources.abc import Traversable
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.device import (
    Argument,
    Buffer,
    Define,
    Device,
    Launch,
    ProgramSpec,
    integer,
    reads,
    scalar,
    writes,
)
from gibench.rays.offset import SHORT_OF_TARGET, surface_offset
from gibench.rays.tracer import RayTracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import ProbeSet, sh_count
from gibench.techniques.srp.bake.sampling import (
    fragment_shares,
    primary_points,
    triangle_planes,
    with_angles,
)
from gibench.techniques.srp.bake.scratch import Scratch, Timings
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sky import settle_sky
from gibench.techniques.srp.bake.transport_rows import PrimaryRays, TransportRows
from gibench.techniques.srp.bake.visibility import HIDDEN, UNDECIDED, VisibilityTables, no_tables
from gibench.techniques.srp.bake.weights import Nearby, nearby

BLOCK = 64
"""Samples of a work-item."""
# Primary rays that a worker traces at once.
CHUNK_RAYS = 1 << 19


class TransportBaker:
    """Computes transport rows; all that the chunks share is uploaded once.

    Args:
        scene: the scene.
        lightmap: its atlas.
        probes: the probes.
        settings: of the bake.
        tracer: traces against the scene's triangles; called from several threads.
        tables: visibility tables, or None to trace every pair.
        seed: of the samples.
        chunk_rays: primary rays traced at once by one worker; about 60 bytes of memory each.
        cl_device: OpenCL device; by default the first there is.
        vector: floats per vector, 1, 2, 4, 8 or 16; by default what the device prefers.
        kernel_root: another kernel tree than the installed one.

    Raises:
        CannotRun: there is no OpenCL device.
    """

    def __init__(
        self,
        scene: Scene,
        lightmap: Lightmap,
        probes: ProbeSet,
        settings: SrpBakeSettings,
        tracer: RayTracer,
        tables: VisibilityTables | None,
        seed: int = 0,
        chunk_rays: int = CHUNK_RAYS,
        cl_device: Any = None,
        vector: int | None = None,
        kernel_root: Traversable | None = None,
    ) -> None:
        self.lightmap = lightmap
        self.probes = probes
        self.settings = settings
        self.chunk_rays = chunk_rays
        self.tracer = tracer
        self.offset = surface_offset(scene)
        self.table_receivers = len(lightmap.receivers) if tables else 0
        self.coefficients = sh_count(settings.order)
        self.components = settings.components
        self.device = Device.unlimited(cl_device, kernel_root)
        self.vector = vector or self.device.vector_width
        self.stride = -(-settings.transport_rays // self.vector) * self.vector
        defines: dict[str, Define] = {
            "BLOCK": BLOCK,
            "HIDDEN": HIDDEN,
            "UNDECIDED": UNDECIDED,
            "VEC": self.vector,
            "SH_ORDER": settings.order,
            "COMPONENTS": self.components,
            "GRID": tables.grid if tables else 0,
        }
        self.program = ProgramSpec("srp/bake.cl", defines)
        # Built here: the workers share it, and only one thread can build it.
        self.device.program(self.program.path, defines)
        rng = np.random.default_rng([seed, 1])
        points = primary_points(settings.transport_rays, self.stride, seed)
        receivers, fragments = lightmap.receivers, lightmap.fragments
        planes = triangle_planes(scene.corners)
        arrays: dict[str, npt.NDArray[Any]] = {
            "points": with_angles(points),
            "rotations": with_angles(rng.random((len(receivers), 4), dtype=np.float32)),
            "normals": receivers.normal,
            "fragment_start": fragments.start.astype(np.int32),
            "fragment_share": fragment_shares(fragments),
            "fragment_corners": fragments.corners,
            "fragment_triangle": fragments.triangle.astype(np.int32),
            "planes": planes,
            "triangle_uvs": lightmap.triangle_uvs,
            "receiver_of_texel": lightmap.receiver_of_texel,
            "probes": np.pad(probes.positions.astype(np.float32), ((0, 0), (0, 1))),
            "states": tables.states if tables else no_tables(len(probes)),
        }
        # What lifts a point off each triangle; the last row (index -1) stands for no triangle.
        self.lift = np.pad(planes[:, :3] * np.float32(self.offset), ((0, 1), (0, 0)))
        self.shared = {name: self.device.upload(name, array) for name, array in arrays.items()}
        self.device.queue.finish()

    def worker(self) -> TransportWorker:
        """A worker with a queue, kernels and scratch of its own, for one thread at a time."""
        return TransportWorker(self)


class TransportWorker:
    """What one thread needs to compute transport rows."""

    def __init__(self, baker: TransportBaker) -> None:
        self.baker = baker
        self.clock = Timings()
        self.device = baker.device.beside()
        self._scratch = Scratch(self.device)

    def rows(self, receivers: Ints) -> TransportRows:
        """The transport rows of ``receivers`` (m,)."""
        c = self.baker.coefficients
        pairs = nearby(self.baker.lightmap.receivers.position[receivers], self.baker.probes)
        used = np.unique(pairs.probe)
        parts = self.baker.components
        matrix = np.zeros((len(receivers), parts, len(used), c), np.float32)
        valid = np.zeros(len(receivers), np.int32)
        for chunk in self._chunks(pairs):
            part = pairs.part(chunk)
            if len(part.probe):
                transport, valid[chunk] = self._chunk(receivers[chunk], part)
                column = np.searchsorted(used, part.probe)
                matrix[part.receiver + chunk.start, :, column] = transport
        few = valid < self.baker.settings.least_valid * self.baker.settings.transport_rays
        matrix[few] = 0.0
        valid[few] = 0
        flat = matrix.reshape(len(receivers) * parts, -1)
        return TransportRows(used.astype(np.int32), flat, valid)

    def primary_rays(self, receivers: Ints) -> PrimaryRays:
        """The rays that :meth:`rows` traces from ``receivers`` (m,).

        A direction of zero marks a sample that leads straight into its own surface.
        """
        origins, directions = self._primary(receivers)
        samples = self.baker.settings.transport_rays
        return PrimaryRays(origins[:, :samples], directions[:, :samples])

    def decisions(self, receivers: Ints) -> npt.NDArray[np.bool_]:
        """(q, s) mutual visibility V_i of every pair of ``receivers`` and nearby probe."""
        pairs = nearby(self.baker.lightmap.receivers.position[receivers], self.baker.probes)
        states = self._decisions(receivers, pairs)
        return np.asarray(states[:, : self.baker.settings.transport_rays] != 0)

    def _chunks(self, pairs: Nearby) -> Iterator[slice]:
        """Runs of receivers with at most ``chunk_rays`` rays, and 16 pairs per ray on average."""
        most_receivers = max(1, self.baker.chunk_rays // self.baker.stride)
        begin, count = 0, len(pairs.start) - 1
        while begin < count:
            end = begin + 1
            room = pairs.start[begin] + 16 * most_receivers
            while end < min(count, begin + most_receivers) and pairs.start[end + 1] <= room:
                end += 1
            yield slice(begin, end)
            begin = end

    def _run(self, kernel: str, groups: int | tuple[int, int], *args: Argument) -> None:
        """Enqueue a kernel in groups of one work-item."""
        stride = integer("stride", self.baker.stride)
        launch = Launch(self.baker.program, kernel, (stride, *args), groups=groups)
        self.device.enqueue(launch, 1)

    def _shared(self, *names: str) -> list[Argument]:
        return [reads(name, self.baker.shared[name]) for name in names]

    def _primary(self, receivers: Ints) -> tuple[Floats, Floats]:
        baker = self.baker
        shape = (len(receivers), baker.stride, 3)
        nbytes = 12 * shape[0] * shape[1]
        self._run(
            "transport_rays",
            (-(-baker.stride // BLOCK), len(receivers)),
            integer("samples", baker.settings.transport_rays),
            scalar("offset", np.float32(baker.offset)),
            *self._shared("points", "rotations"),
            reads("receivers", self._scratch.send("receivers", receivers.astype(np.int32))),
            *self._shared("normals", "fragment_start", "fragment_share", "fragment_corners"),
            *self._shared("fragment_triangle", "planes"),
            writes("origins", self._scratch.room("origins", nbytes)),
            writes("directions", self._scratch.room("directions", nbytes)),
        )
        origins = self._scratch.fetch(self._scratch["origins"], shape, np.float32)
        return origins, self._scratch.fetch(self._scratch["directions"], shape, np.float32)

    def _chunk(self, receivers: Ints, pairs: Nearby) -> tuple[Floats, Ints]:
        """Coefficients (q, components, c) of the pairs and valid samples (m,) of ``receivers``."""
        baker, stride, count = self.baker, self.baker.stride, len(receivers)
        of_samples = self._decisions
        if baker.settings.interpolation != "srp":
            of_samples = self._without_mutual_visibility
        states = of_samples(receivers, pairs)
        now = perf_counter()
        scratch = self._scratch
        start, probe, weight = (scratch[f"pair_{name}"] for name in ("start", "probe", "weight"))
        hits, visible = scratch["hits"], scratch["visible"]
        inverse = self._scratch.room("inverse", 4 * count * stride)
        valid = self._scratch.room("valid", 4 * count)
        shape = (len(pairs.probe), baker.components, baker.coefficients)
        transport = self._scratch.room("transport", 4 * int(np.prod(shape)))
        self._run(
            "transport_weights",
            count,
            reads("pair_start", start),
            reads("pair_weight", weight),
            reads("visible", visible),
            writes("inverse", inverse),
            writes("valid_samples", valid),
        )
        linear: list[Argument] = []
        if baker.components > 1:
            linear = [reads("linear", self._linear(receivers))]
        self._run(
            "transport_accumulate",
            (len(pairs.probe), baker.components),
            reads("pair_receiver", self._scratch.send("pair_receiver", pairs.receiver)),
            reads("pair_probe", probe),
            reads("pair_weight", weight),
            *self._shared("probes"),
            reads("hits", hits),
            reads("visible", visible),
            reads("inverse", inverse),
            reads("valid_samples", valid),
            *linear,
            writes("transport", transport),
        )
        out = (
            self._scratch.fetch(transport, shape, np.float32),
            self._scratch.fetch(valid, (count,), np.int32),
        )
        self.clock.add("accumulate", now, states.size)
        return out

    def _linear(self, receivers: Ints) -> Buffer:
        """What the last three components weigh each sample with, of the rays last generated."""
        baker = self.baker
        linear = self._scratch.room("linear", 12 * len(receivers) * baker.stride)
        self._run(
            "transport_linear",
            (-(-baker.stride // BLOCK), len(receivers)),
            reads("receivers", self._scratch["receivers"]),
            *self._shared("normals"),
            reads("directions", self._scratch["directions"]),
            writes("linear", linear),
        )
        return linear

    def _decisions(self, receivers: Ints, pairs: Nearby) -> npt.NDArray[np.uint8]:
        """(q, stride) whether each sample is mutually visible; also left on the device."""
        baker, clock = self.baker, self.clock
        stride, count, rays = baker.stride, len(receivers), len(receivers) * baker.stride
        now = perf_counter()
        origins, directions = self._primary(receivers)
        now = clock.add("generate rays", now, rays)
        found = baker.tracer.closest(origins.reshape(-1, 3), directions.reshape(-1, 3))
        now = clock.add("primary rays", now, rays)

        start = self._scratch.send("pair_start", pairs.start)
        probe = self._scratch.send("pair_probe", pairs.probe)
        self._scratch.send("pair_weight", pairs.weight)
        hits = self._scratch.room("hits", 16 * rays)
        visible = self._scratch.room("visible", len(pairs.probe) * stride)
        lightmap = baker.lightmap
        self._run(
            "transport_decide",
            (-(-stride // BLOCK), count),
            reads("origins", self._scratch["origins"]),
            reads("directions", self._scratch["directions"]),
            reads("hit_triangle", self._scratch.send("hit_triangle", found.triangle)),
            reads("hit_distance", self._scratch.send("hit_distance", found.distance)),
            reads("hit_u", self._scratch.send("hit_u", found.u)),
            reads("hit_v", self._scratch.send("hit_v", found.v)),
            *self._shared("planes", "triangle_uvs"),
            integer("width", lightmap.width),
            integer("height", lightmap.height),
            *self._shared("receiver_of_texel"),
            integer("receivers", baker.table_receivers),
            *self._shared("states"),
            integer("states_width", len(baker.probes)),
            reads("pair_start", start),
            reads("pair_probe", probe),
            *self._shared("probes"),
            writes("hits", hits),
            writes("visible", visible),
        )
        states = self._scratch.fetch(visible, (len(pairs.probe), stride), np.uint8)
        if baker.probes.sky:
            shape = count, stride
            sky = len(baker.probes) - 1
            settle_sky(states, pairs, sky, found.triangle.reshape(shape), directions)
        now = clock.add("decide", now, states.size)
        traced = self._resolve(states, pairs, found.triangle)
        now = clock.add("visibility rays", now, traced)

        if traced or baker.probes.sky:
            self.device.write_bytes(visible, states)
        return np.asarray(states)

    def _without_mutual_visibility(self, receivers: Ints, pairs: Nearby) -> npt.NDArray[np.uint8]:
        """As :meth:`_decisions`, for blending in the receiver's own direction: every sample is
        taken from every probe, or from every one that the receiver sees.
        """
        baker, stride, count = self.baker, self.baker.stride, len(receivers)
        now = perf_counter()
        self._primary(receivers)
        sees = np.ones(len(pairs.probe), np.uint8)
        if baker.settings.interpolation == "visibility":
            sees[:] = self._sees(receivers, pairs)
        start = self._scratch.send("pair_start", pairs.start)
        self._scratch.send("pair_probe", pairs.probe)
        self._scratch.send("pair_weight", pairs.weight)
        hits = self._scratch.room("hits", 16 * count * stride)
        visible = self._scratch.room("visible", len(pairs.probe) * stride)
        self._run(
            "transport_plain",
            (-(-stride // BLOCK), count),
            reads("directions", self._scratch["directions"]),
            reads("pair_start", start),
            reads("pair_sees", self._scratch.send("pair_sees", sees)),
            writes("hits", hits),
            writes("visible", visible),
        )
        states = self._scratch.fetch(visible, (len(pairs.probe), stride), np.uint8)
        self.clock.add("decide", now, states.size)
        return np.asarray(states)

    def _sees(self, receivers: Ints, pairs: Nearby) -> npt.NDArray[np.bool_]:
        """(q,) whether the receiver's own position, off its surface, sees the pair's probe."""
        held = self.baker.lightmap.receivers
        own = receivers[pairs.receiver]
        origins = held.position[own] + held.normal[own] * np.float32(self.baker.offset)
        towards = self.baker.probes.positions.astype(np.float32)[pairs.probe] - origins
        above = np.einsum("qx,qx->q", towards, held.normal[own]) > 0
        limit = np.full(len(own), 1.0 - SHORT_OF_TARGET, np.float32)
        return np.asarray(above & ~self.baker.tracer.occluded(origins, towards, limit))

    def _resolve(self, states: npt.NDArray[np.uint8], pairs: Nearby, triangle: Ints) -> int:
        """Trace the undecided pairs and write the outcome into ``states``; returns their number."""
        baker = self.baker
        stride = baker.stride
        flat = states.reshape(-1)
        undecided = np.flatnonzero(flat == UNDECIDED)
        if not len(undecided):
            return 0
        pair = undecided // stride
        receiver = pairs.receiver[pair].astype(np.int64)
        ray = undecided + (receiver - pair) * stride
        shape = (len(pairs.start) - 1) * 4 * stride
        hits = self._scratch.fetch(self._scratch["hits"], (shape,), np.float32)
        place = ray + 3 * stride * receiver  # of x in [R][4][S]; y, z and h follow by strides
        is_hit = hits.take(place + 3 * stride)
        struck = triangle.take(ray)
        origins = baker.probes.positions.astype(np.float32).take(pairs.probe.take(pair), axis=0)
        # Off the surface by the same distance as every ray's start, on the side of the probe.
        directions = baker.lift.take(np.maximum(struck, -1), axis=0, mode="wrap")
        for axis in range(3):
            directions[:, axis] += hits.take(place + axis * stride) - is_hit * origins[:, axis]
        limit = np.where(is_hit > 0, np.float32(1.0 - SHORT_OF_TARGET), np.float32(np.inf))
        blocked = baker.tracer.occluded(origins, directions, limit)
        flat[undecided] = ~blocked
        return len(undecided)
