"""Precomputed light field probes (McGuire et al. 2017): irradiance, and what a probe sees."""

from __future__ import annotations

import math

from gibench.bake.stage import Stage
from gibench.scene.model import Camera, Scene
from gibench.techniques.job import Job
from gibench.techniques.light_field_probes.settings import LightFieldProbeSettings
from gibench.techniques.light_field_probes.technique import LightFieldProbes
from gibench.techniques.parts.captured_probes.stages import Asked, probe_stages
from gibench.techniques.parts.captured_probes.technique import (
    check_volume,
    declared,
    probe_knobs,
    probe_sweep,
    sky_remarks,
)
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.parts.thin_walls import leaking_walls
from gibench.techniques.registry import (
    PUBLISHED,
    TUNED,
    BakeContext,
    Follows,
    TechniqueSpec,
    Wakes,
)

__all__ = ["SPEC", "LightFieldProbeSettings", "LightFieldProbes"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    settings: LightFieldProbeSettings = context.settings
    volume = settings.volume(context.scene)
    asked = Asked(
        context.scene,
        settings,
        distance_sharpness=settings.filter_sharpness,
        surface_bias=settings.surface_bias_in(volume),
        visibility_bias=settings.visibility_bias_in(volume),
        rays=settings.bounce_rays,
        denoise=settings.denoise if settings.bounce_rays else 0,
    )
    return probe_stages(LightFieldProbes.name, context, asked)


def _remarks(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Light of a sky that no probe sees."""
    settings: LightFieldProbeSettings = job.settings
    volume = settings.volume(scene)
    bias = settings.surface_bias_in(volume)
    return sky_remarks(LightFieldProbes.name, scene, volume, bias, _reach(settings, volume))


def _reach(settings: LightFieldProbeSettings, volume: Volume) -> float:
    """What points are moved by, and a texel of distances covers at the next probe, m."""
    texel = math.sqrt(4 * math.pi) / settings.map_texels
    biases = settings.surface_bias_in(volume) + settings.visibility_bias_in(volume)
    return biases + texel * max(volume.spacing)


def _flaws(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Walls thinner than what points are moved by, and a texel of a probe's distances covers at the
    next probe.
    """
    settings: LightFieldProbeSettings = job.settings
    volume = settings.volume(scene)
    return leaking_walls(
        scene,
        _reach(settings, volume),
        "the biases and what a texel of a probe's distances covers at the next probe",
        f"--probes {8 * volume.probes} halves the latter, with eight times the memory",
    )


SPEC = TechniqueSpec(
    name=LightFieldProbes.name,
    title="Light field probes",
    variants=(PUBLISHED, TUNED),
    settings_type=LightFieldProbeSettings,
    stages=_stages,
    woken_by=frozenset({Wakes.LIGHTS, Wakes.OBJECTS}),
    follows=frozenset({Follows.DIRECT_LIGHT}),
    create=LightFieldProbes,
    buffers=declared,
    sweep=probe_sweep,
    knobs=probe_knobs,
    check=check_volume,
    remarks=_remarks,
    flaws=_flaws,
    memory_options=("--probes", "--set light-field-probes.map_texels", "--resolution"),
    counts={"probes": "probes"},
)
