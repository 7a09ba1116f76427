"""The probes' data on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gibench.device import Argument, Buffer, BufferSpec, Device, reads, total_bytes
from gibench.device.build import Define
from gibench.techniques.ddgi.placement import ray_directions
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.parts.probe_volume import Volume

# Bits of a probe's state, kernels_cl/parts/probe_gather.cl.
ACTIVE = 1
BLENDED = 2
USABLE = ACTIVE | BLENDED

VOLUME_FLOATS = 9  # kernels_cl/parts/probe_volume.cl

STORED: dict[str, np.dtype[Any]] = {"fp32": np.dtype("f4"), "fp16": np.dtype("f2")}


@dataclass
class Probes:
    """The volume's buffers, shared by all passes.

    Attributes:
        device: where they lie.
        settings: as given.
        volume: where the probes are now.
        seed: of the rays' rotations.
        table: (9,) float32, the volume as the kernels read it.
        data: (p, 4) float32 offset in m and state of every probe.
        irradiance: (p, side + 2, side + 2, 4) maps.
        distance: (p, side + 2, side + 2, 2) maps.
        directions: (rays, 3) float32 of this frame.
        frame_key: (1,) uint32, this frame's random number.
        fixed_distance: (p, fixed) float32, m; one column where none are cast.
        hits: (p, blended, 4) float32.
        accepted: (p,) int32, whether a probe's irradiance was updated.
        variability: (p, texels) float32 coefficients of variation.
        average: (1,) float32, their mean over the usable probes.
    """

    device: Device
    settings: DdgiSettings
    volume: Volume
    seed: int
    table: Buffer
    data: Buffer
    irradiance: Buffer
    distance: Buffer
    directions: Buffer
    frame_key: Buffer
    fixed_distance: Buffer
    hits: Buffer
    accepted: Buffer
    variability: Buffer
    average: Buffer

    @staticmethod
    def create(device: Device, settings: DdgiSettings, volume: Volume, seed: int) -> Probes:
        """Allocate the buffers; every probe is active and holds nothing.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        data = {
            "volume": volume.table(),
            "probe_data": new_probes(volume.probes),
            "ray_directions": ray_directions(settings, seed, 0),
        }
        held = device.allocate(Probes.buffers(settings, volume.probes), data)
        return Probes(
            device,
            settings,
            volume,
            seed,
            table=held["volume"],
            data=held["probe_data"],
            irradiance=held["irradiance_maps"],
            distance=held["distance_maps"],
            directions=held["ray_directions"],
            frame_key=held["frame_key"],
            fixed_distance=held["fixed_distance"],
            hits=held["probe_hits"],
            accepted=held["accepted"],
            variability=held["variability"],
            average=held["average_variability"],
        )

    @staticmethod
    def buffers(settings: DdgiSettings, probes: int) -> list[BufferSpec]:
        """The buffers that so many probes take."""
        p, s, stored = probes, settings, STORED[settings.storage]
        across, far = s.irradiance_texels + 2, s.distance_texels + 2
        f32, of = np.float32, BufferSpec.of
        return [
            of("volume", VOLUME_FLOATS, f32),
            of("probe_data", (p, 4), f32),
            of("irradiance_maps", (p, across, across, 4), stored),
            of("distance_maps", (p, far, far, 2), stored),
            of("ray_directions", (s.rays, 3), f32),
            of("frame_key", 1, np.uint32),
            of("fixed_distance", (p, max(s.fixed, 1)), f32),
            of("probe_hits", (p, s.blended, 4), f32),
            of("accepted", p, np.int32),
            of("variability", (p, s.irradiance_texels**2), f32),
            of("average_variability", 1, f32),
        ]

    @staticmethod
    def bytes_of(settings: DdgiSettings, probes: int) -> int:
        """Bytes that the buffers of so many probes take."""
        return total_bytes(Probes.buffers(settings, probes))

    @property
    def nbytes(self) -> int:
        """Bytes they take on the device, in closed form."""
        return self.bytes_of(self.settings, self.volume.probes)

    @property
    def volume_args(self) -> tuple[Argument, ...]:
        """VOLUME_PARAMS of kernels_cl/parts/probe_gather.cl."""
        return reads("volume", self.table), reads("probe_data", self.data)

    @property
    def map_args(self) -> tuple[Argument, ...]:
        """MAP_PARAMS of kernels_cl/parts/probe_gather.cl."""
        return (
            reads("irradiance_maps", self.irradiance),
            reads("distance_maps", self.distance),
        )

    @property
    def min_frontface(self) -> float:
        """Distance that relocation keeps from surfaces, m."""
        return self.settings.min_frontface_distance * min(self.volume.spacing)

    def defines(self, lanes: int) -> dict[str, Define]:
        """The macros of the kernels in kernels_cl/ddgi; lengths in metres.

        Args:
            lanes: probes whose rays lie side by side (kernels_cl/ddgi/rays.cl).
        """
        s = self.settings
        x, y, z = self.volume.counts
        whole = s.gamma == int(s.gamma) and s.gamma <= 16
        return {
            "PROBES": self.volume.probes,
            "COUNT_X": x,
            "COUNT_Y": y,
            "COUNT_Z": z,
            "RAYS": s.rays,
            "FIXED": s.fixed,
            "BLENDED": s.blended,
            "LANES": lanes,
            "IRRADIANCE_SIDE": s.irradiance_texels,
            "DISTANCE_SIDE": s.distance_texels,
            "HALF_STORAGE": s.storage == "fp16",
            "GAMMA": float(s.gamma),
            "DECODE": s.gamma / 2,
            "DECODE_HALVES": int(s.gamma) if whole else 0,
            "HYSTERESIS": float(s.hysteresis),
            "IRRADIANCE_THRESHOLD": float(s.irradiance_threshold),
            "BRIGHTNESS_THRESHOLD": float(s.brightness_threshold),
            "DISTANCE_EXPONENT": float(s.distance_exponent),
            "WHOLE_EXPONENT": int(s.distance_exponent) if s.distance_exponent % 1 == 0 else 0,
            # No rays on backs are never too many.
            "MAX_BACKFACES": max(1.0, float(int(s.random_backface_threshold * s.blended))),
            "FIXED_BACKFACE_THRESHOLD": float(s.fixed_backface_threshold),
            "NORMAL_BIAS": s.normal_bias * min(self.volume.spacing),
            "VIEW_BIAS": s.view_bias * min(self.volume.spacing),
            "VISIBILITY_FLOOR": float(s.visibility_floor),
            "CRUSH_THRESHOLD": float(s.crush_threshold),
        }

    def begin_frame(self, frame: int) -> None:
        """Turn the rays."""
        self.device.write(self.directions, ray_directions(self.settings, self.seed, frame))
        key = np.random.default_rng((self.seed, frame, 1)).integers(0, 2**32, 1, np.uint32)
        self.device.write(self.frame_key, key)

    def scroll_to(self, centre: tuple[float, float, float]) -> None:
        """Move the volume by whole spacings towards ``centre``; probes that enter start anew."""
        moved = self.volume.scrolled(centre)
        steps = np.array(moved.scroll) - self.volume.scroll
        if not steps.any():
            return
        self.volume = moved
        counts = np.array(moved.counts)
        c = moved.coordinates
        entered = ((steps > 0) & (c >= counts - steps)) | ((steps < 0) & (c < -steps))
        data = self.device.read(self.data)
        data[entered.any(axis=1)] = new_probes(1)
        self.device.write(self.data, data)
        self.device.write(self.table, moved.table())


def new_probes(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """Data (count, 4) of active probes on the grid that hold nothing yet."""
    data = np.zeros((count, 4), np.float32)
    data[:, 3] = ACTIVE
    return data
