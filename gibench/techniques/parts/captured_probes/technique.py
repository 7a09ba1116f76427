"""Captured probes, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from gibench.device import BufferSpec, Device, ProgramSpec, updates
from gibench.scene.model import Camera, Scene
from gibench.techniques.job import Job, Known, World
from gibench.techniques.parts.camera_pass import suits_packets
from gibench.techniques.parts.captured_probes.held import (
    Biases,
    HeldProbes,
    captured_shares,
    probe_bytes,
)
from gibench.techniques.parts.captured_probes.passes import ProbePasses
from gibench.techniques.parts.captured_probes.settings import CapturedProbeSettings
from gibench.techniques.parts.captured_probes.stages import CapturedProbes
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gathered import gathered_at
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.gloss_table import GlossTable
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.parts.recolouring import Recolouring
from gibench.techniques.parts.standing_light import StandingLight
from gibench.techniques.parts.unseen_sky import told_of_sky
from gibench.techniques.registry import TUNED, Knob, steps
from gibench.techniques.technique import FloatArray, Pass

# Share of all light that may fall where no probe is seen: those that are not seen light it all the
# same: with 25 and 27 % (street, vase) the bias is -1 to -4 %, with 50 % (Sponza) -60 % and more.
_UNSEEN: Final = 0.4
REST_CHANGE = 0.005
"""Root mean square change of all maps' irradiance in a round of relighting, as a share of itself,
that counts as none."""


def check_volume(scene: Scene, settings: CapturedProbeSettings) -> None:
    """Refuse probes that do not suit a scene.

    Raises:
        BadInput: naming what is wrong.
    """
    settings.volume(scene)


def probe_sweep(scene: Scene) -> dict[str, tuple[int, ...]]:
    """What 'gibench advise' tries: few probes and many, coarse maps and finer ones."""
    return {"probes": (16, 64), "map_texels": (16, 64)}


def probe_knobs(scene: Scene) -> tuple[Knob, ...]:
    """What trades their cost for quality: probes, and how finely each is seen."""
    return Knob("probes", steps(2, 128, 27, whole=True)), Knob("map_texels", (16, 64))


def declared(known: Known) -> list[BufferSpec]:
    """Scene, probes, and what the camera's rays hit."""
    shot, settings = known.job.shot, known.job.settings
    return [
        *FrameScene.declared(known),
        *HeldProbes.buffers(settings, settings.volume(known.scene).probes),
        *(GlossTable.buffers(known.scene) if settings.gloss_steps else ()),
        *_changing(known),
        HitBuffer.spec(shot.width, shot.height),
    ]


def _changing(known: Known) -> list[BufferSpec]:
    """What captured texels whose materials change take, once it is known which these are."""
    if known.baked is None:
        return []
    shares = captured_shares(known.scene, known.baked, known.job.settings, known.motion)
    return [] if shares is None else Recolouring.buffers(shares)


def sky_remarks(name: str, scene: Scene, volume: Volume, bias: float, reach: float) -> list[str]:
    """That probes of technique ``name`` miss much of the sky's light, ``bias`` m off a surface;
    their light comes through walls of ``reach`` m.
    """
    return told_of_sky(name, scene, volume, bias, "bake and memory", _UNSEEN, reach)


class CapturedProbeTechnique:
    """Captured probes on a device; a technique gives them its name.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen; ``baked`` is a :class:`CapturedProbes`.
        biases: of points.
        distance_sharpness: power of the cosine that distances are filtered by.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    def __init__(
        self,
        device: Device,
        job: Job,
        world: World,
        biases: Biases,
        distance_sharpness: float = 0.0,
    ) -> None:
        settings: CapturedProbeSettings = job.settings
        baked: CapturedProbes = world.baked
        self.device = device
        self._job, self._world, self._settings = job, world, settings
        self.scene = FrameScene.of(device, job.shot, world)
        self.probes = HeldProbes.create(device, settings, baked, biases)
        self._frames, self._looked, self._still = 0, 0, False
        self._light = StandingLight(REST_CHANGE)
        shares = captured_shares(world.scene, baked, settings, world.motion)
        self.recolouring: Recolouring | None = None
        if shares is not None:
            capture = self.probes.capture
            self.recolouring = Recolouring.create(
                device,
                shares,
                self.scene.surfaces.materials,
                ProgramSpec("parts/recolour_captured.cl", SCENE_MACROS),
                (
                    updates("captured_albedo", capture["captured_albedo"]),
                    updates("captured_emission", capture["captured_emission"]),
                ),
                stored_bytes=16,
            )
        tuned = job.variant == TUNED
        self._passes = ProbePasses(
            self.scene,
            self.probes,
            tuned,
            packets=tuned and suits_packets(device),
            distance_sharpness=distance_sharpness,
        )

    def passes(self) -> Sequence[Pass]:
        """The passes of a frame, in order."""
        first = [] if self.recolouring is None else self.recolouring.passes()
        return [*first, *self._passes.passes()]

    def begin_frame(self, frame: int) -> None:
        """Move lights and camera; choose which probes are relit."""
        self.scene.begin_frame(frame)
        self._passes.begin_frame()
        self._frames += 1

    def at_rest(self) -> bool:
        """Whether its probes have gathered their light. Probes that were lit once (McGuire et al.
        2017, section 3: all of it is precomputed) always have. Relit, each adds a bounce whenever
        its turn comes: once all have been lit, the irradiance in their maps must have changed by
        no more than ``REST_CHANGE`` while every probe had its turn once more, as it is found
        whenever they all have had it. Ours: the paper relights nothing.
        """
        if not self._settings.relit or not len(self._passes.schedule.numbers):
            return True
        if self._passes.schedule.oldest <= self._frames - self._looked:
            self._looked = self._frames
            self._still = self._light.takes(self.device.read(self.probes.irradiance)[..., :3])
        return self._still

    def look_from(self, camera: Camera) -> None:
        """See the scene from ``camera`` wherever there is no flight."""
        self.scene.look_from(camera)

    def images(self) -> dict[str, FloatArray]:
        """The frame, its direct and its indirect part, (h, w, 3) W/m2/sr."""
        return self._passes.application.images(self._job.group_size)

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers, W/m2, in the lightmap's order.

        The receivers are on the device only meanwhile: no frame needs them.

        Raises:
            CannotRun: they do not fit beside the technique.
        """
        return gathered_at(
            self._world.lightmap.receivers,
            self.device,
            self._passes.receivers,
            self._job.group_size,
        )

    def counts(self) -> dict[str, int]:
        """Probes, and receivers it is compared on."""
        return {
            "probes": self.probes.baked.volume.probes,
            "receivers": len(self._world.lightmap.receivers),
        }

    def notes(self) -> list[str]:
        """What belongs beside its figures."""
        baked, settings = self.probes.baked, self._settings
        found = [
            f"a probe takes {probe_bytes(settings):,} bytes; its captured cube took "
            f"{baked.captured_bytes:,} while it was baked"
        ]
        if inside := int(np.count_nonzero(~baked.usable)):
            found.append(f"{inside} of {baked.volume.probes} probes lie inside surfaces")
        motion = self._world.motion
        if not settings.relit and motion is not None and motion.materials is not None:
            found.append(
                "the probes were lit once, with the materials at rest (update=static): what "
                "changes is seen, and sends no indirect light"
            )
        if not settings.relit and self._world.scene.lights_move:
            found.append(
                "the probes were lit once, with the lights as in frame 0 (update=static): direct "
                "light moves, indirect light does not"
            )
        return found
