"""What both variants of SRP's passes share: sizes, buffers, works."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from gibench.arrays import Floats
from gibench.device import Argument, Buffer, Launch, reads
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.probe_light import LambdaLayout
from gibench.techniques.srp.storage import storage_bytes
from gibench.techniques.srp.turns import ProbeTurns
from gibench.techniques.technique import Pass, Work


@dataclass(frozen=True)
class TransportSizes:
    """How large baked data is; buffers and works come from these.

    Attributes:
        probes: number of probes.
        coefficients: SH coefficients per probe.
        samples: relight samples per probe.
        hits: relight rays of all probes that meet a receiver; where something moves, all that do
            not escape.
        misses: relight rays of all probes that escape.
        clusters: number of clusters.
        receivers: receivers in clusters.
        lit_receivers: receivers in clusters that are not dark.
        rows: light basis vectors of all clusters.
        columns: stored columns of all clusters.
        projection: values of all projection matrices.
        reconstruction: values of all reconstruction matrices.
        components: of the light at a receiver.
    """

    probes: int
    coefficients: int
    samples: int
    hits: int
    misses: int
    clusters: int
    receivers: int
    lit_receivers: int
    rows: int
    columns: int
    projection: int
    reconstruction: int
    components: int = 1

    @staticmethod
    def of(bake: SrpBake, moves: bool = False) -> TransportSizes:
        """The sizes of ``bake``, where anything ``moves`` or not."""
        lit = [c for c in bake.clusters if len(c.projection)]
        hit = bake.relight.texel != -1 if moves else bake.relight.texel >= 0
        return TransportSizes(
            probes=len(bake.probes),
            coefficients=bake.coefficients,
            samples=bake.relight.texel.shape[1],
            hits=int(np.count_nonzero(hit)),
            misses=int(np.count_nonzero(bake.relight.texel == -1)),
            clusters=len(bake.clusters),
            receivers=sum(len(c.receivers) for c in bake.clusters),
            lit_receivers=sum(len(c.receivers) for c in lit),
            rows=sum(len(c.projection) for c in lit),
            columns=sum(c.projection.shape[1] for c in lit),
            projection=sum(c.projection.size for c in lit),
            reconstruction=sum(c.reconstruction.size for c in lit),
            components=bake.components,
        )

    @staticmethod
    def least(probes: int, coefficients: int, samples: int, receivers: int) -> TransportSizes:
        """What is known of them before the bake: its own are 0."""
        return TransportSizes(
            probes=probes,
            coefficients=coefficients,
            samples=samples,
            hits=0,
            misses=0,
            clusters=0,
            receivers=receivers,
            lit_receivers=0,
            rows=0,
            columns=0,
            projection=0,
            reconstruction=0,
        )

    def probe_update_work(self, fraction: float) -> Work:
        """The least ``probe_update`` does when it updates this share of the probes."""
        rays = (self.hits + self.misses) * fraction
        values = self.probes * fraction * self.coefficients * 3
        return Work(
            flops=rays * self.coefficients * 3 * 2,
            bytes_read=rays * (4 + 12) + 4 * self.samples * self.coefficients,
            bytes_written=4 * values,
        )

    def projection_work(self, storage: str) -> Work:
        """The least ``cluster_projection`` does: every stored value read once."""
        return Work(
            flops=self.projection * 3 * 2,
            bytes_read=self.projection * storage_bytes(storage)
            + 12 * self.probes * self.coefficients,
            bytes_written=12 * self.rows,
        )

    def transport_work(self, storage: str) -> Work:
        """The least ``irradiance_transport`` does: every stored value read once.

        Of a lightmap texel's float4 the three channels count; the kernels store all of it.
        """
        return Work(
            flops=self.reconstruction * 3 * 2,
            bytes_read=self.reconstruction * storage_bytes(storage)
            + 12 * self.rows
            + 4 * self.lit_receivers,
            bytes_written=12 * self.lit_receivers * self.components,
        )


@dataclass(frozen=True)
class SrpInput:
    """What a variant is built from.

    Attributes:
        scene: the scene on the device.
        receivers: the atlas on the device.
        bake: the baked data.
        sizes: its sizes.
        storage: ``fp32``, ``fp16`` or ``snorm16``.
        fraction: share of the probes updated in a frame.
        workgroup_size: work-items per group.
        turns: which probes are updated.
        indirect: the signal that is written.
        blocked: what relight rays see that are blocked by what moves; None where all rests.
    """

    scene: FrameScene
    receivers: FrameLightmap
    bake: SrpBake
    sizes: TransportSizes
    storage: str
    fraction: float
    workgroup_size: int
    turns: ProbeTurns
    indirect: ReceiverSignal
    blocked: Buffer | None = None

    @property
    def update_work(self) -> Work:
        """The least that the probes' update does; where something moves, it asks of every ray
        whether it is blocked.
        """
        work = self.sizes.probe_update_work(self.fraction)
        if self.blocked is None:
            return work
        asked = 16 * self.sizes.probes * self.sizes.samples * self.fraction
        return replace(work, bytes_read=work.bytes_read + asked)

    @property
    def blocked_args(self) -> tuple[Argument, ...]:
        """BLOCKED_PARAM of the probes' update."""
        return () if self.blocked is None else (reads("blocked", self.blocked),)

    @property
    def blocked_defines(self) -> dict[str, int | str]:
        """The macros of the probes' update that go with it."""
        if self.blocked is None:
            return {}
        return {"OCCLUDERS": 1, "SAMPLES": self.sizes.samples}


def extended_radiance(given: SrpInput) -> Floats:
    """What the map of outgoing radiance holds at first, (texels + s + 1, 4): the environment's
    radiance in the relight directions, which all probes share and no frame changes, behind the
    texels, and one black entry.
    """
    samples, texels = given.sizes.samples, given.receivers.texels
    radiance = given.receivers.black(extra=samples + 1)
    radiance[texels : texels + samples, :3] = given.scene.scene.environment.radiance(
        given.bake.relight.directions
    )
    return radiance


def transport_passes(
    given: SrpInput,
    update: Callable[[], Sequence[Launch]],
    project: Callable[[], Sequence[Launch]],
    transport: Callable[[], Sequence[Launch]],
) -> list[Pass]:
    """Probe update, cluster projection, irradiance transport, of a variant's launches."""
    return [
        Pass("probe_update", update, given.update_work),
        Pass("cluster_projection", project, given.sizes.projection_work(given.storage)),
        Pass("irradiance_transport", transport, given.sizes.transport_work(given.storage)),
    ]


class SrpVariant(Protocol):
    """The passes that differ between the variants.

    Attributes:
        radiance: map of outgoing radiance that the lightmap update writes.
        coefficients: the probes' SH coefficients, W/m2/sr.
        layout: how they lie.
    """

    radiance: Buffer
    coefficients: Buffer
    layout: LambdaLayout

    def passes(self) -> list[Pass]:
        """Probe update, cluster projection, irradiance transport."""
        ...

    def dilate(self) -> Pass:
        """Dilation of the indirect map."""
        ...

    def probe_radiance(self) -> Floats:
        """The probes' SH coefficients, (p, c, 3) W/m2/sr."""
        ...
