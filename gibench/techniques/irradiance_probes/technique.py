"""Irradiance probes, frame by frame."""

from __future__ import annotations

from typing import ClassVar

from gibench.device import Device
from gibench.techniques.job import Job, World
from gibench.techniques.parts.captured_probes.held import Biases
from gibench.techniques.parts.captured_probes.technique import CapturedProbeTechnique


class IrradianceProbes(CapturedProbeTechnique):
    """Trilinear interpolation between the probes around a point, whatever lies between.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    name: ClassVar[str] = "irradiance-probes"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        super().__init__(device, job, world, Biases(surface=0.0, visibility=0.0))
