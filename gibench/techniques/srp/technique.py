"""SRP frame by frame (Silvennoinen and Lehtinen 2017, section 4.2; Bennett 2019, chapter 5)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from gibench.arrays import Floats
from gibench.device import SIMT, Device
from gibench.scene.lightmap import some_receivers
from gibench.techniques.job import Job, World
from gibench.techniques.parts.camera_pass import suits_packets
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gathered import gathered_at
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.gloss_table import GlossTable
from gibench.techniques.parts.lightmap_update import lightmap_update
from gibench.techniques.parts.normal_map_table import NO_NORMAL_MAPS, NormalMapTable
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.parts.recolouring import Recolouring
from gibench.techniques.registry import TUNED
from gibench.techniques.srp.application import srp_application
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.common import SrpInput, SrpVariant, TransportSizes
from gibench.techniques.srp.movers import Movers
from gibench.techniques.srp.probe_view import probe_view
from gibench.techniques.srp.published import Published
from gibench.techniques.srp.resting import receivers_that_move, resting_lightmap
from gibench.techniques.srp.settings import SrpSettings
from gibench.techniques.srp.simt import Simt
from gibench.techniques.srp.tuned import Tuned
from gibench.techniques.srp.turns import ProbeTurns
from gibench.techniques.technique import FloatArray, Pass

REST_CHANGE = 0.005
"""Relative change of the indirect light, root mean square over receivers, from one look to the
next, that counts as none. At the slowest, a quarter of the probes a frame, two bounces lie between
looks, each the surfaces' albedo of the last: at 0.8 what is yet to come is under 1 % of the light.
"""


_MOVING_NOTE = (
    "it is baked without the objects that move: they block the probes' relight rays and send their "
    "own light along them, and are lit by the probes around them (order 2); between a receiver and "
    "the probes that it takes its light from, the bake knows nothing of them, so that shadows and "
    "light finer than the probes' spacing are missing, and light leaks past them there"
)


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
        motion = world.motion if world.motion is not None and world.motion.moves else None
        self._moving = None if motion is None else motion.triangles
        lightmap = world.lightmap
        if self._moving is not None:
            lightmap = resting_lightmap(lightmap, self._moving)
        self.receivers = FrameLightmap.upload(device, lightmap)
        self.recolouring = Recolouring.of_receivers(self.scene, self.receivers, world.motion)
        self.indirect = ReceiverSignal.create(self.receivers, "indirect", bake.components)
        self.sizes = TransportSizes.of(bake, motion is not None)
        probes = bake.probes
        self.turns = ProbeTurns(device, probes.positions, probes.radius, settings.probe_update)
        self.movers: Movers | None = None
        if motion is not None:
            self.movers = Movers.create(device, self.scene, motion, bake, self.turns)
        given = SrpInput(
            self.scene,
            self.receivers,
            bake,
            self.sizes,
            settings.storage,
            1 / self.turns.step,
            job.group_size,
            self.turns,
            self.indirect,
            None if self.movers is None else self.movers.blocked,
        )
        tuned = job.variant == TUNED
        self._before: Floats | None = None
        self.variant: SrpVariant = _variant(given, tuned)
        hits = HitBuffer.create(device, job.shot.width, job.shot.height)
        packets = tuned and suits_packets(device)
        if self.movers is None:
            maps = NO_NORMAL_MAPS
            if settings.normal_maps:
                maps = NormalMapTable.upload(device, world.scene)
            self._application = srp_application(
                self.scene,
                hits,
                self.indirect,
                packets=packets,
                normal_maps=maps,
                gloss=GlossTable.upload(device, world.scene) if settings.gloss else None,
            )
        else:
            self._application = self.movers.light.application(
                self.scene,
                hits,
                self.indirect,
                self.variant.coefficients,
                self.variant.layout,
                packets,
            )

    def passes(self) -> Sequence[Pass]:
        """The passes of a frame, in order."""
        bounces = self._settings.bounces
        return [
            *([] if self.recolouring is None else self.recolouring.passes()),
            lightmap_update(
                self.scene, self.receivers, self.indirect, self.variant.radiance, bounces
            ),
            *self._blocked(bounces),
            *self.variant.passes(),
            self.variant.dilate(),
            *self._application.passes(),
        ]

    def _blocked(self, bounces: bool) -> Sequence[Pass]:
        """The passes that find which relight rays are blocked; none where all rests."""
        if self.movers is None:
            return []
        return self.movers.passes(self.variant.coefficients, self.variant.layout, bounces)

    def begin_frame(self, frame: int) -> None:
        """Move lights, camera and objects and choose the probes to update."""
        self.scene.begin_frame(frame)
        self.turns.begin_frame(frame, self.scene.camera.position)

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
            self._bake.probes.placed.positions,
            self.variant.probe_radiance()[: len(self._bake.probes.placed)],
        )
        return images

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers, W/m2, in the lightmap's order.

        At receivers on what moves it is what the probes give there.

        Raises:
            CannotRun: these receivers do not fit beside the technique.
        """
        found = self.indirect.irradiance()
        if self.movers is None or self._moving is None:
            return found
        moves = receivers_that_move(self._world.lightmap, self._moving)
        whole = np.zeros((len(moves), 3), np.float32)
        whole[~moves] = found
        if moves.any():
            light, radiance = self.movers.light, self.variant.coefficients
            whole[moves] = gathered_at(
                some_receivers(self._world.lightmap, np.flatnonzero(moves)).receivers,
                self.device,
                partial(light.receivers, self._application, radiance),
                self._job.group_size,
            )
        return whole

    def outgoing_radiance(self) -> FloatArray:
        """What the receivers sent out in the last frame, (n, 3) W/m2/sr: what they emit, and what
        they reflect of direct light and, with bounces, of the indirect light of the frame before.
        """
        radiance = self.device.read(self.variant.radiance)
        return radiance.reshape(-1, 4)[self.receivers.lightmap.receivers.texel, :3]

    def counts(self) -> dict[str, int]:
        """Probes, receivers, clusters and light basis vectors."""
        return {
            "probes": len(self._bake.probes.placed),
            "receivers": len(self._world.lightmap.receivers),
            "clusters": self.sizes.clusters,
            "light_basis_vectors": self.sizes.rows,
        }

    def notes(self) -> list[str]:
        """How well the probes cover the receivers, what of the settings the scene lacks, and what
        is approximate of what moves.
        """
        bake = self._bake
        found = [] if self.movers is None else [_MOVING_NOTE]
        found += [
            f"{100 * bake.usable_share:.2f} % of the receivers lie within a probe that they can "
            f"use; {bake.overlap:.1f} probes reach a receiver on average",
        ]
        if self._settings.normal_maps and self._world.scene.normal_maps is None:
            found.append("the scene has no normal maps to shade with")
        return found
