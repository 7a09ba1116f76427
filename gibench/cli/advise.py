"""``gibench advise``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options

_ALL: list[str] = []


def advise(
    device_profile: options.Profile = "iphone7",
    budget_ms: Annotated[
        float,
        typer.Option(
            "--budget-ms",
            metavar="MS",
            help="What a frame may take on this machine; 33.3 is 30 frames per second.",
            rich_help_panel=options.GRID,
        ),
    ] = 33.3,
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
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder for advice.csv, advice.md and the plot; by default "
            "results/advice/<UTC time>-<profile>. Settings that it holds already are not tried "
            "again, whatever the budget.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    seed: options.Seed = 0,
    device: options.DeviceNumber = None,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Try techniques and settings on a scene and say which fit a budget, and at what error.

    Tries what every technique declares (SH orders, probes, rays) at all, a half and a quarter of
    the scene's receivers; the options narrow that. Times are of this machine under the profile's
    limits, not of the modelled device.

    Example:

      gibench advise --device-profile iphone7 --budget-ms 33.3 --scene sponza.obj
    """
    from gibench.commands.advise import advise as give_advice

    result = give_advice(
        device_profile=device_profile,
        budget_ms=budget_ms,
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
    )
    if shard is not None:
        if not quiet:
            typer.echo(f"{len(result.table)} rows of shard {shard}; see {result.folder}")
    elif not quiet:
        from gibench.measure.machine.environment import cpu_name
        from gibench.report.advice import show_advice

        show_advice(result.table, result.profile, budget_ms, cpu_name())
        if result.projected is not None:
            from gibench.report.projection import show_ranking

            show_ranking(result.projected)
        typer.echo(f"see {result.folder}")
    if result.error is not None:
        raise result.error
