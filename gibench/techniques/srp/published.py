"""SRP's passes as Bennett 2019 structures them (sections 5.2 and 5.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Floats
from gibench.device import BufferSpec, Launch, ProgramSpec, integer, local, reads, updates, writes
from gibench.errors import CannotRun
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.srp.common import SrpInput, TransportSizes, transport_passes
from gibench.techniques.srp.pack import pack_published, pack_samples
from gibench.techniques.srp.probe_light import LambdaLayout
from gibench.techniques.srp.storage import storage_dtype, storage_macro
from gibench.techniques.technique import Pass


class Published:
    """One group per probe, one work-item per matrix row, one per receiver.

    Args:
        given: what it is built from.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    def __init__(self, given: SrpInput) -> None:
        self.given = given
        bake, texels = given.bake, given.receivers.texels
        lists = pack_samples(bake.relight, black=given.blocked is not None)
        packed = pack_published(bake, given.receivers.lightmap.receivers.texel, given.storage)
        data = {
            "radiance": given.receivers.black(),
            "hit_start": lists.hit_start,
            "hit_sample": lists.hit_sample,
            "hit_texel": lists.hit_texel,
            "miss_start": lists.miss_start,
            "miss_sample": lists.miss_sample,
            "relight_directions": bake.relight.directions,
            "relight_basis": bake.relight.basis,
            "clusters": packed.clusters,
            "row_cluster": packed.row_cluster,
            "columns": packed.columns,
            "projection": packed.projection,
            "scale": packed.scale,
            "receiver_cluster": packed.receiver_cluster,
            "first_value": packed.first_value,
            "transport_texel": packed.texel,
            "reconstruction": packed.reconstruction,
        }
        self._held = given.scene.device.allocate(
            Published.buffers(given.sizes, given.storage, texels), data
        )
        self.radiance = self._held["radiance"]
        self._lambda, self._basis = self._held["lambda"], self._held["light_basis"]
        self.coefficients = self._lambda
        self.layout = LambdaLayout(3 * given.sizes.coefficients, 3, 1)

    @staticmethod
    def buffers(sizes: TransportSizes, storage: str, texels: int) -> list[BufferSpec]:
        """The buffers of transport of these sizes over a map of so many texels."""
        s, stored, of = sizes, storage_dtype(storage), BufferSpec.of

        def ints(name: str, *shape: int) -> BufferSpec:
            return of(name, shape, np.int32)

        return [
            FrameLightmap.map_buffer("radiance", texels),
            ints("hit_start", s.probes + 1),
            ints("hit_sample", s.hits),
            ints("hit_texel", s.hits),
            ints("miss_start", s.probes + 1),
            ints("miss_sample", s.misses),
            of("relight_directions", (s.samples, 3), np.float32),
            of("relight_basis", (s.samples, s.coefficients), np.float32),
            ints("clusters", s.clusters, 5),
            ints("row_cluster", s.rows),
            ints("columns", s.columns),
            of("projection", s.projection, stored),
            of("scale", s.rows, np.float32),
            ints("receiver_cluster", s.receivers),
            ints("first_value", s.receivers),
            ints("transport_texel", s.receivers),
            of("reconstruction", s.reconstruction, stored),
            of("lambda", (s.probes, s.coefficients, 3), np.float32),
            of("light_basis", (s.rows, 3), np.float32),
        ]

    def passes(self) -> list[Pass]:
        """Probe update, cluster projection, irradiance transport."""
        return transport_passes(self.given, self._probe_update, self._projected, self._transported)

    def dilate(self) -> Pass:
        """Dilation that looks at every texel."""
        return self.given.indirect.dilate()

    def probe_radiance(self) -> Floats:
        """The probes' SH coefficients, (p, c, 3) W/m2/sr."""
        return self.given.scene.device.read(self._lambda)

    def _probe_update(self) -> Sequence[Launch]:
        device, given, held = self.given.scene.device, self.given, self._held
        per_coefficient = 12 * given.workgroup_size
        chunk = min(given.sizes.coefficients, device.profile.local_memory_bytes // per_coefficient)
        if chunk == 0:
            raise CannotRun(
                f"the sums of one coefficient take {per_coefficient:,} bytes of local memory; "
                f"profile {device.profile.name} has {device.profile.local_memory_bytes:,}",
                mend="lower --workgroup-size",
            )
        defines = {"CHUNK": chunk, **given.blocked_defines}
        program = ProgramSpec("srp/published_probes.cl", defines)
        args = (
            reads("updated", given.turns.state),
            reads("hit_start", held["hit_start"]),
            reads("hit_sample", held["hit_sample"]),
            reads("hit_texel", held["hit_texel"]),
            reads("miss_start", held["miss_start"]),
            reads("miss_sample", held["miss_sample"]),
            reads("directions", held["relight_directions"]),
            reads("basis", held["relight_basis"]),
            integer("coefficients", given.sizes.coefficients),
            reads("radiance", self.radiance),
            *given.scene.environment_args,
            *given.blocked_args,
            updates("lambda", self._lambda),
            local("sums", chunk * per_coefficient),
        )
        return [Launch(program, "probe_update", args, groups=given.turns.count)]

    def _projected(self) -> Sequence[Launch]:
        rows, held = self.given.sizes.rows, self._held
        args = (
            reads("clusters", held["clusters"]),
            reads("row_cluster", held["row_cluster"]),
            reads("columns", held["columns"]),
            reads("projection", held["projection"]),
            reads("scale", held["scale"]),
            reads("lambda", self._lambda),
            integer("rows", rows),
            writes("basis", self._basis),
        )
        return [Launch(self._program(), "cluster_projection", args, items=rows)]

    def _transported(self) -> Sequence[Launch]:
        receivers, held = self.given.sizes.receivers, self._held
        args = (
            reads("clusters", held["clusters"]),
            reads("receiver_cluster", held["receiver_cluster"]),
            reads("reconstruction", held["reconstruction"]),
            reads("first_value", held["first_value"]),
            reads("texel", held["transport_texel"]),
            reads("basis", self._basis),
            integer("receivers", receivers),
            updates("indirect", self.given.indirect.map),
        )
        return [Launch(self._program(), "irradiance_transport", args, items=receivers)]

    def _program(self) -> ProgramSpec:
        defines: dict[str, int | str] = {
            "STORAGE": storage_macro(self.given.storage),
            "VEC": 1,
            **self.given.indirect.macros,
        }
        return ProgramSpec("srp/published_transport.cl", defines)
