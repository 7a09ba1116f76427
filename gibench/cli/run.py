"""``gibench run``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import flight, motion, options
from gibench.errors import printable

_NONE: list[str] = []


def run(
    device_profile: options.Profiles = ["iphone7"],  # noqa: B006 (typer copies its defaults)
    scene: options.Scenes = ["cornell-box"],  # noqa: B006
    technique: options.TechniquesOrAll = None,
    variant: options.Variants = ["tuned"],  # noqa: B006
    layout: options.Layouts = None,
    sh_order: options.ShOrders = None,
    probes: options.Probes = None,
    receivers: options.ReceiverCounts = None,
    workgroup_size: options.WorkgroupSizesOrAuto = None,
    settings: options.Set = None,
    frames: Annotated[
        int | None,
        typer.Option(
            "--frames",
            "-n",
            min=1,
            metavar="N",
            help="Frames measured per configuration, exactly; by default 30 to 500, until the "
            "median frame time is known to 5 % or 30 seconds are over.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    warmup: Annotated[
        int | None,
        typer.Option(
            "--warmup",
            min=0,
            metavar="N",
            help="Frames run first and not recorded, exactly; by default until the technique is at "
            "rest and times have settled.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    warmup_frames: options.WarmupFrames = 1000,
    warmup_seconds: options.WarmupSecondsOrAuto = None,
    cold: Annotated[
        bool,
        typer.Option(
            "--cold",
            help="Empty the caches before every frame, as the rest of an application would.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
    resolution: options.Resolution = "1334x750",
    camera: options.CameraChoice = None,
    camera_path: flight.CameraPathChoice = "rest",
    rest_frames: flight.RestFrames = 60,
    flight_frames: flight.FlightFrames = 240,
    moving: motion.MotionChoice = "rest",
    fit: Annotated[
        bool,
        typer.Option(
            "--fit",
            help="Lower the receiver count until a configuration fits the profile's memory; every "
            "table says so.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
    save_images: Annotated[
        bool,
        typer.Option(
            "--save-images",
            help="Write every configuration's last frame as PNG beneath OUT/images.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
    project: Annotated[
        list[str],
        typer.Option(
            "--project",
            metavar="NAME|FILE",
            help="Also project the times onto a device that is not here, as ranges: trace a frame "
            "of every configuration. Repeat it for several; needs the extra 'project'.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = _NONE,
    quality: Annotated[
        bool,
        typer.Option(
            "--quality/--no-quality",
            help="Compare each technique's settled light, lights as in frame 0, with a quick "
            "path-traced truth (5 %, cached).",
            rich_help_panel=options.OUTPUT,
        ),
    ] = True,
    settle_seconds: Annotated[
        float,
        typer.Option(
            "--settle-seconds",
            min=0,
            metavar="S",
            help="Seconds of frames at most that a technique may take to settle for that. What it "
            "settles on is cached, and profiles share it.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = 90.0,
    budget_ms: Annotated[
        float,
        typer.Option("--budget-ms", metavar="MS", help="What a frame may take."),
    ] = 33.3,
    gi_budget_ms: Annotated[
        float,
        typer.Option(
            "--gi-budget-ms", metavar="MS", help="What of it global illumination may take."
        ),
    ] = 3.0,
    shard: options.Shard = None,
    out: Annotated[
        Path | None,
        options.out_folder("The run's folder; by default results/runs/<UTC time>-<profile>."),
    ] = None,
    scheduler: options.Scheduler = None,
    scheduler_file: options.SchedulerFile = None,
    workers: options.Workers = None,
    seed: options.Seed = 0,
    device: options.DeviceNumber = None,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Run techniques frame by frame and leave a folder of samples, tables and a report.

    What a technique needs ahead of frames is baked first and cached, so the second run of the same
    scene starts at once. Times are in milliseconds on the machine at hand; the profile binds
    work-group sizes, local memory and buffer memory, and does not slow anything down.

    Examples:

      gibench run --device-profile iphone7

      gibench run --scene sponza.obj --sh-order 2 --sh-order 7 --frames 100

      gibench run --variant published --variant tuned --workgroup-size 64 --workgroup-size 256

      gibench run --device-profile iphone7 --scene hall --receivers 200000 --fit --save-images

      gibench run --technique gibs --technique ddgi --camera-path flight

      gibench run --technique gibs --scene hall --motion scene

      gibench run --device-profile iphone7 --project iphone7 --project titan-x-pascal
    """
    from gibench.commands.cluster import cluster
    from gibench.commands.run import run as measure

    with cluster(scheduler, scheduler_file, workers) as executor:
        result = measure(
            device_profile=device_profile,
            scene=scene,
            technique=technique,
            variant=variant,
            layout=layout,
            sh_order=sh_order,
            probes=probes,
            receivers=receivers,
            workgroup_size=workgroup_size,
            settings=settings,
            frames=frames,
            warmup=warmup,
            warmup_frames=warmup_frames,
            warmup_seconds=warmup_seconds,
            cold=cold,
            resolution=resolution,
            camera=camera,
            camera_path=camera_path,
            rest_frames=rest_frames,
            flight_frames=flight_frames,
            motion=moving,
            fit=fit,
            save_images=save_images,
            project=project,
            quality=quality,
            settle_seconds=settle_seconds,
            budget_ms=budget_ms,
            gi_budget_ms=gi_budget_ms,
            shard=shard,
            out=out,
            seed=seed,
            device=device,
            cache_dir=cache_dir,
            executor=executor,
        )
    if not quiet and len(result.samples):
        from gibench.report.terminal import show_answers, show_run

        show_run(result.passes, result.frames, result.record)
        if result.projected is not None:
            from gibench.report.projected_terminal import show_projection, show_ratios

            show_projection(result.projected)
        if result.ratios is not None:
            show_ratios(result.ratios)
        show_answers(result.answers)
        for line in result.left_out:
            typer.echo(line)
        typer.echo(
            f"{result.ran} of {len(result.frames)} configurations ran; "
            f"see {printable(str(result.folder))}"
        )
    if result.error is not None:
        raise result.error
