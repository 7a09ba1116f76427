"""Sparse Radiance Probes (Silvennoinen and Lehtinen 2017; thesis 000)."""

from __future__ import annotations

from gibench.bake.srp_data import SrpBake, sh_count
from gibench.scene.model import Scene
from gibench.techniques.frame_scene import FrameLightmap, frame_scene_bytes
from gibench.techniques.registry import PUBLISHED, TUNED, BakeContext, TechniqueSpec
from gibench.techniques.srp.settings import SrpSettings
from gibench.techniques.srp.technique import Srp

__all__ = ["SPEC", "Srp", "SrpSettings"]


def _bake(context: BakeContext) -> SrpBake:
    from gibench.bake.srp_bake import bake_srp

    settings: SrpSettings = context.settings
    return bake_srp(
        context.scene,
        context.lightmap,
        settings.bake_settings(),
        context.cache_dir,
        seed=context.seed,
    )


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


SPEC = TechniqueSpec(
    name="srp",
    title="Sparse Radiance Probes",
    variants=(PUBLISHED, TUNED),
    settings_type=SrpSettings,
    bake=_bake,
    create=Srp,
    memory_floor=_memory_floor,
)
