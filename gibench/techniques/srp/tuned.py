"""SRP's passes in the layout ``wide``: explicit vectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Floats
from gibench.device import BufferSpec, Launch, ProgramSpec, integer, local, reads, updates, writes
from gibench.errors import CannotRun
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.srp.common import (
    SrpInput,
    TransportSizes,
    extended_radiance,
    transport_passes,
)
from gibench.techniques.srp.pack import (
    TunedSizes,
    pack_tuned,
    padded,
    padded_basis,
    projection_width,
    sample_sources,
)
from gibench.techniques.srp.probe_light import LambdaLayout
from gibench.techniques.srp.storage import storage_dtype, storage_macro
from gibench.techniques.technique import Pass

# Vectors of coefficients one work-item of the probe update sums at most: three channels of four
# 16-float vectors leave half of AVX-512's 32 registers to operands.
_PROBE_VECTORS = 4

# Blocks of rows one work-group of the projection takes on a device of explicit vectors. PoCL deals
# out whole groups: 6000 blocks in groups of 256 leave one of two cores idle half the time (2.7 ms
# against 1.9 ms in groups of 32, measured on Sponza's sizes).
_BLOCKS_PER_GROUP = 32


class Tuned:
    """Vectors of coefficients and of receivers, blocks of rows, channels fused.

    Args:
        given: what it is built from.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    def __init__(self, given: SrpInput) -> None:
        self.given = given
        device, bake, lightmap = given.scene.device, given.bake, given.receivers.lightmap
        self._width = device.vector_width
        self._projection_width = projection_width(bake.coefficients, self._width)
        self._stride = padded(bake.coefficients, self._width)
        self._share = _BLOCKS_PER_GROUP if self._width > 1 else given.workgroup_size
        texels = given.receivers.texels
        packed = pack_tuned(
            bake, given.receivers.lightmap.receivers.texel, given.storage, self._width
        )
        border = border_texels(lightmap)
        data = {
            "radiance": extended_radiance(given),
            "relight_source": sample_sources(bake.relight, texels),
            "relight_basis": padded_basis(bake.relight, self._width),
            "row_blocks": packed.row_blocks,
            "cluster_probes": packed.probes,
            "projection": packed.projection,
            "scale": packed.scale,
            "receiver_blocks": packed.receiver_blocks,
            "transport_texel": packed.texel,
            "reconstruction": packed.reconstruction,
            "border_texels": border,
        }
        specs = Tuned.buffers(
            given.sizes,
            TunedSizes.of(bake, self._width),
            given.storage,
            texels=texels,
            border=len(border),
            device_width=self._width,
        )
        self._held = device.allocate(specs, data)
        self.radiance = self._held["radiance"]
        self._lambda, self._basis = self._held["lambda"], self._held["light_basis"]
        self.coefficients = self._lambda
        self.layout = LambdaLayout(3 * self._stride, 1, self._stride)

    @staticmethod
    def buffers(
        sizes: TransportSizes,
        packed: TunedSizes,
        storage: str,
        *,
        texels: int,
        border: int,
        device_width: int,
    ) -> list[BufferSpec]:
        """The buffers of transport of these sizes.

        Args:
            sizes: of what is baked.
            packed: of its layout.
            storage: ``fp32``, ``fp16`` or ``snorm16``.
            texels: of a map.
            border: texels to dilate.
            device_width: floats per vector of the executing device.
        """
        s, stored, of = sizes, storage_dtype(storage), BufferSpec.of
        stride = padded(s.coefficients, device_width)
        return [
            FrameLightmap.map_buffer("radiance", texels + s.samples + 1),
            of("relight_source", (s.probes, s.samples), np.int32),
            of("relight_basis", (s.samples, stride), np.float32),
            of("row_blocks", (packed.row_blocks, 5), np.int32),
            of("cluster_probes", packed.probes, np.int32),
            of("projection", packed.projection, stored),
            of("scale", s.rows, np.float32),
            of("receiver_blocks", (packed.receiver_blocks, 3), np.int32),
            of("transport_texel", packed.receiver_blocks * device_width, np.int32),
            of("reconstruction", packed.reconstruction, stored),
            of("border_texels", border, np.int32),
            of("lambda", (s.probes, 3, stride), np.float32),
            of("light_basis", (s.rows, 3), np.float32),
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
        return np.ascontiguousarray(planes.transpose(0, 2, 1)[:, : self.given.sizes.coefficients])

    def _probe_update(self) -> Sequence[Launch]:
        device, samples = self.given.scene.device, self.given.sizes.samples
        chunk = min(samples, device.profile.local_memory_bytes // 12)
        if chunk == 0:
            raise CannotRun(f"profile {device.profile.name} has too little local memory")
        vectors = self._stride // self._width
        together = max(n for n in range(1, _PROBE_VECTORS + 1) if vectors % n == 0)
        defines: dict[str, int | str] = {
            "VEC": self._width,
            "VECTORS": together if self._width > 1 else 1,
            "SAMPLES": samples,
            "CHUNK": chunk,
            "STRIDE": self._stride,
            **self.given.blocked_defines,
        }
        program = ProgramSpec("srp/tuned_probes.cl", defines)
        args = (
            reads("updated", self.given.turns.state),
            reads("source", self._held["relight_source"]),
            reads("basis", self._held["relight_basis"]),
            reads("radiance", self.radiance),
            *self.given.blocked_args,
            updates("lambda", self._lambda),
            local("gathered", 12 * chunk),
        )
        return [Launch(program, "probe_update", args, groups=self.given.turns.count)]

    def _projected(self) -> Sequence[Launch]:
        width = self._projection_width
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "VEC": width,
            "VECTORS": padded(self.given.sizes.coefficients, width) // width,
            "STRIDE": self._stride,
            "SHARE": self._share,
        }
        program = ProgramSpec("srp/tuned_projection.cl", defines)
        count = self._held["row_blocks"].shape[0]
        args = (
            reads("blocks", self._held["row_blocks"]),
            integer("count", count),
            reads("probes", self._held["cluster_probes"]),
            reads("projection", self._held["projection"]),
            reads("scale", self._held["scale"]),
            reads("lambda", self._lambda),
            writes("basis", self._basis),
        )
        return [Launch(program, "cluster_projection", args, groups=-(-count // self._share))]

    def _transported(self) -> Sequence[Launch]:
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "VEC": self._width,
            **self.given.indirect.macros,
        }
        program = ProgramSpec("srp/tuned_transport.cl", defines)
        count = self._held["receiver_blocks"].shape[0]
        args = (
            reads("blocks", self._held["receiver_blocks"]),
            integer("count", count),
            reads("reconstruction", self._held["reconstruction"]),
            reads("texel", self._held["transport_texel"]),
            reads("basis", self._basis),
            updates("indirect", self.given.indirect.map),
        )
        return [Launch(program, "irradiance_transport", args, items=count)]
