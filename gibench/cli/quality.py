"""``gibench quality``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import flight, motion, options
from gibench.errors import printable

_DEFAULT_TECHNIQUES = ["srp"]


def quality(
    device_profile: options.Profiles = ["iphone7"],  # noqa: B006 (typer copies its defaults)
    scene: options.Scenes = ["cornell-box"],  # noqa: B006
    technique: options.Techniques = _DEFAULT_TECHNIQUES,
    variant: options.Variants = ["tuned"],  # noqa: B006
    layout: options.Layouts = None,
    sh_order: options.ShOrders = None,
    probes: options.Probes = None,
    receivers: options.ReceiverCounts = None,
    workgroup_size: options.WorkgroupSizes = None,
    settings: options.Set = None,
    light_frame: options.LightFrame = 0,
    bounces: Annotated[
        int | None,
        typer.Option(
            "--bounces",
            min=0,
            metavar="N",
            help="Bounces of the reference; by default any number. With 1, compare techniques set "
            "to one bounce (srp.bounces=false).",
            rich_help_panel=options.TRUTH,
        ),
    ] = None,
    target_error: options.TargetError = 0.02,
    reference: Annotated[
        Path | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help="Take the reference of an earlier receivers.npz of the same scene, light and "
            "receivers.",
            rich_help_panel=options.TRUTH,
        ),
    ] = None,
    reference_seed: Annotated[
        int,
        typer.Option(
            "--reference-seed",
            min=0,
            metavar="N",
            help="Of the path tracer: two agree within their errors.",
            rich_help_panel=options.TRUTH,
        ),
    ] = 1,
    reference_paths: options.ReferencePaths = None,
    region: Annotated[
        list[str] | None,
        typer.Option(
            "--region",
            metavar="NAME=BOX|FILE",
            help="Tell a part of the image apart: name=left,top,right,bottom in shares of the "
            "image, or name=mask.png of its size; besides the scene's own.",
            rich_help_panel=options.TRUTH,
        ),
    ] = None,
    frames: options.SettleFrames = 512,
    faults: Annotated[
        bool,
        typer.Option(
            "--faults/--no-faults",
            help="Run further frames of what has settled, for flicker and for how long a light "
            "that is switched and an object that is moved take; leaks, blotches and what is "
            "missing are told all the same.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = True,
    resolution: options.Resolution = "1334x750",
    camera: options.CameraChoice = None,
    camera_path: flight.CameraPathChoice = "rest",
    rest_frames: flight.RestFrames = 60,
    flight_frames: flight.FlightFrames = 240,
    moving: motion.MotionChoice = "rest",
    out: Annotated[
        Path | None,
        options.out_folder(
            "Folder for receivers.npz, quality.csv, quality.md and images; by default "
            "results/quality/<UTC time>-<profile>."
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
    """Compare techniques with the path-traced truth at the same receivers.

    Lights and objects stand still where they are in --light-frame, and every technique runs until
    its indirect light stands still, too. Errors carry the reference's own uncertainty: a difference
    below it is called none.

    Examples:

      gibench quality --technique srp --sh-order 2 --sh-order 7

      gibench quality -t srp -t gibs -t ddgi --scene hall --receivers 20000 --target-error 0.05

      gibench quality -t gibs --camera-path flight --frames 1024

      gibench quality -t ddgi -t gibs --scene two-rooms --no-faults

      gibench quality -t ddgi --scene hall --motion scene --light-frame 60

      gibench quality --scene blue-orange-box --region shadow=0.3,0.5,0.4,0.7
    """
    from gibench.commands.cluster import cluster
    from gibench.commands.quality import quality as compare

    with cluster(scheduler, scheduler_file, workers) as executor:
        result = compare(
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
            light_frame=light_frame,
            bounces=bounces,
            target_error=target_error,
            reference=reference,
            reference_seed=reference_seed,
            reference_paths=reference_paths,
            region=region,
            frames=frames,
            faults=faults,
            resolution=resolution,
            camera=camera,
            camera_path=camera_path,
            rest_frames=rest_frames,
            flight_frames=flight_frames,
            motion=moving,
            out=out,
            seed=seed,
            device=device,
            cache_dir=cache_dir,
            executor=executor,
        )
    if not quiet and len(result.table):
        from gibench.measure.machine.environment import cpu_name
        from gibench.report.quality import show_quality

        show_quality(result.table, cpu_name())
        typer.echo(f"see {printable(str(result.folder))}")
    if result.error is not None:
        raise result.error
