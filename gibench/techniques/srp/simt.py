"""SRP's passes in the layout ``simt``: neighbouring work-items on neighbouring addresses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Floats
from gibench.device import BufferSpec, Launch, ProgramSpec, local, reads, updates, writes
from gibench.errors import CannotRun
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.srp.common import (
    SrpInput,
    TransportSizes,
    extended_radiance,
    transport_passes,
)
from gibench.techniques.srp.pack import sample_sources
from gibench.techniques.srp.pack_simt import WHOLE, SimtShape, SimtSizes, pack_simt
from gibench.techniques.srp.probe_light import LambdaLayout
from gibench.techniques.srp.storage import storage_dtype, storage_macro
from gibench.techniques.technique import Pass


class Simt:
    """A work-group per probe, per piece of a tile of rows and per tile of receivers, or several.

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
        parts = -(-s.samples // shape.chunk(s.samples))
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
        sizes, shape, held = self.given.sizes, self._shape, self._held
        team = shape.probe_team(sizes.coefficients)
        if shape.samples < 1:
            profile = self.given.scene.device.profile
            raise CannotRun(
                f"a group's sums and a sample take {12 * (shape.update_team + 1):,} bytes of local "
                f"memory; profile {profile.name} has {profile.local_memory_bytes:,}",
                mend="lower --workgroup-size",
            )
        chunk, staged = shape.chunk(sizes.samples), team == shape.update_team
        defines: dict[str, int | str] = {
            "SAMPLES": sizes.samples,
            "CHUNK": chunk,
            "COEFFICIENTS": sizes.coefficients,
            "TEAM": team,
            "STAGED": int(staged),
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
            local("gathered", 12 * chunk if staged else 4),
            local("partial", 12 * team if staged else 4),
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
                workgroup_size=shape.update_team,
            ),
            Launch(
                program, "add_parts", sums, groups=turns.count, workgroup_size=shape.update_team
            ),
        ]

    def _projected(self) -> Sequence[Launch]:
        shape, held = self._shape, self._held
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "COEFFICIENTS": self.given.sizes.coefficients,
            "TEAM": shape.team,
            "EACH": shape.each,
            "WHOLE": WHOLE,
            "FETCHES": int(self._shape.together > 1),
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
                workgroup_size=shape.group,
            )
            for kernel, table, args in (
                ("cluster_projection", "row_pieces", products),
                ("add_pieces", "row_tiles", sums),
            )
        ]

    def _transported(self) -> Sequence[Launch]:
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "FETCHES": int(self._shape.together > 1),
            "TEAM": self._shape.tile_team,
            "TILES": self._shape.tiles,
            "VECTOR": int(self._shape.together > 1),
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
                groups=self._held["receiver_tiles"].shape[0] // self._shape.tiles,
                workgroup_size=self._shape.tile,
            )
        ]
