"""The probes' data on the device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.device import Argument, Buffer, BufferSpec, Device, reads
from gibench.device.build import Define
from gibench.techniques.ddgi.placement import ray_directions
from gibench.techniques.ddgi.settings import LINEAR, DdgiSettings
from gibench.techniques.parts.octahedral_maps import OctahedralMaps
from gibench.techniques.parts.placed_probes import PlacedProbes
from gibench.techniques.parts.probe_volume import Volume

RAY_PLANES = 6
"""Numbers of a ray, each in a plane of its own, in the tuned variant (kernels_cl/ddgi/rays.cl)."""


def irradiance_maps(settings: DdgiSettings) -> OctahedralMaps:
    """Of every probe (kernels_cl/parts/probe_maps.cl)."""
    return OctahedralMaps(settings.irradiance_texels, 4, settings.storage)


def biases(settings: DdgiSettings, volume: Volume) -> tuple[float, float]:
    """How far from its surface a point is looked up (kernels_cl/parts/probe_gather.cl): along the
    normal and towards the viewer, m.
    """
    spacing = min(volume.spacing)
    return settings.normal_bias * spacing, settings.view_bias * spacing


def distance_maps(settings: DdgiSettings) -> OctahedralMaps:
    """Of every probe (kernels_cl/parts/probe_maps.cl)."""
    return OctahedralMaps(settings.distance_texels, 2, settings.storage)


@dataclass
class Probes:
    """The volume's buffers, shared by all passes.

    Attributes:
        device: where they lie.
        settings: as given.
        placed: the volume, and every probe's offset and state.
        seed: of the rays' rotations.
        irradiance: (p, side + 2, side + 2, 4) maps.
        distance: (p, side + 2, side + 2, 2) maps.
        directions: (rays, 3) float32 of this frame.
        frame_table: (2,) uint32, this frame's random number, and what of a texel stays (a float).
        fixed_distance: (p, fixed) float32, m; one column where none are cast.
        hits: (p, blended, 4) float32.
        accepted: (p,) int32, whether a probe's irradiance was updated.
        variability: (p, texels) float32 coefficients of variation.
        average: (1,) float32, their mean over the usable probes.
        begun: frames begun so far.
    """

    device: Device
    settings: DdgiSettings
    placed: PlacedProbes
    seed: int
    irradiance: Buffer
    distance: Buffer
    directions: Buffer
    frame_table: Buffer
    fixed_distance: Buffer
    hits: Buffer
    accepted: Buffer
    variability: Buffer
    average: Buffer
    begun: int = 0

    @staticmethod
    def create(device: Device, settings: DdgiSettings, volume: Volume, seed: int) -> Probes:
        """Allocate the buffers; every probe is active and holds nothing.

        Raises:
            CannotRun: they do not fit the device's profile.
        """
        data = {
            **PlacedProbes.contents(volume, lengths=biases(settings, volume)),
            "ray_directions": ray_directions(settings, seed, 0),
        }
        held = device.allocate(Probes.buffers(settings, volume.probes), data)
        return Probes(
            device,
            settings,
            PlacedProbes.of(device, volume, held),
            seed,
            irradiance=held["irradiance_maps"],
            distance=held["distance_maps"],
            directions=held["ray_directions"],
            frame_table=held["frame_table"],
            fixed_distance=held["fixed_distance"],
            hits=held["probe_hits"],
            accepted=held["accepted"],
            variability=held["variability"],
            average=held["average_variability"],
        )

    @staticmethod
    def buffers(settings: DdgiSettings, probes: int) -> list[BufferSpec]:
        """The buffers that so many probes take."""
        p, s, f32, of = probes, settings, np.float32, BufferSpec.of
        return [
            *PlacedProbes.buffers(p),
            irradiance_maps(s).buffer("irradiance_maps", p),
            distance_maps(s).buffer("distance_maps", p),
            of("ray_directions", (s.rays, 3), f32),
            of("frame_table", 2, np.uint32),
            of("fixed_distance", (p, max(s.fixed, 1)), f32),
            of("probe_hits", (p, s.blended, 4), f32),
            of("accepted", p, np.int32),
            of("variability", (p, s.irradiance_texels**2), f32),
            of("average_variability", 1, f32),
        ]

    @property
    def volume(self) -> Volume:
        """Where the probes are now."""
        return self.placed.volume

    @property
    def data(self) -> Buffer:
        """(p, 4) float32 offset in m and state of every probe."""
        return self.placed.data

    @property
    def volume_args(self) -> tuple[Argument, ...]:
        """VOLUME_PARAMS of kernels_cl/parts/probe_volume.cl."""
        return self.placed.args

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
        whole = s.exponent == int(s.exponent) and s.exponent <= 16
        return {
            **self.placed.defines,
            "RAYS": s.rays,
            "FIXED": s.fixed,
            "BLENDED": s.blended,
            "LANES": lanes,
            "IRRADIANCE_SIDE": s.irradiance_texels,
            "DISTANCE_SIDE": s.distance_texels,
            "HALF_MAPS": s.storage == "fp16",
            "GAMMA": s.exponent,
            "DECODE": s.exponent / 2,
            "DECODE_HALVES": int(s.exponent) if whole else 0,
            "LINEAR": s.average == LINEAR,
            "PROBE_VISIBILITY": True,
            "RAY_PLANES": RAY_PLANES,
            "IRRADIANCE_THRESHOLD": float(s.irradiance_threshold),
            "BRIGHTNESS_THRESHOLD": float(s.brightness_threshold),
            "DISTANCE_EXPONENT": float(s.distance_exponent),
            "WHOLE_EXPONENT": int(s.distance_exponent) if s.distance_exponent % 1 == 0 else 0,
            # No rays on backs are never too many.
            "MAX_BACKFACES": max(1.0, float(int(s.random_backface_threshold * s.blended))),
            "FIXED_BACKFACE_THRESHOLD": float(s.fixed_backface_threshold),
            "VISIBILITY_FLOOR": float(s.visibility_floor),
            "CRUSH_THRESHOLD": float(s.crush_threshold),
        }

    def begin_frame(self, frame: int) -> None:
        """Turn the rays, and tell how much the frame counts."""
        self.device.write(self.directions, ray_directions(self.settings, self.seed, frame))
        key = np.random.default_rng((self.seed, frame, 1)).integers(0, 2**32, 1, np.uint32)
        kept = np.array([self.settings.kept(self.begun)], np.float32)
        self.device.write(self.frame_table, np.concatenate([key, kept.view(np.uint32)]))
        self.begun += 1

    def scroll_to(self, centre: tuple[float, float, float]) -> None:
        """Move the volume by whole spacings towards ``centre``; probes that enter start anew."""
        self.placed.scroll_to(centre)
