"""Sparse Radiance Probes (Silvennoinen and Lehtinen 2017; Bennett 2019)."""

from __future__ import annotations

from dataclasses import replace

from gibench.bake.stage import Stage
from gibench.scene.model import Scene
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import frame_scene_bytes
from gibench.techniques.registry import PUBLISHED, TUNED, BakeContext, TechniqueSpec
from gibench.techniques.srp.bake.data import MAX_SH_ORDER, sh_count
from gibench.techniques.srp.settings import SrpSettings
from gibench.techniques.srp.technique import Srp

__all__ = ["SPEC", "Srp", "SrpSettings"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    """Bake the highest order, whatever order is asked for: one bake then serves them all."""
    from gibench.techniques.srp.bake.stages import Given, srp_stages

    settings: SrpSettings = context.settings
    own = context.scene.probes
    # The scene's own number said aloud, so that asking for it by --probes finds the same bake.
    probes = settings.probes or (own.count if own.positions is None else None)
    highest = replace(settings.bake_settings(), sh_order=MAX_SH_ORDER, probes=probes)
    given = Given(context.scene, context.lightmap, highest, context.seed)
    return srp_stages(given, settings.sh_order)


def _memory_floor(
    scene: Scene, receivers: int, settings: SrpSettings, width: int, height: int
) -> int:
    """Scene, receivers, two lightmaps of at least the receivers' texels, probes and their basis.

    What the transport takes is only known once it is baked.
    """
    probes = settings.probes or scene.probes.count
    coefficients = sh_count(settings.sh_order)
    return (
        frame_scene_bytes(scene, width, height)
        + FrameLightmap.bytes_of(len(scene.triangles), receivers)
        + 2 * FrameLightmap.map_bytes(receivers)
        + 12 * probes * coefficients
        + 4 * settings.relight_samples * coefficients
    )


def _sweep(scene: Scene) -> dict[str, tuple[int, ...]]:
    probes = scene.probes.count
    return {"sh_order": (2, 4, 7), "probes": (max(1, probes // 2), probes)}


SPEC = TechniqueSpec(
    name="srp",
    title="Sparse Radiance Probes",
    variants=(PUBLISHED, TUNED),
    settings_type=SrpSettings,
    stages=_stages,
    create=Srp,
    memory_floor=_memory_floor,
    sweep=_sweep,
    counts={"probes": "probes"},
)
