"""The probes' light anywhere, for what moves: how far each sees, and what kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gibench.arrays import Floats
from gibench.device import Argument, Buffer, BufferSpec, Device, Launch, integer, reads, writes
from gibench.device.build import Define
from gibench.rays.tracer import RayTracer
from gibench.scene.model import Scene
from gibench.techniques.parts.camera_pass import Application, lookup_defines
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.octahedral_maps import octahedral_decode
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.srp.bake.data import ProbeSet

DEPTH_SIDE: Final = 16
"""Texels of a side of a probe's map of distances."""
_PARTS: Final = 4  # rays along each side of a texel
LEAST_SEEN: Final = 1e-3
"""The least share of a probe in reach: with all of them hidden, the nearest ones count."""
DEPTH_BIAS: Final = 0.02
"""Taken off a distance before it is compared, in radii of a probe's support."""
GATHER_ORDER: Final = 2
"""Order of what is convolved: irradiance has 99 % of its energy there (Ramamoorthi and Hanrahan
2001)."""

SOURCE = "srp/moving_application.cl"

# Of a lookup at a surface that rests: as parts/lightmap_lookup.py counts it.
_LOOKUP_FLOPS = 2 + 2 * 5 + 2 * 3 + 3 * 3 * 3


@dataclass(frozen=True)
class LambdaLayout:
    """How many floats apart two probes, coefficients and channels lie in a variant's lambda."""

    probe: int
    coefficient: int
    channel: int


def probe_depths(probes: ProbeSet, tracer: RayTracer, far: float) -> Floats:
    """How far it is from every probe to what rests: (p, DEPTH_SIDE + 2, DEPTH_SIDE + 2, 2) float32,
    octahedral maps with border of the mean distance, m, and the mean squared distance, over
    ``_PARTS`` times ``_PARTS`` rays in each texel.

    Args:
        probes: where from.
        tracer: of what rests.
        far: taken for rays that meet nothing, m.
    """
    side, fine = DEPTH_SIDE, DEPTH_SIDE * _PARTS
    at = (np.arange(fine) + 0.5) / fine * 2 - 1
    x, y = np.meshgrid(at, at)
    directions = octahedral_decode(np.stack([x.ravel(), y.ravel()], axis=1)).astype(np.float32)
    found = np.empty((len(probes), side, side, 2), np.float32)
    for number, position in enumerate(probes.positions.astype(np.float32)):
        hits = tracer.closest(np.broadcast_to(position, directions.shape), directions)
        distance = np.minimum(np.where(hits.triangle >= 0, hits.distance, far), far).astype(
            np.float64
        )
        cells = distance.reshape(side, _PARTS, side, _PARTS)
        found[number, :, :, 0] = cells.mean(axis=(1, 3))
        found[number, :, :, 1] = (cells**2).mean(axis=(1, 3))
    return with_borders(found)


def with_borders(maps: Floats) -> Floats:
    """Octahedral maps (p, s, s, c) with a border of one texel, in which they go on: beyond an edge
    mirrored about its middle (Cigolle et al. 2014).
    """
    side = maps.shape[1]
    row, column = (a - 1 for a in np.indices((side + 2, side + 2)))
    outside_row, outside_column = ((a < 0) | (a >= side) for a in (row, column))
    r = np.clip(np.where(outside_column, side - 1 - row, row), 0, side - 1)
    c = np.clip(np.where(outside_row, side - 1 - column, column), 0, side - 1)
    return np.ascontiguousarray(maps[:, r, c])


def relight_reach(probes: ProbeSet, directions: Floats, tracer: RayTracer) -> Floats:
    """How far each relight ray goes until it meets what rests, (p, s) float32 m; inf where it
    escapes.
    """
    found = np.empty((len(probes), len(directions)), np.float32)
    for number, position in enumerate(probes.positions.astype(np.float32)):
        hits = tracer.closest(np.broadcast_to(position, directions.shape), directions)
        found[number] = np.where(hits.triangle >= 0, hits.distance, np.inf)
    return found


@dataclass(frozen=True)
class ProbeLight:
    """The probes' light anywhere (kernels_cl/srp/probe_light.cl).

    Attributes:
        probes: the probes.
        order: of their spherical harmonics.
        position: (p, 3) float32, m.
        depth: of :func:`probe_depths`.
    """

    probes: ProbeSet = field(repr=False)
    order: int
    position: Buffer
    depth: Buffer

    @staticmethod
    def create(
        device: Device, probes: ProbeSet, order: int, tracer: RayTracer, scene: Scene
    ) -> ProbeLight:
        """What the kernels read of ``probes`` in ``scene``, of which ``tracer`` holds what rests.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        low, high = scene.bounds
        far = float(np.linalg.norm(high - low))
        held = device.allocate(
            ProbeLight.buffers(len(probes)),
            {
                "probe_position": probes.positions.astype(np.float32),
                "probe_depth": probe_depths(probes, tracer, far),
            },
        )
        return ProbeLight(probes, order, held["probe_position"], held["probe_depth"])

    @staticmethod
    def buffers(probes: int) -> list[BufferSpec]:
        """The buffers of so many probes."""
        of, across = BufferSpec.of, DEPTH_SIDE + 2
        return [
            of("probe_position", (probes, 3), np.float32),
            of("probe_depth", (probes, across, across, 2), np.float32),
        ]

    def args(self, radiance: Buffer) -> Sequence[Argument]:
        """PROBE_LIGHT_PARAMS, with the probes' coefficients."""
        return (
            reads("probe_position", self.position),
            reads("probe_depth", self.depth),
            reads("lambda", radiance),
        )

    def defines(self, layout: LambdaLayout) -> dict[str, Define]:
        """The macros of programs that include it."""
        radius = float(self.probes.radius)
        return {
            "PROBES": len(self.probes),
            "PROBE_RADIUS": radius,
            "LAMBDA_PROBE": layout.probe,
            "LAMBDA_COEFFICIENT": layout.coefficient,
            "LAMBDA_CHANNEL": layout.channel,
            "SH_ORDER": min(GATHER_ORDER, self.order),
            "DEPTH_SIDE": DEPTH_SIDE,
            "LEAST_SEEN": LEAST_SEEN,
            "DEPTH_BIAS": DEPTH_BIAS * radius,
            "HALF_MAPS": 0,
            "VEC": 1,
        }

    def application(
        self,
        scene: FrameScene,
        hits: HitBuffer,
        signal: ReceiverSignal,
        radiance: Buffer,
        layout: LambdaLayout,
        packets: bool,
    ) -> Application:
        """The light of a map of irradiance on what rests, and the probes' on what moves."""
        defines = {**self.defines(layout), **lookup_defines(scene.device), **signal.macros}
        return Application(
            scene=scene,
            hits=hits,
            program=scene.program(SOURCE, defines),
            args=(*signal.lookup_args, *scene.surfaces.shape_args, *self.args(radiance)),
            flops=_LOOKUP_FLOPS,
            packets=packets,
        )

    def receivers(
        self,
        application: Application,
        radiance: Buffer,
        position: Buffer,
        normal: Buffer,
        irradiance: Buffer,
    ) -> Launch:
        """The launch that gathers irradiance at points (n, 3) with normals (n, 3)."""
        count = position.shape[0]
        args = (
            *self.args(radiance),
            reads("position", position),
            reads("normal", normal),
            integer("count", count),
            writes("irradiance", irradiance),
        )
        return Launch(application.program, "receiver_irradiance", args, items=count)
