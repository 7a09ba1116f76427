"""``gibench quality``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gibench.cli import flight, motion, options
from gibench.errors import BadInput, CheckFailed, Interrupted

if TYPE_CHECKING:
    from gibench.study.quality import Outcome

_DEFAULT_TECHNIQUES = ["srp"]


def quality(
    device_profile: options.Profiles = ["iphone7"],  # noqa: B006 (typer copies its defaults)
    scene: options.Scenes = ["cornell-box"],  # noqa: B006
    technique: options.Techniques = _DEFAULT_TECHNIQUES,
    variant: options.Variants = ["tuned"],  # noqa: B006
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
    resolution: options.Resolution = "1334x750",
    camera: options.CameraChoice = None,
    camera_path: flight.CameraPathChoice = "rest",
    rest_frames: flight.RestFrames = 60,
    flight_frames: flight.FlightFrames = 240,
    moving: motion.RestOnly = "rest",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder for receivers.npz, quality.csv, quality.md and images; by default "
            "results/quality/<UTC time>-<profile>.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    seed: options.Seed = 0,
    device: options.DeviceNumber = None,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Compare techniques with the path-traced truth at the same receivers.

    Lights stand still and every technique runs until its indirect light does. Errors carry the
    reference's own uncertainty: a difference below it is called none.

    Examples:

      gibench quality --technique srp --sh-order 2 --sh-order 7

      gibench quality -t srp -t gibs -t ddgi --scene hall --receivers 20000 --target-error 0.05

      gibench quality -t gibs --camera-path flight --frames 1024

      gibench quality --scene blue-orange-box --region shadow=0.3,0.5,0.4,0.7
    """
    from gibench.device.device import select_cl_device
    from gibench.measure.machine.environment import cpu_name
    from gibench.measure.plan.configuration import grid
    from gibench.measure.runfolder.folder import RunFolder, default_folder
    from gibench.measure.runfolder.record import study_record
    from gibench.measure.session.setup import LoopOptions
    from gibench.report.quality import quality_report, quality_table, show_quality
    from gibench.report.tables import csv_text
    from gibench.study.frozen import FrozenShared
    from gibench.study.pictures import write_pictures
    from gibench.study.quality import COLUMNS, Group, QualityOptions, check_views, compare
    from gibench.study.receivers_file import NAME, write_receivers
    from gibench.study.settle import SettleOptions

    width, height = options.resolution(resolution)
    profiles = options.load_profiles(device_profile)
    specs = options.find_techniques(technique)
    asked = options.request(scene, variant, sh_order, probes, receivers, workgroup_size, settings)
    configurations = grid(profiles, specs, asked)
    flown = flight.flight(camera_path, rest_frames, flight_frames)
    if frames <= flown.frames:
        raise BadInput(
            f"{frames} frames end before the camera is back from its flight of {flown.frames}",
            where="--frames",
            mend="give more, for light to settle after it",
        )
    cl_device = select_cl_device(device)
    shared = FrozenShared(options.cache_folder(cache_dir), seed, light_frame=light_frame)
    several = len({(c.scene, c.receivers) for c in configurations}) > 1
    if reference is not None and several:
        raise BadInput(
            "--reference is of one scene and one number of receivers, and several are asked for"
        )
    how = QualityOptions(
        loop=LoopOptions(
            width=width,
            height=height,
            camera=camera,
            seed=seed,
            flight=flown,
            motion=motion.motion(moving),
        ),
        settle=SettleOptions(frames),
        bounces=bounces,
        target_error=target_error,
        regions=tuple(region or ()),
        reference=reference,
        reference_seed=reference_seed,
        reference_paths=reference_paths,
    )
    check_views(configurations, how, shared)
    arguments = options.recorded(
        *(locals(), "light_frame", "bounces", "target_error", "reference_seed"),
        *("reference_paths", "region"),
    )
    arguments["reference"] = reference and reference.name
    path = out or Path(
        *("results", "quality", default_folder([p.name for p in profiles]).name),
    )
    folder = RunFolder.create(path, arguments)
    folder.write_record(study_record(arguments, cl_device))

    def take(group: Group, name: str) -> None:
        beneath = folder.path / group.name if several else folder.path
        truth = group.truth
        write_receivers(
            beneath / NAME, group.lightmap, truth.value, truth.stderr, group.results, group.about
        )
        write_pictures(beneath / "images", truth, name, group.results[name])

    outcome = compare(configurations, how, shared, cl_device, take)
    if outcome.rows:
        table = quality_table(outcome.rows, COLUMNS)
        scenes = [shared.scene(name) for name in dict.fromkeys(scene)]
        warnings = {found.name: found.warnings for found in scenes}
        folder.write_text("quality.csv", csv_text(table))
        folder.write_text("quality.md", quality_report(table, cpu_name(), warnings))
        if not quiet:
            show_quality(table, cpu_name())
            typer.echo(f"see {folder.path}")
    _conclude(outcome, folder.path)


def _conclude(outcome: Outcome, folder: Path) -> None:
    """Raise the error, if any, that decides the exit code.

    Raises:
        Interrupted: by Ctrl-C; says what was kept.
        GibenchError: nothing could be compared (the first reason), or something failed.
    """
    done = sum(row["status"] == "ok" for row in outcome.rows)
    if outcome.interrupted:
        raise Interrupted(f"interrupted; {done} rows are kept in {folder}")
    if not done and outcome.first_error is not None:
        raise outcome.first_error
    failed = [row for row in outcome.rows if row["status"] == "failed"]
    if failed:
        raise CheckFailed(
            f"{len(failed)} configurations failed, the first because {failed[0]['reason']}",
            mend=f"what was compared is in {folder}",
        )
