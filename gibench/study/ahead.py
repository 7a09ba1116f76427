"""What points need, computed before they are sent to other processes: bakes and truths.

Both go out in pieces that any worker can compute. Where workers do not see the parent's cache
folder, what was computed travels with the points: scenes, lightmaps, bakes and truths as arrays
that each worker is sent once, by their content.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from gibench.bake.lightmap import lightmap_key
from gibench.bake.stage import Keep, Stage
from gibench.bake.store import BakeStore
from gibench.errors import BadInput, CannotRun
from gibench.measure.plan.fit import Footprint
from gibench.reference.store import stored_file
from gibench.study.site import Site
from gibench.techniques.job import Job, Known
from gibench.techniques.registry import BakeContext, find_technique
from gibench.work import Executor, elsewhere


def bake_ahead(jobs: Sequence[Job], site: Site) -> None:
    """Bake what ``jobs`` need with the site's executor; what cannot be is told where it is run.

    Raises:
        GibenchError: the executor cannot go on.
    """
    shared = site.moving()
    for job in jobs:
        with suppress(BadInput, CannotRun):
            spec, scene = find_technique(job.technique), shared.scene(job.scene)
            receivers = job.receivers or scene.receivers
            Footprint(spec, Known(job, scene, receivers)).check(receivers)
            shared.baked(spec, job.settings, job.scene, receivers)


def site_for(
    executor: Executor | None, jobs: Sequence[Job], site: Site, truths: Iterable[str]
) -> Site:
    """``site`` as units sent by ``executor`` need it: with all that they find in its cache folder,
    where workers do not see that; ``truths`` are the keys of those that they read.
    """
    shares = getattr(executor, "shares", None)
    if not elsewhere(executor) or shares is None or shares(site.cache_dir):
        return site
    scenes = {job.scene: site.moving().scene(job.scene) for job in jobs}
    files: dict[str, np.ndarray] = {}
    for path in _cached(jobs, site, truths):
        name = str(path.relative_to(site.cache_dir))
        if name not in files and path.is_file():
            files[name] = np.fromfile(path, np.uint8)
    return replace(site, scenes=scenes, files=files)


def _cached(jobs: Sequence[Job], site: Site, truths: Iterable[str]) -> Iterator[Path]:
    """Files of the cache folder that ``jobs`` read, as far as they are there."""
    shared = site.moving()
    for job in jobs:
        with suppress(BadInput, CannotRun):
            spec, scene = find_technique(job.technique), shared.scene(job.scene)
            receivers = job.receivers or scene.receivers
            yield site.cache_dir / "lightmaps" / f"{lightmap_key(scene, receivers)}.npz"
            lightmap = shared.lightmap(job.scene, receivers)
            context = BakeContext(scene, lightmap, job.settings, site.cache_dir, site.seed)
            stages = spec.stages(context)
            if stages:
                yield from _stored(stages[-1], site.cache_dir)
    for key in truths:
        yield stored_file(site.cache_dir, key)


def _stored(stage: Stage, folder: Path) -> Iterator[Path]:
    """The files that the value of ``stage`` is read from."""
    if stage.keep is Keep.NEVER:
        for need in stage.needs:
            yield from _stored(need, folder)
        return
    yield from sorted(BakeStore.of(folder, stage).path.glob("*.bin"))
