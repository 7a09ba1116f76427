"""SRP's passes as Bennett 2019 structures them (sections 5.2 and 5.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Floats
from gibench.device import Launch, ProgramSpec, integer, local, reads, updates, writes
from gibench.errors import CannotRun
from gibench.techniques.srp.common import SrpInput, TransportSizes
from gibench.techniques.srp.pack import pack_published, pack_samples
from gibench.techniques.srp.storage import storage_bytes, storage_macro
from gibench.techniques.technique import Pass


def published_bytes(sizes: TransportSizes, storage: str, texels: int) -> int:
    """Bytes of device memory that :class:`Published` takes."""
    s, width = sizes, storage_bytes(storage)
    lists = 8 * (s.probes + 1) + 8 * s.hits + 4 * s.misses
    relight = 12 * s.samples + 4 * s.samples * s.coefficients
    tables = 20 * s.clusters + 8 * s.rows + 4 * s.columns + 12 * s.receivers
    results = 12 * s.probes * s.coefficients + 12 * s.rows + 16 * texels
    return lists + relight + tables + results + width * (s.projection + s.reconstruction)


class Published:
    """One group per probe, one work-item per matrix row, one per receiver.

    Args:
        given: what it is built from.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    def __init__(self, given: SrpInput) -> None:
        self.given = given
        device, bake, sizes = given.scene.device, given.bake, given.sizes
        self.radiance = given.receivers.new_map("radiance")
        lists = pack_samples(bake.relight)
        self._lists = (
            reads("hit_start", device.upload("hit_start", lists.hit_start)),
            reads("hit_sample", device.upload("hit_sample", lists.hit_sample)),
            reads("hit_texel", device.upload("hit_texel", lists.hit_texel)),
            reads("miss_start", device.upload("miss_start", lists.miss_start)),
            reads("miss_sample", device.upload("miss_sample", lists.miss_sample)),
            reads("directions", device.upload("relight_directions", bake.relight.directions)),
            reads("basis", device.upload("relight_basis", bake.relight.basis)),
        )
        packed = pack_published(bake, given.indirect.entries, given.storage)
        self._clusters = device.upload("clusters", packed.clusters)
        self._row_cluster = device.upload("row_cluster", packed.row_cluster)
        self._columns = device.upload("columns", packed.columns)
        self._projection = device.upload("projection", packed.projection)
        self._scale = device.upload("scale", packed.scale)
        self._receiver_cluster = device.upload("receiver_cluster", packed.receiver_cluster)
        self._first_value = device.upload("first_value", packed.first_value)
        self._texel = device.upload("transport_texel", packed.texel)
        self._reconstruction = device.upload("reconstruction", packed.reconstruction)
        self._lambda = device.empty("lambda", (sizes.probes, sizes.coefficients, 3), np.float32)
        self._basis = device.empty("light_basis", (sizes.rows, 3), np.float32)

    def passes(self) -> list[Pass]:
        """Probe update, cluster projection, irradiance transport."""
        sizes, storage = self.given.sizes, self.given.storage
        return [
            Pass("probe_update", self._probe_update, sizes.probe_update_work(self.given.fraction)),
            Pass("cluster_projection", self._projected, sizes.projection_work(storage)),
            Pass("irradiance_transport", self._transported, sizes.transport_work(storage)),
        ]

    def dilate(self) -> Pass:
        """Dilation that looks at every texel."""
        return self.given.indirect.dilate()

    def probe_radiance(self) -> Floats:
        """The probes' SH coefficients, (p, c, 3) W/m2/sr."""
        return self.given.scene.device.read(self._lambda)

    def _probe_update(self) -> Sequence[Launch]:
        device, given = self.given.scene.device, self.given
        per_coefficient = 12 * given.workgroup_size
        chunk = min(given.sizes.coefficients, device.profile.local_memory_bytes // per_coefficient)
        if chunk == 0:
            raise CannotRun(
                f"the sums of one coefficient take {per_coefficient:,} bytes of local memory; "
                f"profile {device.profile.name} has {device.profile.local_memory_bytes:,}",
                mend="lower --workgroup-size",
            )
        program = ProgramSpec("srp/published_probes.cl", {"CHUNK": chunk})
        args = (
            reads("frame_state", given.turns.state),
            *self._lists,
            integer("coefficients", given.sizes.coefficients),
            reads("radiance", self.radiance),
            *given.scene.environment_args,
            updates("lambda", self._lambda),
            local("sums", chunk * per_coefficient),
        )
        return [Launch(program, "probe_update", args, groups=given.turns.count)]

    def _projected(self) -> Sequence[Launch]:
        rows = self.given.sizes.rows
        args = (
            reads("clusters", self._clusters),
            reads("row_cluster", self._row_cluster),
            reads("columns", self._columns),
            reads("projection", self._projection),
            reads("scale", self._scale),
            reads("lambda", self._lambda),
            integer("rows", rows),
            writes("basis", self._basis),
        )
        return [Launch(self._program(), "cluster_projection", args, items=rows)]

    def _transported(self) -> Sequence[Launch]:
        receivers = self.given.sizes.receivers
        args = (
            reads("clusters", self._clusters),
            reads("receiver_cluster", self._receiver_cluster),
            reads("reconstruction", self._reconstruction),
            reads("first_value", self._first_value),
            reads("texel", self._texel),
            reads("basis", self._basis),
            integer("receivers", receivers),
            updates("indirect", self.given.indirect.map),
        )
        return [Launch(self._program(), "irradiance_transport", args, items=receivers)]

    def _program(self) -> ProgramSpec:
        defines: dict[str, int | str] = {"STORAGE": storage_macro(self.given.storage), "VEC": 1}
        return ProgramSpec("srp/published_transport.cl", defines)
