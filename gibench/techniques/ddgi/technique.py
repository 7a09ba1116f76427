"""Dynamic Diffuse Global Illumination, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from gibench.device import SIMT, Device, Launch
from gibench.scene.model import Camera
from gibench.techniques.ddgi.blending import Blending, Published, Tuned
from gibench.techniques.ddgi.passes import DdgiPasses
from gibench.techniques.ddgi.probes import Probes
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.ddgi.simt_blending import Simt
from gibench.techniques.job import Job, World
from gibench.techniques.parts.camera_pass import suits_packets
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gathered import gathered_at
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.parts.steady import Steady
from gibench.techniques.registry import TUNED
from gibench.techniques.technique import LOOK_EVERY, FloatArray, Pass

# A drawn probe's radius over the least spacing: with the greatest offset (0.45) it still fits its
# cell.
_RADIUS_SHARE = 0.05

REST_FALL = 0.10
"""Share by which the variability may still fall between two windows of frames."""
REST_LENGTHS = 2.0
"""Length of a window over the frames that hysteresis looks back, 1 / (1 - hysteresis)."""
REST_FRAMES = 64
"""Least length of a window: means of fewer looks are as noisy as ``REST_FALL``."""


class Ddgi:
    """DDGI on a device.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen; ``baked`` is the volume.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    name: ClassVar[str] = "ddgi"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        settings: DdgiSettings = job.settings
        volume: Volume = world.baked
        self.device = device
        self._job, self._world, self._settings = job, world, settings
        self.scene = FrameScene.of(device, job.shot, world)
        self.probes = Probes.create(device, settings, volume, job.seed)
        tuned = job.variant == TUNED
        self.blending: Blending
        if tuned and device.layout == SIMT:
            self.blending = Simt(self.probes, job.group_size)
        else:
            self.blending = Tuned(self.probes) if tuned else Published(self.probes)
        packets = tuned and suits_packets(device)
        self._variability = Steady(REST_FALL, rest_window(settings.hysteresis))
        self._passes = DdgiPasses(self.scene, self.probes, self.blending, job.group_size, packets)

    def passes(self) -> Sequence[Pass]:
        """The passes of a frame, in order."""
        return self._passes.passes()

    def begin_frame(self, frame: int) -> None:
        """Move lights and camera, turn the rays, scroll the volume if it does."""
        self.scene.begin_frame(frame)
        self.probes.begin_frame(frame)
        if self._settings.scrolling:
            self.probes.scroll_to(self.scene.camera.position)

    def look_from(self, camera: Camera) -> None:
        """See the scene from ``camera`` wherever there is no flight; a scrolling volume follows."""
        self.scene.look_from(camera)

    def images(self) -> dict[str, FloatArray]:
        """The frame, its direct and its indirect part, and the probes, (h, w, 3) W/m2/sr."""
        images = self._passes.application.images(self._job.group_size)
        radius = _RADIUS_SHARE * min(self.probes.volume.spacing)
        images["probes"] = self._drawn(self._passes.probe_view(radius))
        return images

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers, W/m2, in the lightmap's order.

        What the probes give there, seen along the normal. The receivers are on the device only
        meanwhile: no frame needs them.

        Raises:
            CannotRun: they do not fit beside the technique.
        """
        return gathered_at(
            self._world.lightmap.receivers,
            self.device,
            self._passes.receivers,
            self._job.group_size,
        )

    def average_variability(self) -> float:
        """Mean coefficient of variation over the usable probes' texels in the last frame."""
        return float(self.device.read(self.probes.average)[0])

    def at_rest(self) -> bool:
        """Whether its probes have gathered their light: the volume's average variability, the
        coefficient of variation as RTXGI-DDGI 1.3.7 defines it, no longer falls.

        RTXGI calls probes representative when it "settles around a small value", whose size depends
        on the rays per probe, and has its user give it per scene. Here no size is given: the mean
        over a window of frames (``REST_LENGTHS``, ``REST_FRAMES``) is within ``REST_FALL`` of the
        mean over the window before. Light that still rises adds to the variability, and slowly
        enough to be missed only where it takes over nine times as long as hysteresis looks back.
        """
        return self._variability.takes(self.average_variability())

    def counts(self) -> dict[str, int]:
        """Probes, rays of all probes when all are active, and receivers it is compared on."""
        probes = self.probes.volume.probes
        return {
            "probes": probes,
            "rays": probes * self._settings.rays,
            "receivers": len(self._world.lightmap.receivers),
        }

    def _run(self, launch: Launch) -> None:
        size = self._job.group_size
        self.device.enqueue(launch, size)

    def _drawn(self, launch: Launch) -> FloatArray:
        self._run(launch)
        return self.device.read(self.scene.image)


def rest_window(hysteresis: float) -> int:
    """Looks in the windows that :meth:`Ddgi.at_rest` compares."""
    return math.ceil(max(REST_FRAMES, REST_LENGTHS / (1 - hysteresis)) / LOOK_EVERY)
