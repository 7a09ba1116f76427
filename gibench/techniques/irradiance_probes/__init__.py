"""Irradiance probes: what every old engine ships, no visibility in them."""

from __future__ import annotations

from gibench.bake.stage import Stage
from gibench.scene.model import Camera, Scene
from gibench.techniques.irradiance_probes.settings import IrradianceProbeSettings
from gibench.techniques.irradiance_probes.technique import IrradianceProbes
from gibench.techniques.job import Job
from gibench.techniques.parts.captured_probes.stages import Asked, probe_stages
from gibench.techniques.parts.captured_probes.technique import (
    check_volume,
    declared,
    probe_knobs,
    probe_sweep,
    sky_remarks,
)
from gibench.techniques.parts.thin_walls import leaking_walls
from gibench.techniques.registry import (
    PUBLISHED,
    TUNED,
    BakeContext,
    Follows,
    TechniqueSpec,
    Wakes,
)

__all__ = ["SPEC", "IrradianceProbeSettings", "IrradianceProbes"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    settings: IrradianceProbeSettings = context.settings
    asked = Asked(
        context.scene, settings, distance_sharpness=None, surface_bias=0.0, visibility_bias=0.0
    )
    return probe_stages(IrradianceProbes.name, context, asked)


def _remarks(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Light of a sky that no probe sees."""
    settings: IrradianceProbeSettings = job.settings
    volume = settings.volume(scene)
    return sky_remarks(IrradianceProbes.name, scene, volume, 0.0, max(volume.spacing))


def _flaws(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """Walls thinner than probes are apart: those on both sides count, whatever lies between."""
    settings: IrradianceProbeSettings = job.settings
    return leaking_walls(
        scene,
        max(settings.volume(scene).spacing),
        "the distance of probes, which know of no walls",
        "ddgi and light-field-probes test what a probe sees, for more time and memory",
    )


SPEC = TechniqueSpec(
    name=IrradianceProbes.name,
    title="Irradiance probes",
    variants=(PUBLISHED, TUNED),
    settings_type=IrradianceProbeSettings,
    stages=_stages,
    woken_by=frozenset({Wakes.LIGHTS, Wakes.OBJECTS}),
    follows=frozenset({Follows.DIRECT_LIGHT}),
    create=IrradianceProbes,
    buffers=declared,
    sweep=probe_sweep,
    knobs=probe_knobs,
    check=check_volume,
    remarks=_remarks,
    flaws=_flaws,
    memory_options=("--probes", "--set irradiance-probes.map_texels", "--resolution"),
    counts={"probes": "probes"},
)
