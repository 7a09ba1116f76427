"""Irradiance probes: what every old engine ships, no visibility in them."""

from __future__ import annotations

from gibench.bake.stage import Stage
from gibench.techniques.irradiance_probes.settings import IrradianceProbeSettings
from gibench.techniques.irradiance_probes.technique import IrradianceProbes
from gibench.techniques.parts.captured_probes.stages import Asked, probe_stages
from gibench.techniques.parts.captured_probes.technique import check_volume, declared, probe_sweep
from gibench.techniques.registry import PUBLISHED, TUNED, BakeContext, TechniqueSpec, Wakes

__all__ = ["SPEC", "IrradianceProbeSettings", "IrradianceProbes"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    settings: IrradianceProbeSettings = context.settings
    asked = Asked(
        context.scene, settings, distance_sharpness=None, surface_bias=0.0, visibility_bias=0.0
    )
    return probe_stages(IrradianceProbes.name, context, asked)


SPEC = TechniqueSpec(
    name=IrradianceProbes.name,
    title="Irradiance probes",
    variants=(PUBLISHED, TUNED),
    settings_type=IrradianceProbeSettings,
    stages=_stages,
    woken_by=frozenset({Wakes.LIGHTS, Wakes.OBJECTS}),
    create=IrradianceProbes,
    buffers=declared,
    sweep=probe_sweep,
    check=check_volume,
    memory_options=("--probes", "--set irradiance-probes.map_texels", "--resolution"),
    counts={"probes": "probes"},
)
