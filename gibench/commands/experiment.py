"""``gibench experiment``, and :func:`gibench.experiment`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput
from gibench.measure.plan.shard import Shard
from gibench.measure.plan.stopping import Patience
from gibench.measure.record import on_one_machine, study_record
from gibench.measure.runfolder.folder import RunFolder
from gibench.reference.path_tracer import check_paths
from gibench.scene.load import names_apart
from gibench.study.experiments import find_experiment
from gibench.study.experiments.common import Context, Experiment
from gibench.study.experiments.running import points_left, run_experiment, shard_record
from gibench.study.experiments.taken import read_errors
from gibench.study.quality import check_target_error
from gibench.study.site import Site
from gibench.study.where import timed_where
from gibench.work import Executor


@dataclass(frozen=True)
class ExperimentResult:
    """What an experiment left.

    Attributes:
        folder: with everything that was written.
        table: the experiment's rows.
    """

    folder: Path
    table: pd.DataFrame = field(repr=False)


@within_bounds
def experiment(
    name: str,
    quick: bool = False,
    device_profile: asked.Texts | None = None,
    scene: asked.Texts | None = None,
    target_error: float = 0.02,
    reference_paths: int | None = None,
    frames: int = 30,
    warmup_frames: int = 1000,
    warmup_seconds: float = 180.0,
    resolution: str | None = None,
    target: float | None = None,
    errors_from: str | Path | None = None,
    shard: str | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    device: int | None = None,
    cache_dir: str | Path | None = None,
    executor: Executor | None = None,
) -> ExperimentResult:
    """Repeat one of the papers' experiments, as ``gibench experiment`` does; its help says what
    everything is.

    ``executor`` computes what is baked and the experiment's points
    (:mod:`gibench.work.executors`); no result depends on it, and frames are timed one at a time.

    Raises:
        BadInput: an input is wrong, or the folder holds another experiment.
        Interrupted: by Ctrl-C; what was measured is kept and reported.
        GibenchError: nothing could be measured: the first reason.
    """
    chosen = find_experiment(name)
    check_target_error(target_error)
    check_paths(reference_paths, "--reference-paths")
    _check_target(chosen, target)
    image = None if resolution is None else asked.image_size(resolution)
    profiles = asked.load_profiles(asked.several(device_profile) or chosen.profiles)
    cl_device = select_cl_device(device)
    cache, scenes = asked.cache_folder(cache_dir), asked.several(scene)
    site = Site(cache, seed, device, executor, names=names_apart(scenes))
    arguments: dict[str, Any] = {
        "experiment": chosen.name,
        "quick": quick,
        "profiles": [profile.name for profile in profiles],
        "scene": [Path(path).name for path in scenes],
        "target_error": target_error,
        "reference_paths": reference_paths,
        "frames": frames,
        "warmup_frames": warmup_frames,
        "warmup_seconds": warmup_seconds,
        "resolution": resolution,
        "target": target,
        "seed": seed,
    }
    if found := asked.contents(scenes, site.standing()):
        arguments["scene_contents"] = found
    taken = None
    if errors_from is not None:
        before = Path(errors_from)
        taken = read_errors(before, chosen.name, chosen.keys, chosen.errors, arguments)
        arguments["errors_from"] = before.name
    context = Context(
        profiles=tuple(profiles),
        site=site,
        scenes=scenes,
        quick=quick,
        frames=frames,
        patience=Patience(warmup_frames, warmup_seconds),
        resolution=image,
        target_error=target_error,
        reference_paths=reference_paths,
        target=target,
        taken=taken,
    )
    part = Shard.parse(shard)
    if part is not None:
        arguments["shard"] = shard_record(chosen, context, part)
    own = Path("results", "experiments", chosen.name + ("-quick" if quick else ""))
    folder = RunFolder.create(Path(out) if out else own, arguments)
    complete = not points_left(chosen, context, folder, part)
    asks = chosen.timed and not complete
    there = timed_where(executor, profiles[0], device) if asks else None
    record = study_record(arguments, cl_device, there)
    record = on_one_machine(folder, record, complete=complete)
    folder.write_record(record)
    cpu = record["environment"]["cpu"]
    table = run_experiment(chosen, context, folder, executor, part, cpu)
    return ExperimentResult(folder.path, table)


def _check_target(chosen: Experiment, target: float | None) -> None:
    """Refuse a target of an experiment that has none, or one that is never met.

    Raises:
        BadInput: naming it.
    """
    if target is None:
        return
    where = f"--target {target:g}"
    if not chosen.target:
        raise BadInput(
            f"the experiment '{chosen.name}' has no target",
            where=where,
            mend="leave it out; equal-time and equal-error have one",
        )
    if not 0 < target < float("inf"):
        raise BadInput(
            "a target of 0 or less is met by nothing",
            where=where,
            mend=f"give more than 0 ({chosen.target})",
        )
