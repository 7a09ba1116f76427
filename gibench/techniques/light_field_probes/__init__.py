"""Precomputed light field probes (McGuire et al. 2017): irradiance, and what a probe sees."""

from __future__ import annotations

from gibench.bake.stage import Stage
from gibench.techniques.light_field_probes.settings import LightFieldProbeSettings
from gibench.techniques.light_field_probes.technique import LightFieldProbes
from gibench.techniques.parts.captured_probes.stages import Asked, probe_stages
from gibench.techniques.parts.captured_probes.technique import check_volume, declared, probe_sweep
from gibench.techniques.registry import PUBLISHED, TUNED, BakeContext, TechniqueSpec, Wakes

__all__ = ["SPEC", "LightFieldProbeSettings", "LightFieldProbes"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    settings: LightFieldProbeSettings = context.settings
    asked = Asked(
        context.scene,
        settings,
        distance_sharpness=settings.filter_sharpness,
        surface_bias=settings.surface_bias,
        visibility_bias=settings.visibility_bias,
        rays=settings.bounce_rays,
        denoise=settings.denoise if settings.bounce_rays else 0,
    )
    return probe_stages(LightFieldProbes.name, context, asked)


SPEC = TechniqueSpec(
    name=LightFieldProbes.name,
    title="Light field probes",
    variants=(PUBLISHED, TUNED),
    settings_type=LightFieldProbeSettings,
    stages=_stages,
    woken_by=frozenset({Wakes.LIGHTS, Wakes.OBJECTS}),
    create=LightFieldProbes,
    buffers=declared,
    sweep=probe_sweep,
    check=check_volume,
    memory_options=("--probes", "--set light-field-probes.map_texels", "--resolution"),
    counts={"probes": "probes"},
)
