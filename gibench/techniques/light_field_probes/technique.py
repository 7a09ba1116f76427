"""Light field probes, frame by frame."""

from __future__ import annotations

from typing import ClassVar

from gibench.device import Device
from gibench.techniques.job import Job, World
from gibench.techniques.light_field_probes.settings import LightFieldProbeSettings
from gibench.techniques.parts.captured_probes.held import Biases
from gibench.techniques.parts.captured_probes.technique import CapturedProbeTechnique


class LightFieldProbes(CapturedProbeTechnique):
    """Trilinear interpolation between those probes around a point that see it.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    name: ClassVar[str] = "light-field-probes"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        settings: LightFieldProbeSettings = job.settings
        volume = world.baked.volume
        biases = Biases(settings.surface_bias_in(volume), settings.visibility_bias_in(volume))
        super().__init__(device, job, world, biases, settings.filter_sharpness)
