"""The tree on the device, and a tracer of ray buffers through it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.device import (
    Argument,
    Buffer,
    BufferSpec,
    Device,
    Launch,
    ProgramSpec,
    integer,
    reads,
    writes,
)
from gibench.device.build import Define
from gibench.rays.bvh import BLOCK_FLOATS, BVH_MACROS, Bvh
from gibench.rays.bvh_wide import WIDTH
from gibench.rays.embree import rays_of
from gibench.rays.tracer import Hits
from gibench.scene.image_rows import Words

_CHUNK_RAYS = 262144
# Rays of a packet: a vector of the device, at least this many (kernels_cl/common/bvh_packet.cl).
LEAST_PACKET = 8


@dataclass(frozen=True)
class DeviceBvh:
    """A tree's buffers, in the order of BVH_PARAMS of kernels_cl/common/bvh.cl.

    Attributes:
        bvh: what was uploaded.
        nodes: its nodes.
        triangles: its leaf blocks.
        cutouts: what is cut away of its triangles (kernels_cl/common/cutout.cl), or None.
    """

    bvh: Bvh
    nodes: Buffer
    triangles: Buffer
    cutouts: Buffer | None = None

    @staticmethod
    def upload(
        device: Device, bvh: Bvh, name: str = "bvh", cutouts: Words | None = None
    ) -> DeviceBvh:
        """Upload ``bvh`` as the buffers ``{name}_nodes`` and ``{name}_triangles``.

        Args:
            device: where it shall lie.
            bvh: the tree.
            name: of the buffers.
            cutouts: of its triangles, packed (:meth:`gibench.scene.cutouts.Cutouts.packed`).

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        data: dict[str, npt.NDArray[Any]] = {
            f"{name}_nodes": bvh.nodes,
            f"{name}_triangles": bvh.blocks,
        }
        if cutouts is not None:
            data[f"{name}_cutouts"] = cutouts
        words = 0 if cutouts is None else len(cutouts)
        held = device.allocate(DeviceBvh.buffers(bvh, name, words), data)
        nodes, triangles = held[f"{name}_nodes"], held[f"{name}_triangles"]
        return DeviceBvh(bvh, nodes, triangles, held.get(f"{name}_cutouts"))

    @staticmethod
    def buffers(bvh: Bvh, name: str = "bvh", cutout_words: int = 0) -> list[BufferSpec]:
        """The buffers of ``bvh``: its nodes, its leaf blocks, and what is cut away of its triangles
        where that takes any words.
        """
        return [
            BufferSpec.like(f"{name}_nodes", bvh.nodes),
            BufferSpec.like(f"{name}_triangles", bvh.blocks),
            *DeviceBvh.cutout_buffers(cutout_words, name),
        ]

    @staticmethod
    def cutout_buffers(words: int, name: str = "bvh") -> list[BufferSpec]:
        """What is cut away, uint32; nothing where it takes no words."""
        return [BufferSpec.of(f"{name}_cutouts", words, np.uint32)] if words else []

    @staticmethod
    def least_buffers(triangles: int, name: str = "bvh", cutout_words: int = 0) -> list[BufferSpec]:
        """Those of any tree over so many triangles, which at least fill its leaf blocks."""
        blocks = (-(-triangles // WIDTH), BLOCK_FLOATS)
        return [
            BufferSpec.of(f"{name}_triangles", blocks, np.float32),
            *DeviceBvh.cutout_buffers(cutout_words, name),
        ]

    @property
    def args(self) -> tuple[Argument, ...]:
        """BVH_PARAMS of kernels_cl/common/bvh.cl."""
        tree = (reads("bvh_nodes", self.nodes), reads("bvh_triangles", self.triangles))
        return tree if self.cutouts is None else (*tree, reads("cutouts", self.cutouts))

    @property
    def defines(self) -> dict[str, Define]:
        """The macros of programs that trace through it."""
        return {**BVH_MACROS, **({} if self.cutouts is None else {"CUTOUTS": 1})}


def packet_rays(device: Device) -> int:
    """How many rays a packet holds on ``device``: 8 or 16."""
    return 16 if device.vector_width >= 16 else LEAST_PACKET


class DeviceTracer:
    """A :class:`~gibench.rays.tracer.RayTracer` by ``rays/trace.cl`` on ``device``.

    Rays go through buffers of the tracer's own, a chunk at a time; all are counted in the device's
    ledger. :meth:`release` frees them. ``kernel_seconds`` is what the kernels of the last query
    took, by their events.

    Args:
        device: where to trace.
        device_bvh: the tree, uploaded to the same device.
        workgroup_size: work-items per group; the profile's default when None.
        chunk_rays: rays per launch.
        name: prefix of the buffers' names in the ledger.
        packets: trace as many consecutive rays together as a vector holds
            (kernels_cl/common/bvh_packet.cl): the same hits up to rounding, faster for coherent
            rays only.

    Raises:
        CannotRun: the work-group size or the buffers break the device's profile.
    """

    def __init__(
        self,
        device: Device,
        device_bvh: DeviceBvh,
        workgroup_size: int | None = None,
        chunk_rays: int = _CHUNK_RAYS,
        name: str = "tracer",
        packets: bool = False,
    ) -> None:
        self.device = device
        self.device_bvh = device_bvh
        self.chunk_rays = chunk_rays
        self.workgroup_size = workgroup_size or device.profile.default_workgroup_size
        self._rays_per_item = packet_rays(device) if packets else 1
        self._program = (
            ProgramSpec(
                "rays/trace_packets.cl", {"PACKET": self._rays_per_item, **device_bvh.defines}
            )
            if packets
            else ProgramSpec("rays/trace.cl", device_bvh.defines)
        )
        self._origins = device.empty(f"{name}_origins", (chunk_rays, 3), np.float32)
        self._directions = device.empty(f"{name}_directions", (chunk_rays, 3), np.float32)
        self._limits = device.empty(f"{name}_limits", chunk_rays, np.float32)
        self._hits = device.empty(f"{name}_hits", (chunk_rays, 4), np.float32)
        self._blocked = device.empty(f"{name}_blocked", chunk_rays, np.uint8)
        self.kernel_seconds = 0.0
        for launch in (
            self._launch("trace_closest", writes("hits", self._hits), 1, 1),
            self._launch("trace_occluded", writes("blocked", self._blocked), 1, 1),
        ):
            device.prepare(launch, self.workgroup_size)

    def closest(
        self, origins: Floats, directions: Floats, max_distance: Floats | float = np.inf
    ) -> Hits:
        """Closest hits of rays (n, 3) at distances in (0, max_distance)."""
        o, d, limit = rays_of(origins, directions, max_distance)
        raw = np.empty((len(o), 4), np.float32)
        self._trace("trace_closest", o, d, limit, writes("hits", self._hits), raw)
        return Hits(
            raw[:, 3].copy().view(np.int32), raw[:, 0].copy(), raw[:, 1].copy(), raw[:, 2].copy()
        )

    def occluded(
        self, origins: Floats, directions: Floats, max_distance: Floats | float = np.inf
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether anything is hit at a distance in (0, max_distance)."""
        o, d, limit = rays_of(origins, directions, max_distance)
        raw = np.empty(len(o), np.uint8)
        self._trace("trace_occluded", o, d, limit, writes("blocked", self._blocked), raw)
        return raw.astype(np.bool_)

    def release(self) -> None:
        """Free the tracer's buffers (not the tree's)."""
        self.device.release(
            self._origins, self._directions, self._limits, self._hits, self._blocked
        )

    def _trace(
        self,
        kernel: str,
        o: Floats,
        d: Floats,
        limit: Floats | float,
        result: Argument,
        out: npt.NDArray[np.float32] | npt.NDArray[np.uint8],
    ) -> None:
        """Trace all rays chunk by chunk into ``out``; adds the kernels' own time."""
        self.kernel_seconds = 0.0
        for first in range(0, len(o), self.chunk_rays):
            part = slice(first, min(first + self.chunk_rays, len(o)))
            count = part.stop - part.start
            limits = limit[part] if isinstance(limit, np.ndarray) else np.array([limit], np.float32)
            self.device.write(self._origins, o[part])
            self.device.write(self._directions, d[part])
            self.device.write(self._limits, limits)
            launch = self._launch(kernel, result, len(limits), count)
            event = self.device.enqueue(launch, self.workgroup_size)
            assert isinstance(result.value, Buffer)
            self.device.read_into(result.value, out[part])
            self.kernel_seconds += (event.profile.end - event.profile.start) * 1e-9

    def _launch(self, kernel: str, result: Argument, limits: int, count: int) -> Launch:
        args = (
            *self.device_bvh.args,
            reads("origins", self._origins),
            reads("directions", self._directions),
            reads("t_max", self._limits),
            integer("limits", limits),
            integer("count", count),
            result,
        )
        return Launch(self._program, kernel, args, items=-(-count // self._rays_per_item))
