"""Sparse Radiance Probes (Silvennoinen and Lehtinen 2017; Bennett 2019)."""

from __future__ import annotations

from dataclasses import replace

from gibench.scene.model import Scene
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import frame_scene_bytes
from gibench.techniques.registry import PUBLISHED, TUNED, BakeContext, TechniqueSpec
from gibench.techniques.srp.bake.data import MAX_SH_ORDER, SrpBake, sh_count
from gibench.techniques.srp.settings import SrpSettings
from gibench.techniques.srp.technique import Srp

__all__ = ["SPEC", "Srp", "SrpSettings"]


def _bake(context: BakeContext) -> SrpBake:
    """Bake the highest order, whatever order is asked for: one bake then serves them all."""
    from gibench.techniques.srp.bake.lower_order import lower_order
    from gibench.techniques.srp.bake.stages import bake_srp

    settings: SrpSettings = context.settings
    given = context.scene.probes
    # The scene's own number said aloud, so that asking for it by --probes finds the same bake.
    probes = settings.probes or (given.count if given.positions is None else None)
    highest = replace(settings.bake_settings(), sh_order=MAX_SH_ORDER, probes=probes)
    bake = bake_srp(context.scene, context.lightmap, highest, context.cache_dir, seed=context.seed)
    if settings.sh_order == MAX_SH_ORDER:
        return bake
    return lower_order(bake, settings.sh_order, settings.svd_vectors, settings.svd_threshold)


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
    bake=_bake,
    create=Srp,
    memory_floor=_memory_floor,
    sweep=_sweep,
)
