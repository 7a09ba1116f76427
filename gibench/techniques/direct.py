"""Direct light only: the papers' baseline (Bennett 2019, figure 6.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gibench.device import Device
from gibench.techniques.job import Job, World
from gibench.techniques.parts.camera_pass import camera_pass, rendered, suits_packets
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.registry import PUBLISHED, TUNED, Follows, TechniqueSpec
from gibench.techniques.technique import FloatArray, Pass


@dataclass(frozen=True)
class DirectSettings:
    """Direct light has nothing to set."""


class Direct:
    """Primary rays and direct light with shadow rays, one pass.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen.

    Raises:
        CannotRun: the scene does not fit the device's profile.
    """

    name: ClassVar[str] = "direct"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        self.device = device
        self._receivers = len(world.lightmap.receivers)
        self._workgroup_size = job.group_size
        self._packets = job.variant == TUNED and suits_packets(device)
        self.scene = FrameScene.of(device, job.shot, world)

    def passes(self) -> Sequence[Pass]:
        """The passes of a frame, in order."""
        return [camera_pass(self.scene, packets=self._packets)]

    def begin_frame(self, frame: int) -> None:
        """Move lights and camera."""
        self.scene.begin_frame(frame)

    def images(self) -> dict[str, FloatArray]:
        """The frame, (h, w, 3) W/m2/sr."""
        return {"frame": rendered(self.scene, self._workgroup_size, packets=self._packets)}

    def at_rest(self) -> bool:
        """Always: it keeps nothing from one frame to the next."""
        return True

    def indirect_irradiance(self) -> FloatArray:
        """Zeros (n, 3): it computes none."""
        return np.zeros((self._receivers, 3), np.float32)

    def counts(self) -> dict[str, int]:
        """Receivers of the lightmap it is compared on."""
        return {"receivers": self._receivers}


SPEC = TechniqueSpec(
    name="direct",
    title="Direct light only",
    variants=(PUBLISHED, TUNED),
    settings_type=DirectSettings,
    create=Direct,
    buffers=FrameScene.declared,
    # It has no indirect light, which is as right wherever things are.
    follows=frozenset({Follows.DIRECT_LIGHT, Follows.INDIRECT_LIGHT}),
    woken_by=frozenset(),
    memory_options=("--resolution",),
)
