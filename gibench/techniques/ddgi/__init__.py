"""Dynamic Diffuse Global Illumination (Majercik et al. 2019; Majercik et al. 2021)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gibench.bake.stage import Keep, Stage, Unit, stage_key
from gibench.device import BufferSpec
from gibench.scene.model import Scene
from gibench.techniques.ddgi.blending import Published, Tuned, lanes_of
from gibench.techniques.ddgi.passes import DdgiPasses
from gibench.techniques.ddgi.placement import PROBES_PER_SRP_PROBE, make_volume
from gibench.techniques.ddgi.probes import Probes
from gibench.techniques.ddgi.remarks import flaws, remarks
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.ddgi.technique import Ddgi
from gibench.techniques.job import Known
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.registry import (
    PUBLISHED,
    TUNED,
    BakeContext,
    Follows,
    Knob,
    TechniqueSpec,
    steps,
)
from gibench.work import Worker

__all__ = ["SPEC", "Ddgi", "DdgiSettings", "Volume"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    """The probe volume: made in no time, so that it is not stored."""
    given = context.scene, context.settings
    volume = make_volume(*given)
    where = volume.origin, volume.spacing, volume.counts
    key = stage_key("ddgi-volume", 2, where, context.settings)
    return (Stage("ddgi-volume", key, compute=_volume, given=given, keep=Keep.NEVER),)


def _volume(
    given: tuple[Scene, DdgiSettings], needed: Sequence[Any], unit: Unit, worker: Worker
) -> Volume:
    return make_volume(*given)


def _check(scene: Scene, settings: DdgiSettings) -> None:
    make_volume(scene, settings)


def _buffers(known: Known) -> list[BufferSpec]:
    """Scene, probes, the variant's rays, sums, and what the camera's rays hit."""
    job = known.job
    settings: DdgiSettings = job.settings
    probes = make_volume(known.scene, settings).probes
    lanes = lanes_of(known.vector_width, job.profile.simd_width)
    tuned = job.variant == TUNED
    return [
        *FrameScene.declared(known),
        *Probes.buffers(settings, probes),
        *(Tuned.buffers(settings, probes, lanes) if tuned else Published.buffers(settings, probes)),
        *DdgiPasses.sums(settings, probes, job.group_size),
        HitBuffer.spec(job.shot.width, job.shot.height),
    ]


def _sweep(scene: Scene) -> dict[str, tuple[int, ...]]:
    probes = make_volume(scene, DdgiSettings()).probes
    if not scene.probes.automatic:
        probes = PROBES_PER_SRP_PROBE * scene.probes.count
    return {"rays": (64, 256), "probes": (probes // 2, probes)}


def _knobs(scene: Scene) -> tuple[Knob, ...]:
    fewer, probes = _sweep(scene)["probes"]
    return Knob("rays", steps(48, 2048, 25, whole=True)), Knob(
        "probes", (fewer, probes, 2 * probes)
    )


SPEC = TechniqueSpec(
    name="ddgi",
    title="Probe volumes (DDGI)",
    variants=(PUBLISHED, TUNED),
    settings_type=DdgiSettings,
    stages=_stages,
    create=Ddgi,
    buffers=_buffers,
    follows=frozenset({Follows.DIRECT_LIGHT, Follows.INDIRECT_LIGHT}),
    sweep=_sweep,
    knobs=_knobs,
    check=_check,
    remarks=remarks,
    flaws=flaws,
    memory_options=("--probes", "--set ddgi.rays", "--resolution"),
    counts={"probes": "probes"},
)
