"""Precomputed surfel caches (Jendersie, Kuri and Grosch 2016)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.bake.stage import Stage
from gibench.device import BufferSpec
from gibench.errors import BadInput
from gibench.scene.model import Scene
from gibench.techniques.job import Known
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.recolouring import Recolouring
from gibench.techniques.registry import (
    PUBLISHED,
    TUNED,
    BakeContext,
    Follows,
    Knob,
    TechniqueSpec,
    Wakes,
    steps,
)
from gibench.techniques.surfel_cache.bake.stages import Given, surfel_cache_stages, volume_of
from gibench.techniques.surfel_cache.pack import Sizes, surfel_shares
from gibench.techniques.surfel_cache.settings import SurfelCacheSettings
from gibench.techniques.surfel_cache.technique import SurfelCache

__all__ = ["SPEC", "SurfelCache", "SurfelCacheSettings"]


def _stages(context: BakeContext) -> Sequence[Stage]:
    return surfel_cache_stages(Given(context.scene, context.lightmap, context.settings))


def _check(scene: Scene, settings: SurfelCacheSettings) -> None:
    objects = len(np.unique(scene.object_ids))
    if settings.surfels < objects:
        raise BadInput(
            f"{settings.surfels} surfels for the {objects} objects of the scene '{scene.name}'",
            mend=f"give {objects} or more",
        )


def _buffers(known: Known) -> list[BufferSpec]:
    """Scene, surfels, hierarchy, links and caches, of which only the bake tells how many."""
    job, tuned = known.job, known.job.variant == TUNED
    settings: SurfelCacheSettings = job.settings
    if known.lightmap is None:
        cells = volume_of(known.scene, settings).probes
        sizes = Sizes.least(settings, known.scene, cells, tuned)
        shares = None
    else:
        sizes = Sizes.of(known.baked, settings, tuned, known.vector_width)
        shares = surfel_shares(known.scene, known.baked, known.motion)
    return [
        *FrameScene.declared(known),
        *sizes.buffers(),
        *([] if shares is None else Recolouring.buffers(shares)),
        HitBuffer.spec(job.shot.width, job.shot.height),
    ]


def _expected(known: Known) -> list[BufferSpec]:
    """All of the caches that are asked for, before anything is baked."""
    settings: SurfelCacheSettings = known.job.settings
    cells = volume_of(known.scene, settings).probes
    tuned = known.job.variant == TUNED
    sizes = Sizes.expected(settings, known.scene, cells, tuned)
    return [
        *FrameScene.declared(known),
        *sizes.buffers(),
        HitBuffer.spec(known.job.shot.width, known.job.shot.height),
    ]


def _sweep(scene: Scene) -> dict[str, tuple[int, ...]]:
    return {"links": (32, 128), "sh_bands": (2, 3)}


def _knobs(scene: Scene) -> tuple[Knob, ...]:
    return Knob("links", steps(8, 254, 23, whole=True)), Knob("sh_bands", (2, 3))


SPEC = TechniqueSpec(
    name="surfel-cache",
    long_bake=True,
    title="Precomputed surfel caches",
    variants=(PUBLISHED, TUNED),
    settings_type=SurfelCacheSettings,
    stages=_stages,
    woken_by=frozenset({Wakes.LIGHTS, Wakes.OBJECTS}),
    create=SurfelCache,
    buffers=_buffers,
    follows=frozenset({Follows.DIRECT_LIGHT}),
    sweep=_sweep,
    knobs=_knobs,
    check=_check,
    counts={"caches": "caches"},
    expected=_expected,
    memory_options=(
        "--set surfel-cache.links",
        "--set surfel-cache.sh_bands",
        "--set surfel-cache.caches",
        "--set surfel-cache.surfels",
        "--resolution",
    ),
)
