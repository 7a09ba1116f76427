"""``gibench run``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gibench.cli import flight, motion, options
from gibench.errors import CannotRun, CheckFailed, GibenchError, Interrupted

if TYPE_CHECKING:
    from gibench.measure.session.loop import Outcome


_DEFAULT_TECHNIQUES = ["srp", "direct"]


def run(
    device_profile: options.Profiles = ["iphone7"],  # noqa: B006 (typer copies its defaults)
    scene: options.Scenes = ["cornell-box"],  # noqa: B006
    technique: options.Techniques = _DEFAULT_TECHNIQUES,
    variant: options.Variants = ["tuned"],  # noqa: B006
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
            help="Frames run first and not recorded, exactly; by default until times have settled.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
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
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="The run's folder; by default results/runs/<UTC time>-<profile>.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
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
    """
    from dataclasses import replace

    from gibench.device.device import select_cl_device
    from gibench.measure.machine.roofs import measure_roofs
    from gibench.measure.plan.configuration import grid
    from gibench.measure.plan.stopping import Plan
    from gibench.measure.runfolder.folder import RunFolder, default_folder
    from gibench.measure.runfolder.record import begin_record, finish_record
    from gibench.measure.session.cold import CacheFlush
    from gibench.measure.session.interrupts import Interrupts
    from gibench.measure.session.loop import run_configurations
    from gibench.measure.session.setup import LoopOptions, check_configuration
    from gibench.measure.session.shared import Shared

    # All inputs are checked before any long work.
    width, height = options.resolution(resolution)
    profiles = options.load_profiles(device_profile)
    specs = options.find_techniques(technique)
    sizes, auto = options.workgroup_sizes(workgroup_size)
    asked = options.request(scene, variant, sh_order, probes, receivers, sizes, settings)
    asked = replace(asked, auto_workgroup=auto)
    configurations = grid(profiles, specs, asked)
    cache = options.cache_folder(cache_dir)
    cl_device = select_cl_device(device)
    flown = flight.flight(camera_path, rest_frames, flight_frames)
    plan = Plan(frames=frames or flown.frames or None, warmup=warmup)
    moved = motion.motion(moving)
    loop = LoopOptions(plan, width, height, camera, fit, seed, flown, moved)
    shared = Shared(cache, seed)
    for configuration in configurations:
        check_configuration(configuration, loop, shared)
    arguments = options.recorded(locals(), "warmup", "cold", "fit", "save_images")
    arguments["motion"] = Path(moving).name
    folder = RunFolder.create(out or default_folder([p.name for p in profiles]), arguments)

    flush = CacheFlush(profiles[0], cl_device) if cold else None
    roofs = measure_roofs(profiles[0], cl_device)
    record = begin_record(
        arguments, profiles, loop, cl_device, roofs, flush.facts if flush else None
    )
    folder.write_record(record)
    writer = _image_writer(folder.path) if save_images else None
    outcome = run_configurations(configurations, loop, shared, cl_device, folder, writer, flush)
    after = None
    with Interrupts() as interrupts:
        try:
            with interrupts.work():
                after = None if outcome.ended else measure_roofs(profiles[0], cl_device)
        except KeyboardInterrupt:
            outcome.interrupted = True
        record = finish_record(record, outcome, shared, after)
        _write_what_is_known(folder, record, outcome, show=not quiet and outcome.samples > 0)
        outcome.interrupted |= interrupts.came()
    if not quiet and outcome.samples:
        ran = sum(result.frames > 0 for result in outcome.results)
        typer.echo(f"{ran} of {len(outcome.results)} configurations ran; see {folder.path}")
    _conclude(outcome, folder.path)


def _write_what_is_known(
    folder: Any, record: dict[str, Any], outcome: Outcome, *, show: bool
) -> None:
    """Write the record and the tables; where the disk refuses, the outcome says so."""
    try:
        folder.write_record(record)
        write_tables(folder, record, show=show)
    except GibenchError as error:
        outcome.write_error = outcome.write_error or error


def write_tables(folder: Any, record: dict[str, Any], *, show: bool) -> None:
    """Write the tables and the report of a run from its stored samples; show them too."""
    import pandas as pd

    from gibench.measure.runfolder.folder import SAMPLES
    from gibench.report.markdown import report
    from gibench.report.roofline import write_roofline
    from gibench.report.tables import csv_text, frames_table, passes_table
    from gibench.report.terminal import show_run

    samples = pd.read_csv(folder.path / SAMPLES)
    passes, frames = passes_table(samples, record), frames_table(samples, record)
    folder.write_text("passes.csv", csv_text(passes))
    folder.write_text("frames.csv", csv_text(frames))
    write_roofline(folder.path, passes, record)
    folder.write_text("report.md", report(passes, frames, record))
    if show:
        show_run(passes, frames, record)


def _image_writer(folder: Path) -> Any:
    from gibench.measure.runfolder.results import ConfigurationResult
    from gibench.report.images import ImageWriter

    writer = ImageWriter(folder / "images")

    def take(result: ConfigurationResult, images: dict[str, Any]) -> None:
        configuration = result.configuration
        label = f"{configuration.number:02d}-{configuration.label(result.scene)}"
        writer.write(result.scene, label, images)

    return take


def _conclude(outcome: Outcome, folder: Path) -> None:
    """Raise the error, if any, that decides the exit code.

    Raises:
        Interrupted: by Ctrl-C; says what was kept.
        GibenchError: nothing could run (the first reason), or something failed.
    """
    if outcome.interrupted:
        raise Interrupted(f"interrupted; {outcome.samples:,} samples are kept in {folder}")
    if outcome.write_error is not None:
        kept = f"{outcome.samples:,} samples are kept in {folder}"
        raise GibenchError(f"{outcome.write_error.what}; {kept}", where=outcome.write_error.where)
    first = outcome.first_error
    if outcome.samples == 0 and first is not None:
        raise first
    if outcome.samples == 0:
        raise CannotRun("no pass of any configuration ran", mend=f"see {folder / 'report.md'}")
    failed = [result for result in outcome.results if result.status == "failed"]
    if failed:
        raise CheckFailed(
            f"{len(failed)} of {len(outcome.results)} configurations failed, the first because "
            f"{failed[0].reason}",
            mend=f"what was measured is in {folder}",
        )
