"""``gibench experiment``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.errors import printable


def experiment(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="The experiment; alone, all are listed."),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Small sizes that show that it works; the figures mean nothing."
        ),
    ] = False,
    device_profile: Annotated[
        list[str] | None,
        typer.Option(
            "--device-profile",
            "-d",
            metavar="NAME|FILE",
            help="Devices to model; by default the experiment's own.",
        ),
    ] = None,
    scene: Annotated[
        list[str] | None,
        typer.Option(
            "--scene",
            "-s",
            metavar="NAME|FILE",
            help="Instead of the experiment's own scenes, for instance the real Sponza.",
        ),
    ] = None,
    target_error: options.TargetError = 0.02,
    reference_paths: options.ReferencePaths = None,
    frames: Annotated[
        int,
        typer.Option(
            "--frames",
            "-n",
            min=1,
            metavar="N",
            help="Frames timed per point; a flight, and frames after a switched light, take eight "
            "times as many.",
        ),
    ] = 30,
    warmup_frames: options.WarmupFrames = 1000,
    warmup_seconds: options.WarmupSeconds = 180.0,
    resolution: Annotated[
        str | None,
        typer.Option(
            "--resolution", metavar="WxH", help="Camera image; by default the experiment's own."
        ),
    ] = None,
    shard: options.Shard = None,
    target: Annotated[
        float | None,
        typer.Option(
            "--target",
            metavar="X",
            help="What is to be the same for every technique: GI ms of equal-time (3), relative L2 "
            "error of equal-error (0.2).",
        ),
    ] = None,
    errors_from: Annotated[
        Path | None,
        typer.Option(
            "--errors-from",
            metavar="DIR",
            help="Folder of an earlier run of the same experiment whose errors are taken, so that "
            "only times are measured; points that it lacks are measured whole.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        options.out_folder(
            "Folder for its results; by default results/experiments/NAME. Points already "
            "there are not measured again."
        ),
    ] = None,
    scheduler: options.Scheduler = None,
    scheduler_file: options.SchedulerFile = None,
    workers: options.Workers = None,
    seed: options.Seed = 0,
    device: options.DeviceNumber = None,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Repeat one of the papers' experiments; alone, list them.

    Each leaves a CSV, a Markdown report and plots, with the paper's published figures beside ours
    where there are any. Interrupted, the same command goes on from there.

    Examples:

      gibench experiment

      gibench experiment sh-order

      gibench experiment receiver-reduction --scene sponza.obj

      gibench experiment ray-budget --scene sponza.obj

      gibench experiment equal-time --target 3 --scene hall
    """
    if name is None:
        from rich.markup import escape
        from rich.table import Table

        from gibench.report.terminal import console
        from gibench.study.experiments import EXPERIMENTS

        table = Table("name", "what it shows", "after")
        for item in EXPERIMENTS.values():
            table.add_row(item.name, escape(item.title), escape(item.source))
        console().print(table)
        return
    from gibench.commands.cluster import cluster
    from gibench.commands.experiment import experiment as repeat

    with cluster(scheduler, scheduler_file, workers) as executor:
        result = repeat(
            name,
            quick=quick,
            device_profile=device_profile,
            scene=scene,
            target_error=target_error,
            reference_paths=reference_paths,
            frames=frames,
            warmup_frames=warmup_frames,
            warmup_seconds=warmup_seconds,
            resolution=resolution,
            target=target,
            errors_from=errors_from,
            shard=shard,
            out=out,
            seed=seed,
            device=device,
            cache_dir=cache_dir,
            executor=executor,
        )
    if not quiet:
        done = int((result.table["status"] == "ok").sum())
        typer.echo(
            f"{done} of {len(result.table)} rows measured; see {printable(str(result.folder))}"
        )
