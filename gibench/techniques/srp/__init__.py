"""Sparse Radiance Probes (Silvennoinen and Lehtinen 2017; Bennett 2019)."""

from __future__ import annotations

from dataclasses import replace

from gibench.bake.run import run_bake
from gibench.bake.stage import Stage
from gibench.device import SIMT, BufferSpec
from gibench.errors import BadInput
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.job import Job, Known
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.free_space import free_space
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.gloss_table import GlossTable
from gibench.techniques.parts.normal_map_table import NormalMapTable
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.parts.recolouring import Recolouring, Shares
from gibench.techniques.registry import (
    PUBLISHED,
    TUNED,
    BakeContext,
    Follows,
    Knob,
    TechniqueSpec,
)
from gibench.techniques.srp.bake.data import MAX_SH_ORDER, sh_count
from gibench.techniques.srp.bake.settings import USUAL_ORDERS
from gibench.techniques.srp.common import TransportSizes
from gibench.techniques.srp.movers import Movers
from gibench.techniques.srp.pack import TunedSizes
from gibench.techniques.srp.pack_simt import SimtShape, SimtSizes
from gibench.techniques.srp.published import Published
from gibench.techniques.srp.remarks import remarks, unseen_remarks
from gibench.techniques.srp.resting import resting_lightmap, resting_scene
from gibench.techniques.srp.settings import SrpSettings
from gibench.techniques.srp.simt import Simt
from gibench.techniques.srp.technique import Srp
from gibench.techniques.srp.tuned import Tuned
from gibench.techniques.srp.turns import ProbeTurns

__all__ = ["SPEC", "Srp", "SrpSettings"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    """Bake the highest order, whatever order is asked for: one bake then serves them all. With
    receivers of order 1, whose rows are four times as many, one serves orders up to the usual 4,
    and one those above.
    """
    from gibench.techniques.srp.bake.stages import Given, srp_stages

    settings: SrpSettings = context.settings
    own = context.scene.probes
    # The scene's own number said aloud, so that asking for it by --probes finds the same bake.
    probes = settings.probes or (own.count if own.positions is None else None)
    usual = USUAL_ORDERS[settings.receiver_order]
    highest = usual if settings.order <= usual else MAX_SH_ORDER
    baked = replace(settings.bake_settings(), sh_order=highest, probes=probes)
    scene, lightmap = context.scene, context.lightmap
    if context.moving is not None and context.moving.any():
        scene = resting_scene(scene, context.moving)
        lightmap = resting_lightmap(lightmap, context.moving)
    given = Given(scene, lightmap, baked, context.seed)
    return srp_stages(given, settings.order)


def _bake_remarks(job: Job, context: BakeContext) -> list[str]:
    """What the probes see, once they are placed."""
    settings: SrpSettings = job.settings
    if settings.sky == "receivers" or free_space(context.scene).sky <= 0:
        return []
    stages = _stages(context)
    (relight,) = (n for n, stage in enumerate(stages) if stage.name == "srp-relight")
    probes = run_bake(stages[:relight], context.cache_dir)  # the last of those that place them
    moves = context.moving is not None and bool(context.moving.any())
    return unseen_remarks(context.scene, context.lightmap, probes, moves=moves)


def _buffers(known: Known) -> list[BufferSpec]:
    """Scene, receivers, maps, probes and transport, of which only the bake tells how much it is."""
    job, scene, lightmap = known.job, known.scene, known.lightmap
    settings: SrpSettings = job.settings
    motion = known.motion if known.motion is not None and known.motion.moves else None
    receivers, more = known.receivers, list[BufferSpec]()
    if lightmap is None:
        if motion is not None:
            # How many lie on what moves only the atlas tells; seldom is it more than half.
            receivers //= 2
        sizes = TransportSizes.least(
            probes=(settings.probes or scene.probes.count) + (settings.sky == "receivers"),
            coefficients=sh_count(settings.order),
            samples=settings.relight_samples,
            receivers=receivers,
        )
        packed, texels, border = TunedSizes(), receivers, 0
    else:
        if motion is not None:
            lightmap = resting_lightmap(lightmap, motion.triangles)
            receivers = len(lightmap.receivers)
            more += Movers.buffers(scene, motion, known.baked)
        sizes = TransportSizes.of(known.baked, motion is not None)
        packed = TunedSizes.of(known.baked, known.vector_width)
        texels, border = lightmap.width * lightmap.height, len(border_texels(lightmap))
        more += _changing(known, lightmap)
    if job.variant == TUNED and known.layout == SIMT:
        shape = SimtShape.of(job.profile, job.group_size, known.lanes_together)
        least = SimtSizes()
        if lightmap is not None:
            least = SimtSizes.of(known.baked, shape)
        own = Simt.buffers(sizes, least, settings.storage, shape, texels=texels, border=border)
    elif job.variant == TUNED:
        own = Tuned.buffers(
            sizes,
            packed,
            settings.storage,
            texels=texels,
            border=border,
            device_width=known.vector_width,
        )
    else:
        own = Published.buffers(sizes, settings.storage, texels)
    return [
        *FrameScene.declared(known),
        *FrameLightmap.buffers(len(scene.triangles), receivers),
        ReceiverSignal.spec("indirect", texels, settings.components),
        ProbeTurns.buffer(sizes.probes),
        *more,
        *own,
        *(NormalMapTable.buffers(scene) if settings.normal_maps else ()),
        *(GlossTable.buffers(scene) if settings.gloss else ()),
        HitBuffer.spec(job.shot.width, job.shot.height),
    ]


def _changing(known: Known, lightmap: Lightmap) -> list[BufferSpec]:
    """What the receivers whose materials change take."""
    if known.motion is None or known.motion.materials is None:
        return []
    return Recolouring.buffers(Shares.of_receivers(known.scene, lightmap, known.motion.materials))


def _sweep(scene: Scene) -> dict[str, tuple[int, ...]]:
    probes = scene.probes.count
    return {"sh_order": (2, 4, 7), "probes": (max(1, probes // 2), probes)}


def _knobs(scene: Scene) -> tuple[Knob, ...]:
    probes = scene.probes.count
    return Knob("sh_order", tuple(range(8))), Knob(
        "probes", (max(1, probes // 2), probes, 2 * probes)
    )


def _check_moving(settings: SrpSettings) -> None:
    if settings.normal_maps or settings.gloss:
        raise BadInput(
            "srp.normal_maps and srp.gloss shade scenes in which nothing moves",
            mend="leave them out, or leave out --motion",
        )
    if settings.sky == "receivers":
        raise BadInput(
            "srp.sky=receivers knows nothing of what moves before the sky",
            mend="use --set srp.sky=probes, or leave out --motion",
        )


def _shades_normal_maps(settings: SrpSettings) -> bool:
    return settings.normal_maps


SPEC = TechniqueSpec(
    name="srp",
    title="Sparse Radiance Probes",
    variants=(PUBLISHED, TUNED),
    settings_type=SrpSettings,
    stages=_stages,
    create=Srp,
    buffers=_buffers,
    follows=frozenset({Follows.DIRECT_LIGHT, Follows.INDIRECT_LIGHT}),
    check_moving=_check_moving,
    bakes_what_rests=True,
    sweep=_sweep,
    knobs=_knobs,
    remarks=remarks,
    bake_remarks=_bake_remarks,
    shades_normal_maps=_shades_normal_maps,
    normal_map_options="--set srp.receiver_order=1 --set srp.normal_maps=true",
    counts={"probes": "probes"},
)
