"""SRP's passes laid out for the executing device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Floats
from gibench.device import Launch, ProgramSpec, integer, local, reads, updates, writes
from gibench.errors import CannotRun
from gibench.scene.lightmap import Lightmap
from gibench.techniques.parts.frame_lightmap import border_texels
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.common import SrpInput
from gibench.techniques.srp.pack import (
    ROW_BLOCK,
    pack_tuned,
    padded,
    padded_basis,
    projection_width,
    sample_sources,
)
from gibench.techniques.srp.storage import storage_bytes, storage_macro
from gibench.techniques.technique import Pass

# Vectors of coefficients one work-item of the probe update sums at most: three channels of four
# 16-float vectors leave half of AVX-512's 32 registers to operands.
_PROBE_VECTORS = 4

# Blocks of rows one work-group of the projection takes on a device of explicit vectors. PoCL deals
# out whole groups: 6000 blocks in groups of 256 leave one of two cores idle half the time (2.7 ms
# against 1.9 ms in groups of 32, measured on Sponza's sizes).
_BLOCKS_PER_GROUP = 32


def tuned_bytes(bake: SrpBake, lightmap: Lightmap, storage: str, device_width: int) -> int:
    """Bytes of device memory that :class:`Tuned` takes."""
    c, width = bake.coefficients, storage_bytes(storage)
    stride, samples = padded(c, device_width), bake.relight.texel.shape[1]
    probe_values = padded(c, projection_width(c, device_width))
    total: int = 4 * len(border_texels(lightmap))
    total += 16 * (lightmap.width * lightmap.height + samples + 1)
    total += 4 * samples * stride + 4 * bake.relight.texel.size
    total += 12 * len(bake.probes) * stride
    for cluster in bake.clusters:
        rows, probes = len(cluster.projection), len(cluster.probes)
        if rows:
            slots = padded(len(cluster.receivers), device_width)
            total += 20 * -(-rows // ROW_BLOCK) + 4 * probes + 4 * rows + 12 * rows
            total += 12 * (slots // device_width) + 4 * slots
            total += width * rows * (probes * probe_values + slots)
    return total


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
        samples = given.sizes.samples
        self.radiance = given.receivers.new_map("radiance", extra=samples + 1)
        # The environment does not change from frame to frame: its radiance in the relight
        # directions, which all probes share, is put behind the texels once.
        texels = given.receivers.texels
        everything = device.read(self.radiance)
        everything[texels : texels + samples, :3] = given.scene.scene.environment.radiance(
            bake.relight.directions
        )
        device.write(self.radiance, everything)
        self._source = device.upload("relight_source", sample_sources(bake.relight, texels))
        self._relight_basis = device.upload(
            "relight_basis", padded_basis(bake.relight, self._width)
        )
        packed = pack_tuned(bake, given.indirect.entries, given.storage, self._width)
        self._row_blocks = device.upload("row_blocks", packed.row_blocks)
        self._probes = device.upload("cluster_probes", packed.probes)
        self._projection = device.upload("projection", packed.projection)
        self._scale = device.upload("scale", packed.scale)
        self._receiver_blocks = device.upload("receiver_blocks", packed.receiver_blocks)
        self._texel = device.upload("transport_texel", packed.texel)
        self._reconstruction = device.upload("reconstruction", packed.reconstruction)
        self._border = device.upload("border_texels", border_texels(lightmap))
        shape = (given.sizes.probes, 3, self._stride)
        self._lambda = device.empty("lambda", shape, np.float32)
        self._basis = device.empty("light_basis", (given.sizes.rows, 3), np.float32)

    def passes(self) -> list[Pass]:
        """Probe update, cluster projection, irradiance transport."""
        sizes, storage = self.given.sizes, self.given.storage
        return [
            Pass("probe_update", self._probe_update, sizes.probe_update_work(self.given.fraction)),
            Pass("cluster_projection", self._projected, sizes.projection_work(storage)),
            Pass("irradiance_transport", self._transported, sizes.transport_work(storage)),
        ]

    def dilate(self) -> Pass:
        """Dilation of the texels that need it."""
        return self.given.indirect.dilate(self._border)

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
        }
        program = ProgramSpec("srp/tuned_probes.cl", defines)
        args = (
            reads("frame_state", self.given.turns.state),
            reads("source", self._source),
            reads("basis", self._relight_basis),
            reads("radiance", self.radiance),
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
        count = self._row_blocks.shape[0]
        args = (
            reads("blocks", self._row_blocks),
            integer("count", count),
            reads("probes", self._probes),
            reads("projection", self._projection),
            reads("scale", self._scale),
            reads("lambda", self._lambda),
            writes("basis", self._basis),
        )
        return [Launch(program, "cluster_projection", args, groups=-(-count // self._share))]

    def _transported(self) -> Sequence[Launch]:
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "VEC": self._width,
        }
        program = ProgramSpec("srp/tuned_transport.cl", defines)
        count = self._receiver_blocks.shape[0]
        args = (
            reads("blocks", self._receiver_blocks),
            integer("count", count),
            reads("reconstruction", self._reconstruction),
            reads("texel", self._texel),
            reads("basis", self._basis),
            updates("indirect", self.given.indirect.map),
        )
        return [Launch(program, "irradiance_transport", args, items=count)]
