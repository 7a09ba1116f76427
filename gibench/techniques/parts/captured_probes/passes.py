"""The passes of captured probes: relighting, filters, borders, and the lookup at the pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gibench.device import (
    Argument,
    Buffer,
    Define,
    Launch,
    ProgramSpec,
    count_rays,
    integer,
    reads,
    scalar,
    updates,
    writes,
)
from gibench.techniques.parts.camera_pass import Application, lookup_defines
from gibench.techniques.parts.captured_probes.held import (
    RELIGHT_MACROS,
    HeldProbes,
    distance_maps,
    irradiance_maps,
)
from gibench.techniques.parts.captured_probes.lobes import LEAST_SIDE, lobe_maps, lobe_texels
from gibench.techniques.parts.captured_probes.resample import LEAST_WEIGHT
from gibench.techniques.parts.captured_probes.schedule import Schedule
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.gloss_table import GlossTable
from gibench.techniques.parts.split_sum import GLOSS_MACROS
from gibench.techniques.technique import Pass, Work

APPLICATION = "parts/captured_application.cl"

# At a pixel: its surface's shape (65), the place in the grid (12), the texel of its normal (18) and
# the mean (3). For each probe in reach: its trilinear share (11), four texels of irradiance (36)
# and their sum (7).
_LOOKUP_FLOPS = 98.0
_PROBE_FLOPS = 54.0
# For a probe that is tested besides: how far and which way (15), its texel (18), two moments of
# four texels (18), the bound (12).
_TEST_FLOPS = 63.0
_IN_REACH = 8
# With gloss, at a pixel: the direction that is mirrored (11), where it leaves the box (15), the
# table (21), F0 and what is reflected (20); for each probe in reach the direction from it (14), two
# texels (36), eight values of radiance (72), mixed and summed (16).
_MIRROR_FLOPS = 67.0
_RECEIVED_FLOPS = 138.0


@dataclass
class ProbePasses:
    """The launches of a frame.

    Attributes:
        scene: the scene on the device.
        probes: on it.
        tuned: the eight probes around a point, vectors, and nothing that is known already; else as
            published.
        packets: whether the camera pass traces packets.
        distance_sharpness: power of the cosine that distances are filtered by.
    """

    scene: FrameScene
    probes: HeldProbes
    tuned: bool
    packets: bool
    distance_sharpness: float
    application: Application = field(init=False)
    schedule: Schedule = field(init=False)
    gloss: GlossTable = field(default=GlossTable(None), init=False)
    _fresh: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        device, scene, settings = self.probes.device, self.scene, self.probes.settings
        volume, usable = self.probes.baked.volume, self.probes.baked.usable
        numbers = np.flatnonzero(usable).astype(np.int32)
        self.schedule = Schedule(
            positions=volume.positions[usable],
            numbers=numbers,
            each_frame=min(settings.relit_probes(volume.probes), len(numbers)),
            far=settings.far_from * self.probes.baked.far,
            slower=settings.far_slower,
        )
        each = _PROBE_FLOPS + (_TEST_FLOPS if settings.visibility else 0.0)
        lookup = _LOOKUP_FLOPS
        if settings.gloss_steps:
            each, lookup = each + _RECEIVED_FLOPS, lookup + _MIRROR_FLOPS
            self.gloss = GlossTable.upload(device, scene.scene)
        self.application = Application(
            scene=scene,
            hits=HitBuffer.create(device, scene.width, scene.height),
            program=self._program(APPLICATION, {**lookup_defines(device), **self._lobes}),
            args=(
                *scene.surfaces.shape_args,
                *self.probes.volume_args,
                *self.probes.map_args,
                *self._lobe_args,
            ),
            flops=lookup + min(_IN_REACH, volume.probes) * each,
            packets=self.packets,
        )

    def passes(self) -> list[Pass]:
        """The passes of a frame, in order."""
        found = self._relighting() if self.probes.settings.relit else []
        return [*found, *self.application.passes()]

    def begin_frame(self) -> None:
        """Choose the probes of the frame."""
        if self.probes.settings.relit and self.schedule.each_frame:
            chosen, fresh = self.schedule.next(self.scene.camera.position)
            self._fresh = bool(fresh.any())
            relit = self.probes.capture["relit"]
            numbers = np.zeros(relit.shape, np.int32)
            numbers[: len(chosen)] = chosen
            self.probes.device.write(relit, numbers)

    def receivers(self, position: Buffer, normal: Buffer, irradiance: Buffer) -> Launch:
        """The launch that gathers irradiance at points (n, 3) with normals (n, 3)."""
        count = position.shape[0]
        args: tuple[Argument, ...] = (
            *self.probes.volume_args,
            *self.probes.map_args,
            reads("position", position),
            reads("normal", normal),
            integer("count", count),
            writes("irradiance", irradiance),
        )
        program = self._program(APPLICATION, lookup_defines(self.probes.device))
        return Launch(program, "receiver_irradiance", args, items=count)

    @property
    def _lobes(self) -> dict[str, Define]:
        """Macros of what looks prefiltered radiance up; none where there is none."""
        if not self.probes.settings.gloss_steps:
            return {}
        low, high = self.scene.scene.bounds
        box = {
            f"BOX_{end}_{axis}": float(value)
            for end, corner in (("LOW", low), ("HIGH", high))
            for axis, value in zip("XYZ", corner, strict=True)
        }
        return {
            "LOBE_STEPS": self.probes.settings.gloss_steps,
            "LEAST_LOBE_SIDE": LEAST_SIDE,
            **GLOSS_MACROS,
            **box,
            **self.gloss.defines,
        }

    @property
    def _lobe_args(self) -> tuple[Argument, ...]:
        """What reads it besides the maps."""
        held, surfaces = self.probes, self.scene.surfaces
        if held.lobes is None or held.split_sum is None:
            return ()
        return (
            reads("lobe_maps", held.lobes),
            reads("split_sum", held.split_sum),
            reads("material_ids", surfaces.material_ids),
            reads("materials", surfaces.materials),
            *self.gloss.args,
        )

    def _program(self, path: str, more: Mapping[str, Define] | None = None) -> ProgramSpec:
        defines = self.probes.defines(not self.tuned)
        return self.scene.program(path, {**defines, **(more or {})})

    def _relighting(self) -> list[Pass]:
        held, s = self.probes, self.probes.settings
        relit, texels, width = self.schedule.each_frame, s.texels, irradiance_maps(s).dtype.itemsize
        pairs = relit * texels**2
        lobe = (1 - self._least_cosine) / 2
        count = held.baked.volume.probes
        borders = irradiance_maps(s).border_bytes_of(count)
        found = [
            Pass("probe_relight", self._relight, self._relit_work(0.0), self._relit_counted),
            Pass(
                "filter_irradiance",
                self._filter_irradiance,
                # Every pair of texels has a cosine (5); half of them are in front: the weight (1)
                # and four sums (8).
                Work(
                    flops=pairs * (5 + 0.5 * 9),
                    bytes_read=relit * 12 * texels + 16 * texels,
                    bytes_written=relit * texels * 4 * width,
                ),
            ),
        ]
        if held.distance is not None:
            borders += distance_maps(s).border_bytes_of(count)
            work = Work(
                flops=pairs * (5 + lobe * 6),
                bytes_read=relit * 8 * texels + 12 * texels,
                bytes_written=relit * texels * 2 * width,
            )
            found.append(
                Pass(
                    "filter_distance",
                    self._filter_distance,
                    work,
                    lambda size: work if self._filters_distance else Work(),
                )
            )
        if held.lobes is not None:
            maps = lobe_maps(s.map_texels, s.gloss_steps, s.storage)
            borders += sum(own.border_bytes_of(count) for own in maps)
            # Every pair of texels has a cosine (5); half of them are in front: the weight (9) and
            # four sums (7). A mirror's map is copied.
            own = lobe_texels(s.map_texels, s.gloss_steps)
            prefiltering = Work(
                flops=relit * (own - texels) * texels * (5 + 0.5 * 16),
                bytes_read=relit * 12 * texels + 16 * texels,
                bytes_written=relit * own * 4 * width,
            )
            found.append(Pass("prefilter", self._prefilter, prefiltering))
        found.append(
            Pass("border_copy", self._borders, Work(bytes_read=borders, bytes_written=borders))
        )
        return found

    def _relit_work(self, rays: float) -> Work:
        texels = self.schedule.each_frame * self.probes.settings.texels
        return Work(bytes_read=24 * texels, bytes_written=12 * texels, rays=rays)

    def _relit_counted(self, workgroup_size: int) -> Work:
        """Its work with the shadow rays of the probes that are relit now."""
        (launch,) = self._relight()
        rays = count_rays(self.probes.device, launch, workgroup_size)
        return self._relit_work(float(rays.occluded))

    def _items(self, outputs: int = 1) -> int:
        return self.schedule.each_frame * self.probes.settings.texels // outputs

    def _relight(self) -> Sequence[Launch]:
        held, scene = self.probes, self.scene
        gathers = {"GATHERS": int(held.settings.bounce_count != 1)}
        args: tuple[Argument, ...] = (
            *scene.bvh_args,
            *scene.surfaces.shape_args,
            *scene.light_args,
            *held.volume_args,
            *held.map_args,
            reads("relit", held.capture["relit"]),
            integer("relit_count", self.schedule.each_frame),
            reads("captured_hits", held.capture["captured_hits"]),
            reads("captured_albedo", held.capture["captured_albedo"]),
            reads("captured_emission", held.capture["captured_emission"]),
            updates("radiance", held.capture["radiance"]),
        )
        program = self._program("parts/captured_relight.cl", {**gathers, **RELIGHT_MACROS})
        return [Launch(program, "probe_relight", args, items=self._items())]

    def _filter_irradiance(self) -> Sequence[Launch]:
        held = self.probes
        args: tuple[Argument, ...] = (
            reads("relit", held.capture["relit"]),
            integer("relit_count", self.schedule.each_frame),
            reads("texel_table", held.capture["texel_table"]),
            reads("radiance", held.capture["radiance"]),
            updates("irradiance_maps", held.irradiance),
            updates("probe_data", held.placed.data),
        )
        outputs = 4 if self.tuned else 1
        program = self._filter_program(outputs)
        return [Launch(program, "filter_irradiance", args, items=self._items(outputs))]

    def _filter_distance(self) -> Sequence[Launch]:
        held = self.probes
        assert held.distance is not None
        args: tuple[Argument, ...] = (
            reads("relit", held.capture["relit"]),
            integer("relit_count", self.schedule.each_frame),
            reads("texel_table", held.capture["texel_table"]),
            reads("captured_moments", held.capture["captured_moments"]),
            scalar("sharpness", np.float32(self.distance_sharpness)),
            scalar("least_cosine", np.float32(self._least_cosine)),
            updates("distance_maps", held.distance),
        )

        def items() -> int:
            return self._items() if self._filters_distance else 0

        return [Launch(self._filter_program(1), "filter_distance", args, items=items)]

    def _prefilter(self) -> Sequence[Launch]:
        held, s = self.probes, self.probes.settings
        assert held.lobes is not None
        texels = lobe_texels(s.map_texels, s.gloss_steps)
        args: tuple[Argument, ...] = (
            reads("relit", held.capture["relit"]),
            integer("relit_count", self.schedule.each_frame),
            integer("lobe_texels", texels),
            reads("texel_table", held.capture["texel_table"]),
            reads("radiance", held.capture["radiance"]),
            updates("lobe_maps", held.lobes),
        )
        defines = {
            **self._filter_program(1).defines,
            "LOBE_STEPS": s.gloss_steps,
            "LEAST_LOBE_SIDE": LEAST_SIDE,
            **GLOSS_MACROS,
        }
        program = ProgramSpec("parts/captured_prefilter.cl", defines)
        return [Launch(program, "prefilter", args, items=self.schedule.each_frame * texels)]

    @property
    def _filters_distance(self) -> bool:
        """Whether a probe's distances are not filtered yet, or it is done anyway, as published."""
        return self._fresh or not self.tuned

    @property
    def _least_cosine(self) -> float:
        if self.distance_sharpness <= 0:
            return 0.0
        return float(LEAST_WEIGHT ** (1 / self.distance_sharpness))

    def _filter_program(self, outputs: int) -> ProgramSpec:
        s = self.probes.settings
        defines: dict[str, Define] = {
            **self.probes.placed.defines,
            "SIDE": s.map_texels,
            "HALF_MAPS": s.storage == "fp16",
            "VEC": self.probes.device.vector_width if self.tuned else 1,
            "OUTPUTS": outputs,
        }
        return ProgramSpec("parts/captured_filter.cl", defines)

    def _borders(self) -> Sequence[Launch]:
        held, s = self.probes, self.probes.settings
        found = [irradiance_maps(s).border_copy(held.irradiance)]
        if held.distance is not None:
            found.append(distance_maps(s).border_copy(held.distance))
        first, probes = 0, held.baked.volume.probes
        for maps in lobe_maps(s.map_texels, s.gloss_steps, s.storage):
            assert held.lobes is not None
            found.append(maps.border_copy(held.lobes, first, probes))
            first += probes * (maps.side + 2) ** 2
        return found
