"""The two variants of blending, and how each keeps the rays' results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from gibench.device import (
    Argument,
    Buffer,
    BufferSpec,
    Launch,
    ProgramSpec,
    integer,
    local,
    reads,
    scalar,
    updates,
    writes,
)
from gibench.device.build import Define
from gibench.errors import CannotRun
from gibench.techniques.ddgi.probes import RAY_PLANES, Probes
from gibench.techniques.ddgi.settings import DdgiSettings

LIST_STEP = 4
"""Lists of rays are as long as a multiple of it."""
# Rays whose cosine to the exponent is less are left out of the distance lists: even 1000 of them
# change a mean by less than 1e-6 of the weight of one ray in a texel's middle.
LEAST_WEIGHT = 1e-9


class Blending(Protocol):
    """A variant of blending.

    Attributes:
        lanes: probes whose rays lie side by side.
        width: floats per vector, of blending and of the gather.
        rays: what probe_shade writes and blending reads.
    """

    lanes: int
    width: int
    rays: Buffer

    def irradiance(self) -> Sequence[Launch]:
        """The launches of blend_irradiance."""
        ...

    def distance(self) -> Sequence[Launch]:
        """The launches of blend_distance."""
        ...


class Published:
    """A group per probe, its rays staged in local memory (RTXGI-DDGI 1.3.7).

    Args:
        probes: what is blended into.
    """

    lanes = width = 1

    def __init__(self, probes: Probes) -> None:
        self.probes = probes
        held = probes.device.allocate(Published.buffers(probes.settings, probes.volume.probes))
        self.rays = held["rays"]

    @staticmethod
    def buffers(settings: DdgiSettings, probes: int) -> list[BufferSpec]:
        """The buffers for so many probes."""
        return [BufferSpec.of("rays", (probes, settings.blended, 4), np.float32)]

    def irradiance(self) -> Sequence[Launch]:
        """One launch, a group per probe."""
        return self._launch("blend_irradiance", 7, irradiance_results(self.probes))

    def distance(self) -> Sequence[Launch]:
        """One launch, a group per probe."""
        return self._launch("blend_distance", 4, distance_results(self.probes))

    def _launch(self, kernel: str, floats: int, results: tuple[Argument, ...]) -> Sequence[Launch]:
        p, profile = self.probes, self.probes.device.profile
        chunk = min(p.settings.blended, profile.local_memory_bytes // (4 * floats))
        if chunk == 0:
            raise CannotRun(f"profile {profile.name} has too little local memory")
        defines: dict[str, Define] = {**p.defines(self.lanes), "CHUNK": chunk}
        program = ProgramSpec("ddgi/published_blend.cl", defines)
        args = (
            *p.volume_args,
            reads("directions", p.directions),
            reads("rays", self.rays),
            reads("frame_table", p.frame_table),
            *results,
            local("staged", 4 * floats * chunk),
        )
        return [Launch(program, kernel, args, groups=p.volume.probes)]


class Tuned:
    """Sparse matrix products over vectors of probes; a frame's weights are computed once.

    Args:
        probes: what is blended into.
    """

    def __init__(self, probes: Probes) -> None:
        self.probes = probes
        device, s = probes.device, probes.settings
        self.width = device.vector_width
        self.lanes = lanes_of(device.vector_width, device.profile.simd_width)
        held = device.allocate(Tuned.buffers(s, probes.volume.probes, self.lanes))
        self.rays, self._backs = held["rays"], held["backface_counts"]
        self._lists = {
            name: (held[f"{name}_lengths"], held[f"{name}_rays"], held[f"{name}_weights"])
            for name in ("irradiance", "distance")
        }

    @staticmethod
    def buffers(settings: DdgiSettings, probes: int, lanes: int) -> list[BufferSpec]:
        """The buffers for so many probes, ``lanes`` of them side by side."""
        s, of = settings, BufferSpec.of
        length, shape = list_length(s.blended), (-(-probes // lanes), s.blended, RAY_PLANES, lanes)
        found = [of("rays", shape, np.float32), of("backface_counts", probes, np.float32)]
        for name, side in (("irradiance", s.irradiance_texels), ("distance", s.distance_texels)):
            found += [
                of(f"{name}_lengths", side**2, np.int32),
                of(f"{name}_rays", (side**2, length), np.int32),
                of(f"{name}_weights", (side**2, length), np.float32),
            ]
        return found

    def irradiance(self) -> Sequence[Launch]:
        """The frame's weights, the rays on backs, then the product."""
        p, side = self.probes, self.probes.settings.irradiance_texels
        args = (
            *p.volume_args,
            *self._list_args("irradiance"),
            reads("rays", self.rays),
            reads("backs", self._backs),
            reads("frame_table", p.frame_table),
            *irradiance_results(p),
        )
        return [
            self._weights("irradiance", side, False, 0.0),
            self._backface_counts(),
            self._product("blend_irradiance", args, side),
        ]

    def distance(self) -> Sequence[Launch]:
        """The frame's weights, then the product."""
        p, s = self.probes, self.probes.settings
        args = (
            *p.volume_args,
            *self._list_args("distance"),
            reads("rays", self.rays),
            reads("frame_table", p.frame_table),
            *distance_results(p),
        )
        return [
            self._weights("distance", s.distance_texels, True, least_cosine(s)),
            self._product("blend_distance", args, s.distance_texels),
        ]

    def _weights(self, name: str, side: int, sharp: bool, least: float) -> Launch:
        lengths, rays, weights = self._lists[name]
        args = (
            reads("directions", self.probes.directions),
            integer("side", side),
            integer("sharp", sharp),
            scalar("least", np.float32(least)),
            writes("lengths", lengths),
            writes("list_rays", rays),
            writes("list_weights", weights),
        )
        return Launch(self._program(), "blend_weights", args, items=side**2)

    def _backface_counts(self) -> Launch:
        args = (reads("rays", self.rays), writes("counts", self._backs))
        return Launch(self._program(), "backface_counts", args, items=self.probes.volume.probes)

    def _list_args(self, name: str) -> tuple[Argument, ...]:
        lengths, rays, weights = self._lists[name]
        return (
            reads("lengths", lengths),
            reads("list_rays", rays),
            reads("list_weights", weights),
        )

    def _product(self, kernel: str, args: tuple[Argument, ...], side: int) -> Launch:
        vectors = -(-self.probes.volume.probes // self.lanes) * (self.lanes // self.width)
        return Launch(self._program(), kernel, args, items=vectors * side**2)

    def _program(self) -> ProgramSpec:
        defines = {**self.probes.defines(self.lanes), "VEC": self.width, "LIST_STEP": LIST_STEP}
        return ProgramSpec("ddgi/tuned_blend.cl", defines)


def irradiance_results(probes: Probes) -> tuple[Argument, ...]:
    """What blending the irradiance updates."""
    return (
        updates("irradiance_maps", probes.irradiance),
        updates("variability", probes.variability),
        updates("accepted", probes.accepted),
    )


def distance_results(probes: Probes) -> tuple[Argument, ...]:
    """What blending the distance updates."""
    return (updates("distance_maps", probes.distance),)


def lanes_of(vector_width: int, simd_width: int) -> int:
    """Probes whose rays lie side by side: whole vectors, and what a GPU's SIMD group reads."""
    return max(16, vector_width, simd_width)


def list_length(blended: int) -> int:
    """Room for a texel's list of rays."""
    return -(-blended // LIST_STEP) * LIST_STEP


def least_cosine(settings: DdgiSettings) -> float:
    """Cosine up to which a ray counts nothing for a distance texel."""
    return float(LEAST_WEIGHT ** (1 / settings.distance_exponent))


def distance_share(settings: DdgiSettings) -> float:
    """Share of the rays that count for a distance texel: a spherical cap's of the sphere."""
    return (1 - least_cosine(settings)) / 2
