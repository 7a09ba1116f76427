"""``gibench bake``, and :func:`gibench.bake_ahead`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.measure.plan.grid import check_options, check_settings_names, settings_grid
from gibench.measure.session.shared import Shared
from gibench.work import Executor


@dataclass(frozen=True)
class Baked:
    """One bake that is in the cache now.

    Attributes:
        technique: its name.
        scene: the scene's own name.
        receivers: how many there are.
        settings: the technique's settings dataclass.
        seconds: that it took; next to nothing where it was there already.
    """

    technique: str
    scene: str
    receivers: int
    settings: Any
    seconds: float


@within_bounds
def bake_ahead(
    scene: asked.Texts = ("cornell-box",),
    technique: asked.Texts = ("srp",),
    sh_order: asked.Numbers = None,
    probes: asked.Numbers = None,
    receivers: asked.Numbers = None,
    settings: asked.SettingsAsked = None,
    seed: int = 0,
    cache_dir: str | Path | None = None,
    executor: Executor | None = None,
) -> Iterator[Baked]:
    """Compute ahead what a run needs, as ``gibench bake`` does; one bake after the other, as they
    are asked for.

    ``executor`` computes them (:mod:`gibench.work.executors`); no result depends on it.

    Raises:
        BadInput: an input is wrong, told before anything long.
    """
    specs = asked.find_techniques(technique)
    chosen_settings = asked.read_settings(settings)
    common = asked.by_option(sh_order, probes)
    check_options((), asked.several(receivers), ())
    check_settings_names(specs, chosen_settings)
    work = [
        (spec, chosen)
        for spec in specs
        for chosen in settings_grid(spec, common, chosen_settings.get(spec.name, {}))
    ]
    shared = Shared(asked.cache_folder(cache_dir), seed, executor=executor)
    names = asked.several(scene)
    for name in names:
        shared.scene(name)
    for name in names:
        for count in asked.several(receivers) or (shared.scene(name).receivers,):
            for spec, chosen in work:
                begin = time.perf_counter()
                lightmap, _ = shared.baked(spec, chosen, name, count)
                yield Baked(
                    technique=spec.name,
                    scene=shared.scene(name).name,
                    receivers=len(lightmap.receivers),
                    settings=chosen,
                    seconds=time.perf_counter() - begin,
                )
