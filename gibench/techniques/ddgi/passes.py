"""DDGI's passes (Majercik et al. 2019; Ekberg 2022, section 3.2; RTXGI-DDGI 1.3.7)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.device import (
    Argument,
    Buffer,
    BufferSpec,
    Define,
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
from gibench.techniques.ddgi.blending import Blending, distance_share
from gibench.techniques.ddgi.probes import Probes, distance_maps, irradiance_maps
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.parts.camera_pass import Application, lookup_defines
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.macros import tiled_pixels
from gibench.techniques.parts.placed_probes import ACTIVE
from gibench.techniques.technique import Pass, Work

SUM_ITEMS = 16
"""Texels whose variability a work-item adds up."""

# At a pixel: its ray (30), its surface's shape (65), the bias and the place in the grid (40), the
# texel of its normal (18) and what the mean becomes in the end (37). For each of eight probes: its
# place (12), the weights by distance and by side (31), the Chebyshev test with its texel and four
# moments (57), both put together (7), and four texels of irradiance, decoded and added (44).
_LOOKUP_FLOPS = 190.0 + 8 * 151


class DdgiPasses:
    """The launches of a frame.

    Works count every probe as active, which all are in frame 0; how many are later depends on the
    scene, and so do shadow rays: those are counted after a frame.

    Args:
        scene: the scene on the device.
        probes: the volume on it.
        blending: the variant.
        workgroup_size: work-items per group.
        packets: whether the camera pass traces packets.
    """

    def __init__(
        self,
        scene: FrameScene,
        probes: Probes,
        blending: Blending,
        workgroup_size: int,
        packets: bool,
    ) -> None:
        self.scene, self.probes, self.blending = scene, probes, blending
        self.workgroup_size = workgroup_size
        sums, counts = self.sums(probes.settings, probes.volume.probes, workgroup_size)
        self._sums, self._counts = probes.device.create(sums), probes.device.create(counts)
        self.application = Application(
            scene=scene,
            hits=HitBuffer.create(probes.device, scene.width, scene.height),
            program=self._application_program(),
            args=(*scene.surfaces.shape_args, *probes.volume_args, *probes.map_args),
            flops=_LOOKUP_FLOPS,
            packets=packets,
        )

    @staticmethod
    def sums(
        settings: DdgiSettings, probes: int, workgroup_size: int
    ) -> tuple[BufferSpec, BufferSpec]:
        """What each group sums of the variability: the values, and their number."""
        groups = -(-probes * settings.irradiance_texels**2 // (SUM_ITEMS * workgroup_size))
        return (
            BufferSpec.of("variability_sums", groups, np.float32),
            BufferSpec.of("variability_counts", groups, np.uint32),
        )

    def passes(self) -> list[Pass]:
        """The passes of a frame, in order."""
        p, s = self.probes.volume.probes, self.probes.settings
        shaded = p * s.blended
        borders = irradiance_maps(s).border_bytes_of(p) + distance_maps(s).border_bytes_of(p)
        return [
            Pass(
                "probe_trace",
                self._trace,
                Work(
                    bytes_read=16 * p + 12 * s.rays,
                    bytes_written=4 * p * s.fixed + 16 * shaded,
                    rays=p * s.rays,
                ),
                self._traced,
            ),
            Pass(
                "probe_shade",
                self._shade,
                Work(bytes_read=16 * shaded, bytes_written=16 * shaded),
                self._shaded,
            ),
            Pass(
                "blend_irradiance",
                self.blending.irradiance,
                self._irradiance_blended(p),
                lambda size: self._irradiance_blended(self._active()),
            ),
            Pass(
                "blend_distance",
                self.blending.distance,
                self._distance_blended(p),
                lambda size: self._distance_blended(self._active()),
            ),
            Pass(
                "border_copy",
                self._borders,
                Work(bytes_read=borders, bytes_written=borders),
            ),
            *self._moving(),
            Pass(
                "variability",
                self._variability,
                self._averaged(p),
                lambda size: self._averaged(self._active()),
            ),
            *self.application.passes(),
        ]

    def _active(self) -> int:
        state = self.probes.device.read(self.probes.data)[:, 3].astype(np.int32)
        return int(np.count_nonzero(state & ACTIVE))

    def _traced(self, workgroup_size: int) -> Work:
        """The trace's work with the probes active now; the others cast their fixed rays alone."""
        p, s, active = self.probes.volume.probes, self.probes.settings, self._active()
        return Work(
            bytes_read=16 * p + 12 * s.rays,
            bytes_written=4 * p * s.fixed + 16 * active * s.blended,
            rays=p * s.fixed + active * s.blended,
        )

    def _shaded(self, workgroup_size: int) -> Work:
        """The shading's work likewise, with its shadow rays."""
        (launch,) = self._shade()
        rays = count_rays(self.probes.device, launch, workgroup_size)
        nbytes = 16 * self._active() * self.probes.settings.blended
        return Work(bytes_read=nbytes, bytes_written=nbytes, rays=rays.occluded)

    def _irradiance_blended(self, active: int) -> Work:
        """The least ``blend_irradiance`` does; half of the rays have a positive cosine with a
        texel.
        """
        s = self.probes.settings
        rays, texels, width = active * s.blended, s.irradiance_texels**2, self._map_width
        return Work(
            flops=rays / 2 * texels * 4 * 2,
            bytes_read=16 * rays + active * texels * 3 * width,
            bytes_written=active * texels * (3 * width + 4),
        )

    def _distance_blended(self, active: int) -> Work:
        s = self.probes.settings
        rays, texels, width = active * s.blended, s.distance_texels**2, self._map_width
        return Work(
            flops=rays * distance_share(s) * texels * 2 * 2,
            bytes_read=4 * rays + active * texels * 2 * width,
            bytes_written=active * texels * 2 * width,
        )

    def _averaged(self, active: int) -> Work:
        texels = active * self.probes.settings.irradiance_texels**2
        return Work(flops=texels, bytes_read=4 * texels, bytes_written=4)

    @property
    def _map_width(self) -> int:
        """Bytes of a value in the maps."""
        return irradiance_maps(self.probes.settings).dtype.itemsize

    def _moving(self) -> list[Pass]:
        """Relocation, where it is on, and classification: what both read of a probe's fixed rays,
        and what they write of its offset and state.
        """
        p, s = self.probes.volume.probes, self.probes.settings
        # A probe's offset over the spacing, and its square.
        moved = Work(flops=p * 8, bytes_read=p * (4 * s.fixed + 16), bytes_written=p * 16)
        rays = 4 * p * s.fixed + 12 * s.fixed if s.classification else 0
        # A ray's way to the sides of its probe's cell: the same for every probe.
        sides = 3.0 * s.fixed if s.classification else 0.0
        classified = Work(flops=sides, bytes_read=rays + 8 * p, bytes_written=4 * p)
        found = [Pass("classification", self._classification, classified)]
        return [Pass("relocation", self._relocation, moved), *found] if s.relocation else found

    def receivers(self, position: Buffer, normal: Buffer, irradiance: Buffer) -> Launch:
        """The launch that gathers irradiance at points (n, 3) with normals (n, 3)."""
        program = self._application_program()
        count = position.shape[0]
        args: tuple[Argument, ...] = (
            *self.probes.volume_args,
            *self.probes.map_args,
            reads("position", position),
            reads("normal", normal),
            integer("count", count),
            writes("irradiance", irradiance),
        )
        return Launch(program, "receiver_irradiance", args, items=count)

    def probe_view(self, radius: float) -> Launch:
        """The launch that draws the probes over the image as spheres of ``radius``, m."""
        program = self._application_program()
        args: tuple[Argument, ...] = (
            *self.scene.bvh_args,
            *self.scene.camera_args,
            *self.probes.volume_args,
            reads("irradiance_maps", self.probes.irradiance),
            scalar("radius", np.float32(radius)),
            updates("image", self.scene.image),
        )
        return Launch(program, "probe_view", args, items=self._tiled_pixels)

    def _application_program(self) -> ProgramSpec:
        defines = {**self._defines(), **lookup_defines(self.scene.device)}
        return self.scene.program("ddgi/application.cl", defines)

    @property
    def _tiled_pixels(self) -> int:
        return tiled_pixels(self.scene.width, self.scene.height)

    @property
    def _shading_args(self) -> tuple[Argument, ...]:
        s = self.scene
        return *s.bvh_args, *s.surface_args, *s.light_args, *s.environment_args

    def _defines(self) -> dict[str, Define]:
        return {
            **self.probes.defines(self.blending.lanes),
            "VEC": self.blending.width,
            "SUM_ITEMS": SUM_ITEMS,
        }

    def _trace(self) -> Sequence[Launch]:
        p = self.probes
        program = self.scene.program("ddgi/trace.cl", self._defines())
        surfaces = self.scene.surfaces
        args: tuple[Argument, ...] = (
            *self.scene.bvh_args,
            reads("positions", surfaces.positions),
            reads("triangles", surfaces.triangles),
            *p.volume_args,
            reads("directions", p.directions),
            updates("fixed_distance", p.fixed_distance),
            updates("hits", p.hits),
        )
        return [Launch(program, "probe_trace", args, items=p.volume.probes * p.settings.rays)]

    def _shade(self) -> Sequence[Launch]:
        p = self.probes
        program = self.scene.program("ddgi/trace.cl", self._defines())
        args: tuple[Argument, ...] = (
            *self._shading_args,
            *p.volume_args,
            *p.map_args,
            reads("directions", p.directions),
            reads("hits", p.hits),
            updates("rays", self.blending.rays),
        )
        return [Launch(program, "probe_shade", args, items=p.volume.probes * p.settings.blended)]

    def _borders(self) -> Sequence[Launch]:
        p = self.probes
        return [
            irradiance_maps(p.settings).border_copy(p.irradiance),
            distance_maps(p.settings).border_copy(p.distance),
        ]

    def _relocation(self) -> Sequence[Launch]:
        p = self.probes
        program = ProgramSpec("ddgi/probes.cl", self._defines())
        args = (
            reads("volume", p.placed.table),
            updates("probe_data", p.data),
            reads("directions", p.directions),
            reads("fixed_distance", p.fixed_distance),
            scalar("least_front", np.float32(p.min_frontface)),
        )
        return [Launch(program, "relocation", args, items=p.volume.probes)]

    def _classification(self) -> Sequence[Launch]:
        p = self.probes
        program = ProgramSpec("ddgi/probes.cl", self._defines())
        args = (
            reads("volume", p.placed.table),
            updates("probe_data", p.data),
            reads("directions", p.directions),
            reads("fixed_distance", p.fixed_distance),
            reads("accepted", p.accepted),
            integer("enabled", p.settings.classification),
        )
        return [Launch(program, "classification", args, items=p.volume.probes)]

    def _variability(self) -> Sequence[Launch]:
        p, size = self.probes, self.workgroup_size
        program = ProgramSpec("ddgi/probes.cl", self._defines())
        scratch = (local("values", 4 * size), local("numbers", 4 * size))
        groups = self._sums.shape[0]
        sums = (
            reads("probe_data", p.data),
            reads("variability", p.variability),
            writes("sums", self._sums),
            writes("counts", self._counts),
            *scratch,
        )
        mean = (
            reads("sums", self._sums),
            reads("counts", self._counts),
            integer("groups", groups),
            writes("average", p.average),
            *scratch,
        )
        return [
            Launch(program, "variability_sums", sums, groups=groups, workgroup_size=size),
            Launch(program, "variability_mean", mean, groups=1, workgroup_size=size),
        ]
