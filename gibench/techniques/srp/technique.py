"""SRP frame by frame (Silvennoinen and Lehtinen 2017, section 4.2; Bennett 2019, chapter 5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from gibench.arrays import Floats
from gibench.device import SIMT, Device
from gibench.techniques.job import Job, World
from gibench.techniques.parts.camera_pass import suits_packets
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.gloss_table import GlossTable
from gibench.techniques.parts.lightmap_update import lightmap_update
from gibench.techniques.parts.normal_map_table import NO_NORMAL_MAPS, NormalMapTable
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.registry import TUNED
from gibench.techniques.srp.application import srp_application
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.common import ProbeTurns, SrpInput, SrpVariant, TransportSizes
from gibench.techniques.srp.probe_view import probe_view
from gibench.techniques.srp.published import Published
from gibench.techniques.srp.settings import SrpSettings
from gibench.techniques.srp.simt import Simt
from gibench.techniques.srp.tuned import Tuned
from gibench.techniques.technique import FloatArray, Pass

REST_CHANGE = 0.005
"""Relative change of the indirect light, root mean square over receivers, from one look to the
next, that counts as none. At the slowest, a quarter of the probes a frame, two bounces lie between
looks, each the surfaces' albedo of the last: at 0.8 what is yet to come is under 1 % of the light.
"""


def _variant(given: SrpInput, tuned: bool) -> SrpVariant:
    if not tuned:
        return Published(given)
    return Simt(given) if given.scene.device.layout == SIMT else Tuned(given)


class Srp:
    """SRP on a device.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    name: ClassVar[str] = "srp"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        settings: SrpSettings = job.settings
        bake: SrpBake = world.baked
        self.device = device
        self._job, self._world, self._settings, self._bake = job, world, settings, bake
        self.scene = FrameScene.of(device, job.shot, world)
        self.receivers = FrameLightmap.upload(device, world.lightmap)
        self.indirect = ReceiverSignal.create(self.receivers, "indirect", bake.components)
        self.sizes = TransportSizes.of(bake)
        self.turns = ProbeTurns(device, self.sizes.probes, settings.probe_update_fraction)
        given = SrpInput(
            self.scene,
            self.receivers,
            bake,
            self.sizes,
            settings.storage,
            settings.probe_update_fraction,
            job.group_size,
            self.turns,
            self.indirect,
        )
        tuned = job.variant == TUNED
        self._before: Floats | None = None
        self.variant: SrpVariant = _variant(given, tuned)
        maps = NO_NORMAL_MAPS
        if settings.normal_maps:
            maps = NormalMapTable.upload(device, world.scene)
        self._application = srp_application(
            self.scene,
            HitBuffer.create(device, job.shot.width, job.shot.height),
            self.indirect,
            packets=tuned and suits_packets(device),
            normal_maps=maps,
            gloss=GlossTable.upload(device, world.scene) if settings.gloss else None,
        )

    def passes(self) -> Sequence[Pass]:
        """The passes of a frame, in order."""
        bounces = self._settings.bounces
        return [
            lightmap_update(
                self.scene, self.receivers, self.indirect, self.variant.radiance, bounces
            ),
            *self.variant.passes(),
            self.variant.dilate(),
            *self._application.passes(),
        ]

    def begin_frame(self, frame: int) -> None:
        """Move lights and camera and choose the probes to update."""
        self.scene.begin_frame(frame)
        self.turns.begin_frame(frame)

    def at_rest(self) -> bool:
        """Whether its bounces have come together: every frame adds one (Silvennoinen and Lehtinen
        2017, section 4.2: the light of the last frame is the next one's), until the irradiance at
        the receivers changes by no more than ``REST_CHANGE`` of itself from one look to the next.
        """
        now, before = self.indirect.irradiance(), self._before
        self._before = now
        if before is None:
            return False
        change = float(np.linalg.norm(now.astype(np.float64) - before))
        return change <= REST_CHANGE * float(np.linalg.norm(now.astype(np.float64)))

    def images(self) -> dict[str, FloatArray]:
        """The frame, its direct and its indirect part, and the probes, (h, w, 3) W/m2/sr."""
        images = self._application.images(self._job.group_size)
        images["probes"] = probe_view(
            images["frame"],
            self.scene.camera,
            self._world.scene,
            self._bake.probes.positions,
            self.variant.probe_radiance(),
        )
        return images

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers, W/m2, in the lightmap's order."""
        return self.indirect.irradiance()

    def counts(self) -> dict[str, int]:
        """Probes, receivers, clusters and light basis vectors."""
        return {
            "probes": self.sizes.probes,
            "receivers": len(self._world.lightmap.receivers),
            "clusters": self.sizes.clusters,
            "light_basis_vectors": self.sizes.rows,
        }

    def notes(self) -> list[str]:
        """How well the probes cover the receivers, and what of the settings the scene lacks."""
        bake = self._bake
        found = [
            f"{100 * bake.usable_share:.2f} % of the receivers lie within a probe that they can "
            f"use; {bake.overlap:.1f} probes reach a receiver on average"
        ]
        if self._settings.normal_maps and self._world.scene.normal_maps is None:
            found.append("the scene has no normal maps to shade with")
        return found
