"""Captured probes on a device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.device import Argument, Buffer, BufferSpec, Define, Device, reads
from gibench.device.build import unsigned_literal
from gibench.scene.model import Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.parts.captured_probes.lobes import (
    lobe_buffer,
    lobe_sides,
    stored_lobes,
)
from gibench.techniques.parts.captured_probes.maps import bordered, stride, texel_table
from gibench.techniques.parts.captured_probes.settings import CapturedProbeSettings
from gibench.techniques.parts.captured_probes.stages import CapturedProbes
from gibench.techniques.parts.octahedral_maps import OctahedralMaps
from gibench.techniques.parts.placed_probes import ACTIVE, USABLE, PlacedProbes
from gibench.techniques.parts.recolouring import Shares
from gibench.techniques.parts.split_sum import split_sum_buffer, split_sum_table

NO_FRONT = 0xFFFFFFFF
"""In place of a triangle, where a texel shows none."""
UNITS = 65535
"""Of a barycentric weight, as it is stored."""
RELIGHT_MACROS: dict[str, Define] = {
    "NO_FRONT": unsigned_literal(NO_FRONT),
    "WEIGHT_UNITS": float(UNITS),
}
"""Of kernels_cl/parts/captured_relight.cl."""


def irradiance_maps(settings: CapturedProbeSettings) -> OctahedralMaps:
    """Of every probe (kernels_cl/parts/captured_gather.cl)."""
    return OctahedralMaps(settings.map_texels, 4, settings.storage)


def distance_maps(settings: CapturedProbeSettings) -> OctahedralMaps:
    """Of every probe that is tested (kernels_cl/parts/captured_gather.cl)."""
    return OctahedralMaps(settings.map_texels, 2, settings.storage)


def probe_bytes(settings: CapturedProbeSettings) -> int:
    """Bytes that a probe takes on the device, closed form: its maps with their borders; the
    G-buffer it is relit from; its place and state.
    """
    across, width = settings.map_texels + 2, irradiance_maps(settings).dtype.itemsize
    found = 16 + 4 * width * across**2
    found += sum(
        4 * width * (side + 2) ** 2
        for side in lobe_sides(settings.map_texels, settings.gloss_steps)
    )
    if settings.visibility:
        found += 2 * width * across**2
    if settings.relit:
        found += (8 + 8 + 8 + (8 if settings.visibility else 0)) * settings.texels
    return found


@dataclass(frozen=True)
class Biases:
    """How points are kept off their own surfaces.

    Attributes:
        surface: a point is looked at so far off its surface, m.
        visibility: so much is taken off its distance before it is compared, m.
    """

    surface: float
    visibility: float


@dataclass
class HeldProbes:
    """The buffers of captured probes, shared by all passes.

    Attributes:
        device: where they lie.
        settings: as given.
        baked: what they began from.
        placed: the volume and every probe's state.
        irradiance: (p, side + 2, side + 2, 4) maps.
        distance: (p, side + 2, side + 2, 2) maps; None without visibility.
        capture: what probes are relit from; empty where they are lit once.
        lobes: (texels, 4) radiance prefiltered for gloss (kernels_cl/parts/captured_lobes.cl); None
            where surfaces are diffuse.
        split_sum: the table of gibench.techniques.parts.split_sum; None likewise.
    """

    device: Device
    settings: CapturedProbeSettings
    baked: CapturedProbes
    placed: PlacedProbes
    irradiance: Buffer
    distance: Buffer | None
    capture: dict[str, Buffer]
    lobes: Buffer | None = None
    split_sum: Buffer | None = None

    @staticmethod
    def buffers(settings: CapturedProbeSettings, probes: int) -> list[BufferSpec]:
        """The buffers that so many probes take."""
        of, s, p = BufferSpec.of, settings, probes
        found = [*PlacedProbes.buffers(p), irradiance_maps(s).buffer("irradiance_maps", p)]
        if s.visibility:
            found.append(distance_maps(s).buffer("distance_maps", p))
        if s.gloss_steps:
            found.append(lobe_buffer(s.map_texels, s.gloss_steps, s.storage, p))
            found.append(split_sum_buffer())
        if s.relit:
            each = s.relit_probes(p)
            found += [
                of("captured_hits", (p, s.texels, 2), np.uint32),
                of("captured_albedo", (p, s.texels, 4), np.float16),
                of("captured_emission", (p, s.texels, 4), np.float16),
                of("relit", each, np.int32),
                of("radiance", (each, 3, stride(s.map_texels)), np.float32),
                of("texel_table", (4, stride(s.map_texels)), np.float32),
            ]
            if s.visibility:
                found.append(of("captured_moments", (p, s.texels, 2), np.float32))
        return found

    @staticmethod
    def create(
        device: Device, settings: CapturedProbeSettings, baked: CapturedProbes, biases: Biases
    ) -> HeldProbes:
        """Allocate and fill them.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        specs = HeldProbes.buffers(settings, baked.volume.probes)
        lengths = (biases.surface, biases.visibility / baked.far, baked.far)
        held = device.allocate(specs, _contents(settings, baked, specs, lengths))
        named = ("captured_hits", "captured_albedo", "captured_emission", "captured_moments")
        names = (*named, "relit", "radiance", "texel_table")
        return HeldProbes(
            device,
            settings,
            baked,
            PlacedProbes.of(device, baked.volume, held),
            irradiance=held["irradiance_maps"],
            distance=held.get("distance_maps"),
            capture={name: held[name] for name in names if name in held},
            lobes=held.get("lobe_maps"),
            split_sum=held.get("split_sum"),
        )

    @property
    def volume_args(self) -> tuple[Argument, ...]:
        """VOLUME_PARAMS of kernels_cl/parts/probe_volume.cl."""
        return self.placed.args

    @property
    def map_args(self) -> tuple[Argument, ...]:
        """MAP_PARAMS of kernels_cl/parts/captured_gather.cl."""
        found = reads("irradiance_maps", self.irradiance)
        return (found,) if self.distance is None else (found, reads("distance_maps", self.distance))

    def defines(self, every: bool) -> dict[str, Define]:
        """Macros of kernels_cl/parts/captured_gather.cl.

        Args:
            every: whether all probes are looked at for a point, or the eight around it.
        """
        return {
            **self.placed.defines,
            "SIDE": self.settings.map_texels,
            "HALF_MAPS": self.settings.storage == "fp16",
            "PROBE_VISIBILITY": self.settings.visibility,
            "EVERY_PROBE": every,
        }


def _contents(
    settings: CapturedProbeSettings,
    baked: CapturedProbes,
    specs: list[BufferSpec],
    lengths: tuple[float, ...],
) -> dict[str, npt.NDArray[Any]]:
    """What the buffers hold at first."""
    side, shapes = settings.map_texels, {spec.name: spec.shape for spec in specs}
    states = np.where(baked.usable, ACTIVE if settings.relit else USABLE, 0)
    data: dict[str, npt.NDArray[Any]] = dict(PlacedProbes.contents(baked.volume, lengths=lengths))
    data["probe_data"][:, 3] = states
    dtype = irradiance_maps(settings).dtype
    data["irradiance_maps"] = np.zeros(shapes["irradiance_maps"], dtype)
    if baked.irradiance is not None:
        data["irradiance_maps"][..., :3] = bordered(baked.irradiance, side)
    if settings.visibility:
        data["distance_maps"] = np.zeros(shapes["distance_maps"], dtype)
        if baked.distance is not None:
            data["distance_maps"][:] = bordered(baked.distance, side)
    if settings.gloss_steps:
        data["split_sum"] = split_sum_table()
        data["lobe_maps"] = np.zeros(shapes["lobe_maps"], dtype)
        if baked.lobes:
            data["lobe_maps"][:] = stored_lobes(baked.lobes, side)
    if settings.relit:
        for name in ("albedo", "emission"):
            data[f"captured_{name}"] = np.zeros(shapes[f"captured_{name}"], np.float16)
            data[f"captured_{name}"][..., :3] = _all(baked, name)
        data["captured_hits"] = packed_hits(baked)
        data["relit"] = np.zeros(shapes["relit"], np.int32)
        data["radiance"] = np.zeros(shapes["radiance"], np.float32)
        data["texel_table"] = texel_table(side)
        if settings.visibility:
            data["captured_moments"] = _all(baked, "moments")
    return data


def captured_shares(
    scene: Scene,
    baked: CapturedProbes,
    settings: CapturedProbeSettings,
    motion: MovingObjects | None,
) -> Shares | None:
    """What captured texels show of materials that change; None where none does, or probes are lit
    once.
    """
    if motion is None or motion.materials is None or not settings.relit:
        return None
    triangle = np.stack([own.triangle for own in baked.maps]).reshape(-1)
    albedo, emission = (_all(baked, name).reshape(-1, 3) for name in ("albedo", "emission"))
    return Shares.of_triangles(scene, motion.materials, triangle, albedo, emission)


def packed_hits(baked: CapturedProbes) -> npt.NDArray[np.uint32]:
    """Triangle, NO_FRONT where there is none, and barycentric weights of 16 bits each,
    (p, t, 2) uint32.
    """
    triangle = np.stack([own.triangle for own in baked.maps])
    weights = np.rint(np.clip(_all(baked, "barycentric"), 0, 1) * UNITS).astype(np.uint32)
    both = weights[..., 0] | weights[..., 1] << np.uint32(16)
    hits = np.where(triangle >= 0, triangle.astype(np.uint32), np.uint32(NO_FRONT))
    return np.stack([hits, both], axis=2)


def _all(baked: CapturedProbes, name: str) -> Floats:
    return np.stack([getattr(own, name) for own in baked.maps])
