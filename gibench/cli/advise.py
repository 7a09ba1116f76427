"""``gibench advise``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.errors import printable

_ALL: list[str] = []


def advise(
    device_profile: options.Profile = "iphone7",
    budget_ms: Annotated[
        float | None,
        typer.Option(
            "--budget-ms",
            metavar="MS",
            help="What a frame may take on this machine; 33.3, which is 30 frames per second, "
            "where no other budget is given.",
            rich_help_panel=options.GRID,
        ),
    ] = None,
    gi_budget_ms: Annotated[
        float | None,
        typer.Option(
            "--gi-budget-ms",
            metavar="MS",
            help="What global illumination may take of it.",
            rich_help_panel=options.GRID,
        ),
    ] = None,
    budget: Annotated[
        list[str],
        typer.Option(
            "--budget",
            metavar="NAME=VALUE",
            help="Any other, repeated for several: memory_mib, bake_s; error, bias, leak, blotches "
            "and missing as shares (frame_ms and gi_ms, too).",
            rich_help_panel=options.GRID,
        ),
    ] = _ALL,
    scene: options.Scene = "cornell-box",
    technique: options.Techniques = _ALL,
    variant: options.Variants = ["tuned"],  # noqa: B006 (typer copies its defaults)
    sh_order: options.ShOrders = None,
    probes: options.Probes = None,
    receivers: options.ReceiverCounts = None,
    settings: options.Set = None,
    light_frame: options.LightFrame = 0,
    target_error: options.TargetError = 0.05,
    reference_paths: options.ReferencePaths = None,
    frames: options.SettleFrames = 256,
    resolution: options.Resolution = "1334x750",
    camera: options.CameraChoice = None,
    project: Annotated[
        str | None,
        typer.Option(
            "--project",
            metavar="NAME|FILE",
            help="Also rank what ran by its projected GI on a device that is not here, as ranges; "
            "needs the extra 'project'.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    shard: options.Shard = None,
    out: Annotated[
        Path | None,
        options.out_folder(
            "Folder for advice.csv, advice.md and the plot; by default "
            "results/advice/<UTC time>-<profile>. Settings that it holds already are not tried "
            "again, whatever the budget."
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
    """Try techniques and settings on a scene and say which fit a budget, and at what error.

    Tries what every technique declares (SH orders, probes, rays) at all, a half and a quarter of
    the scene's receivers; the options narrow that. Tells what fits all budgets, the front of what
    nothing else beats, and what would fit if one budget were raised, and by how much. Times are of
    this machine under the profile's limits, not of the modelled device.

    Examples:

      gibench advise --device-profile iphone7 --budget-ms 33.3 --scene sponza.obj

      gibench advise --gi-budget-ms 3 --budget memory_mib=32 --budget error=0.2

      gibench advise --scene two-rooms --budget leak=0.02 --budget bake_s=60
    """
    from gibench.commands.advise import advise as give_advice
    from gibench.commands.cluster import cluster

    with cluster(scheduler, scheduler_file, workers) as executor:
        result = give_advice(
            device_profile=device_profile,
            budget_ms=budget_ms,
            gi_budget_ms=gi_budget_ms,
            budget=budget,
            scene=scene,
            technique=technique,
            variant=variant,
            sh_order=sh_order,
            probes=probes,
            receivers=receivers,
            settings=settings,
            light_frame=light_frame,
            target_error=target_error,
            reference_paths=reference_paths,
            frames=frames,
            resolution=resolution,
            camera=camera,
            project=project,
            shard=shard,
            out=out,
            seed=seed,
            device=device,
            cache_dir=cache_dir,
            executor=executor,
        )
    if shard is not None:
        if not quiet:
            typer.echo(
                f"{len(result.table)} rows of shard {shard}; see {printable(str(result.folder))}"
            )
    elif not quiet:
        from gibench.report.advice import show_advice

        show_advice(result.table, result.lifted, result.profile, result.limits, result.cpu)
        if result.projected is not None:
            from gibench.report.projected_terminal import show_ranking

            show_ranking(result.projected)
        typer.echo(f"see {printable(str(result.folder))}")
    if result.error is not None:
        raise result.error
