"""One check of a kernel tree against another: pairs of fresh processes until it is decided."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gibench.errors import CheckFailed
from gibench.measure.compare.kernel_trees import KernelTree
from gibench.measure.compare.lockstep import PairTimes, time_pair
from gibench.measure.compare.paired import Judged, judge_rows, looks, undecided
from gibench.measure.compare.replicate import Place
from gibench.measure.plan.stopping import Patience
from gibench.measure.session.shared import Shared
from gibench.scene.model import Scene
from gibench.techniques.job import Job
from gibench.techniques.registry import find_technique

AB_PATIENCE = Patience(seconds=30.0)
"""Each pair of processes fills anew: longer, and 100 seconds hold too few of them for a verdict."""


@dataclass(frozen=True)
class AbOptions:
    """How a check is run.

    Attributes:
        threshold: the least relative change that matters.
        replicates: pairs of processes, exactly; None lets the rule decide.
        most: pairs at most when the rule decides.
        seconds: no further pair is begun after them when the rule decides.
        frames: measured by every process.
        warmup: run before them at least.
        patience: how long each process is waited for until it is at rest.
        seed: of the order in which frames take turns.
    """

    threshold: float = 0.05
    replicates: int | None = None
    most: int = 24
    seconds: float = 100.0
    frames: int = 24
    warmup: int = 4
    patience: Patience = AB_PATIENCE
    seed: int = 0


@dataclass
class AbResult:
    """What came out.

    Attributes:
        judged: by row: the frame and every pass.
        log_ratios: by row, one per pair.
        old_ms: by row, the median over pairs of a process's median time.
        new_ms: likewise.
        output_difference: by output, the relative root mean square difference of what the two
            trees compute; nan where one of them is not finite.
        seconds: it took.
        warmup: frames that a process ran first, at most.
        rest: what a reader must know of processes that were not at rest after them.
    """

    old: KernelTree
    new: KernelTree
    judged: dict[str, Judged]
    log_ratios: dict[str, list[float]]
    old_ms: dict[str, float]
    new_ms: dict[str, float]
    output_difference: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    warmup: int = 0
    rest: str = ""


def check(
    job: Job,
    place: Place,
    old: KernelTree,
    new: KernelTree,
    options: AbOptions,
    advance: Callable[[int], None] = lambda steps: None,
) -> AbResult:
    """Time ``new`` against ``old`` on ``job``; of ``place`` the kernels are theirs.

    Raises:
        SideFailed: one tree cannot run.
    """
    begin = time.monotonic()
    rng = np.random.default_rng(options.seed)
    sides = [replace(place, kernel_root=str(tree.root)) for tree in (old, new)]
    most = options.replicates or options.most
    ends = (most,) if options.replicates else looks(most)
    pairs: list[PairTimes] = []
    differences: dict[str, float] = {}
    judged: dict[str, Judged] = {}
    with tempfile.TemporaryDirectory() as folder:
        for count in range(1, most + 1):
            keep = Path(folder) if count == 1 else None
            pair = time_pair(
                job,
                old=sides[0],
                new=sides[1],
                frames=options.frames,
                warmup=options.warmup,
                rng=rng,
                keep=keep,
                patience=options.patience,
            )
            pairs.append(pair)
            advance(1)
            if keep is not None:
                differences = output_differences(keep)
            late = not options.replicates and time.monotonic() - begin > options.seconds
            if count in ends or late:
                judged = judge_rows(log_ratios(pairs), options.threshold)
                if late or not undecided(judged):
                    break
    old_ms, new_ms = (
        {
            name: float(np.median([np.median(getattr(pair, side)[name]) for pair in pairs]))
            for name in judged
        }
        for side in ("old", "new")
    )
    return AbResult(
        old=old,
        new=new,
        judged=judged,
        log_ratios=log_ratios(pairs),
        old_ms=old_ms,
        new_ms=new_ms,
        output_difference=differences,
        seconds=time.monotonic() - begin,
        warmup=max(pair.warmup for pair in pairs),
        rest=next((told for pair in pairs for told in pair.rest.values()), ""),
    )


def bake_once(job: Job, cache_dir: Path) -> Scene:
    """Bake what ``job`` needs into the cache, so that no replicate has to; its scene.

    Raises:
        GibenchError: it cannot be baked, or the settings are wrong.
    """
    shared = Shared(cache_dir, job.seed)
    scene = shared.scene(job.scene)
    receivers = job.receivers or scene.receivers
    shared.baked(find_technique(job.technique), job.settings, job.scene, receivers)
    return scene


def log_ratios(pairs: list[PairTimes]) -> dict[str, list[float]]:
    """The log ratios of every row, one per pair."""
    each = [pair.log_ratios() for pair in pairs]
    return {name: [one[name] for one in each] for name in each[0]}


def output_differences(folder: Path) -> dict[str, float]:
    """How much what NEW computed differs from OLD, by output.

    Raises:
        CheckFailed: NEW computes something that is not finite where OLD does not.
    """
    found = {}
    with np.load(folder / "OLD.npz") as old, np.load(folder / "NEW.npz") as new:
        for name in old.files:
            a, b = old[name].astype(np.float64), new[name].astype(np.float64)
            if np.isfinite(a).all() and not np.isfinite(b).all():
                raise CheckFailed(f"NEW: its {name} is not finite")
            scale = float(np.sqrt(np.mean(a**2)))
            found[name] = float(np.sqrt(np.mean((b - a) ** 2))) / scale if scale else 0.0
    return found
