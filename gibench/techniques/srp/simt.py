"""SRP's passes in the layout ``simt``: neighbouring work-items on neighbouring addresses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from gibench.arrays import Floats
from gibench.device import BufferSpec, Device, Launch, ProgramSpec, local, reads, updates, writes
from gibench.errors import CannotRun
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.srp.common import (
    SrpInput,
    TransportSizes,
    extended_radiance,
    transport_passes,
)
from gibench.techniques.srp.pack import sample_sources
from gibench.techniques.srp.pack_simt import SimtShape, SimtSizes, pack_simt
from gibench.techniques.srp.probe_light import LambdaLayout
from gibench.techniques.srp.storage import storage_dtype, storage_macro
from gibench.techniques.technique import Pass

_CHUNK: Final = 512
"""Samples of a part of the probe update at most, in 6 KB of local memory: a unit of 64 KB holds
ten groups."""
_PROBE_TEAM: Final = 64
"""Work-items of a group of the probe update: the coefficients of order 7, and a multiple
of every SIMD width there is."""


class Simt:
    """A work-group per probe, per piece of a tile of rows and per tile of receivers.

    Args:
        given: what it is built from.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    def __init__(self, given: SrpInput) -> None:
        self.given = given
        device, bake, texels = given.scene.device, given.bake, given.receivers.texels
        self._shape = SimtShape.of(device.profile, given.workgroup_size, device.lanes_together)
        receivers = given.receivers.lightmap.receivers
        packed = pack_simt(bake, receivers.texel, given.storage, self._shape)
        border = border_texels(given.receivers.lightmap)
        data = {
            "radiance": extended_radiance(given),
            "relight_source": sample_sources(bake.relight, texels),
            "relight_basis": bake.relight.basis,
            "row_pieces": packed.pieces,
            "cluster_probes": packed.probes,
            "projection": packed.projection,
            "row_tiles": packed.row_tiles,
            "scale": packed.scale,
            "receiver_tiles": packed.tiles,
            "transport_texel": packed.texel,
            "reconstruction": packed.reconstruction,
            "border_texels": border,
        }
        sizes = SimtSizes.of(bake, self._shape)
        specs = Simt.buffers(
            given.sizes, sizes, given.storage, self._shape, texels=texels, border=len(border)
        )
        self._held = device.allocate(specs, data)
        self.radiance = self._held["radiance"]
        self._lambda, self._basis = self._held["lambda"], self._held["light_basis"]
        self.coefficients = self._lambda
        count = given.sizes.coefficients
        self.layout = LambdaLayout(3 * count, 1, count)

    @staticmethod
    def buffers(
        sizes: TransportSizes,
        packed: SimtSizes,
        storage: str,
        shape: SimtShape,
        *,
        texels: int,
        border: int,
    ) -> list[BufferSpec]:
        """The buffers of transport of these sizes.

        Args:
            sizes: of what is baked.
            packed: of its layout.
            storage: ``fp32``, ``fp16`` or ``snorm16``.
            shape: sizes that the kernels are compiled for.
            texels: of a map.
            border: texels to dilate.
        """
        s, stored, of = sizes, storage_dtype(storage), BufferSpec.of
        parts = -(-s.samples // probe_chunk(s.samples))
        return [
            FrameLightmap.map_buffer("radiance", texels + s.samples + 1),
            of("relight_source", (s.probes, s.samples), np.int32),
            of("relight_basis", (s.samples, s.coefficients), np.float32),
            of("row_pieces", (packed.pieces, 8), np.int32),
            of("cluster_probes", packed.probes, np.int32),
            of("projection", packed.projection, stored),
            of("partial_basis", (packed.slots, 3, shape.rows), np.float32),
            of("row_tiles", (packed.row_tiles, 4), np.int32),
            of("scale", s.rows, np.float32),
            of("receiver_tiles", (packed.tiles, 6), np.int32),
            of("transport_texel", packed.texels, np.int32),
            of("reconstruction", packed.reconstruction, stored),
            of("border_texels", border, np.int32),
            of("lambda", (s.probes, 3, s.coefficients), np.float32),
            of("lambda_parts", (s.probes, parts, 3, s.coefficients), np.float32),
            of("light_basis", (s.rows, 4), np.float32),
        ]

    def passes(self) -> list[Pass]:
        """Probe update, cluster projection, irradiance transport."""
        return transport_passes(self.given, self._probe_update, self._projected, self._transported)

    def dilate(self) -> Pass:
        """Dilation of the texels that need it."""
        return self.given.indirect.dilate(self._held["border_texels"])

    def probe_radiance(self) -> Floats:
        """The probes' SH coefficients, (p, c, 3) W/m2/sr."""
        planes = self.given.scene.device.read(self._lambda)
        return np.ascontiguousarray(planes.transpose(0, 2, 1))

    def _probe_update(self) -> Sequence[Launch]:
        sizes, profile, held = self.given.sizes, self.given.scene.device.profile, self._held
        team = _probe_team(self.given.scene.device, self.given.workgroup_size)
        chunk = probe_chunk(sizes.samples)
        partial = 12 * team if team >= 2 * sizes.coefficients else 4
        if 12 * chunk + partial > profile.local_memory_bytes:
            raise CannotRun(
                f"a group's samples and sums take {12 * chunk + partial:,} bytes of local memory; "
                f"profile {profile.name} has {profile.local_memory_bytes:,}",
                mend="lower --workgroup-size",
            )
        defines: dict[str, int | str] = {
            "SAMPLES": sizes.samples,
            "CHUNK": chunk,
            "COEFFICIENTS": sizes.coefficients,
            "TEAM": team,
            **self.given.blocked_defines,
        }
        program, turns = ProgramSpec("srp/simt_probes.cl", defines), self.given.turns
        products = (
            reads("updated", turns.state),
            reads("source", held["relight_source"]),
            reads("basis", held["relight_basis"]),
            reads("radiance", self.radiance),
            *self.given.blocked_args,
            writes("sums", held["lambda_parts"]),
            local("gathered", 12 * chunk),
            local("partial", partial),
        )
        sums = (
            reads("updated", turns.state),
            reads("sums", held["lambda_parts"]),
            updates("lambda", self._lambda),
        )
        parts = -(-sizes.samples // chunk)
        return [
            Launch(
                program,
                "probe_update",
                products,
                groups=lambda: turns.count() * parts,
                workgroup_size=team,
            ),
            Launch(program, "add_parts", sums, groups=turns.count, workgroup_size=team),
        ]

    def _projected(self) -> Sequence[Launch]:
        shape, held = self._shape, self._held
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "COEFFICIENTS": self.given.sizes.coefficients,
            "TEAM": shape.team,
            "EACH": shape.each,
            "FETCHES": int(self.given.scene.device.is_processor),
        }
        program = ProgramSpec("srp/simt_projection.cl", defines)
        products = (
            reads("pieces", held["row_pieces"]),
            reads("probes", held["cluster_probes"]),
            reads("projection", held["projection"]),
            reads("scale", held["scale"]),
            reads("lambda", self._lambda),
            writes("partial", held["partial_basis"]),
            writes("basis", self._basis),
        )
        sums = (
            reads("row_tiles", held["row_tiles"]),
            reads("partial", held["partial_basis"]),
            reads("scale", held["scale"]),
            updates("basis", self._basis),
        )
        return [
            Launch(
                program,
                kernel,
                args,
                groups=held[table].shape[0],
                workgroup_size=shape.team,
            )
            for kernel, table, args in (
                ("cluster_projection", "row_pieces", products),
                ("add_pieces", "row_tiles", sums),
            )
        ]

    def _transported(self) -> Sequence[Launch]:
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "FETCHES": int(self.given.scene.device.is_processor),
            **self.given.indirect.macros,
        }
        args = (
            reads("tiles", self._held["receiver_tiles"]),
            reads("reconstruction", self._held["reconstruction"]),
            reads("texel", self._held["transport_texel"]),
            reads("basis", self._basis),
            updates("indirect", self.given.indirect.map),
        )
        return [
            Launch(
                ProgramSpec("srp/simt_transport.cl", defines),
                "irradiance_transport",
                args,
                groups=self._held["receiver_tiles"].shape[0],
                workgroup_size=self._shape.tile,
            )
        ]


def probe_chunk(samples: int) -> int:
    """Samples of a part of a probe's."""
    return min(_CHUNK, -(-samples // 2))


def _probe_team(device: Device, workgroup_size: int) -> int:
    """Work-items of a group of the probe update, no more than asked: on a CPU that vectorises over
    work-items one vector, whose work-items sum several coefficients each.
    """
    gpu = max(_PROBE_TEAM, device.profile.simd_width)
    return min(workgroup_size, device.lanes_together if device.lanes_together > 1 else gpu)
