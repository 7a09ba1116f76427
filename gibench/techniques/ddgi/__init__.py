"""Dynamic Diffuse Global Illumination (Majercik et al. 2019; Majercik et al. 2021)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gibench.bake.stage import Keep, Stage, Unit, stage_key
from gibench.scene.model import Scene
from gibench.techniques.ddgi.blending import Published
from gibench.techniques.ddgi.placement import make_volume
from gibench.techniques.ddgi.probes import Probes
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.ddgi.technique import Ddgi
from gibench.techniques.parts.frame_scene import frame_scene_bytes
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.registry import PUBLISHED, TUNED, BakeContext, Follows, TechniqueSpec
from gibench.work import Worker

__all__ = ["SPEC", "Ddgi", "DdgiSettings", "Volume"]


def _stages(context: BakeContext) -> tuple[Stage, ...]:
    """The probe volume: made in no time, so that it is not stored."""
    given = context.scene, context.settings
    low, high = context.scene.bounds
    key = stage_key("ddgi-volume", 1, low, high, context.scene.probes.count, context.settings)
    return (Stage("ddgi-volume", key, compute=_volume, given=given, keep=Keep.NEVER),)


def _volume(
    given: tuple[Scene, DdgiSettings], needed: Sequence[Any], unit: Unit, worker: Worker
) -> Volume:
    return make_volume(*given)


def _check(scene: Scene, settings: DdgiSettings) -> None:
    make_volume(scene, settings)


def _memory_floor(
    scene: Scene, receivers: int, settings: DdgiSettings, width: int, height: int
) -> int:
    """Scene, maps and the smaller variant's rays."""
    probes = make_volume(scene, settings).probes
    own = Probes.bytes_of(settings, probes) + Published.bytes_of(settings, probes)
    return frame_scene_bytes(scene, width, height) + own


def _sweep(scene: Scene) -> dict[str, tuple[int, ...]]:
    probes = scene.probes.count
    return {"rays": (64, 256), "probes": (4 * probes, 8 * probes)}


SPEC = TechniqueSpec(
    name="ddgi",
    title="Probe volumes (DDGI)",
    variants=(PUBLISHED, TUNED),
    settings_type=DdgiSettings,
    stages=_stages,
    create=Ddgi,
    memory_floor=_memory_floor,
    follows=frozenset({Follows.DIRECT_LIGHT, Follows.INDIRECT_LIGHT}),
    sweep=_sweep,
    check=_check,
    memory_options=("--probes", "--set ddgi.rays", "--resolution"),
    counts={"probes": "probes"},
)
