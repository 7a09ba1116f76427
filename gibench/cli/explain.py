"""``gibench explain``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import flight, motion, options
from gibench.errors import printable

_NONE: list[str] = []


def explain(
    device_profile: options.Profile = "iphone7",
    scene: options.Scene = "cornell-box",
    technique: options.Techniques = ["srp"],  # noqa: B006 (typer copies its defaults)
    variant: options.Variants = ["tuned"],  # noqa: B006
    kernel: Annotated[
        list[str],
        typer.Option(
            "--kernel",
            metavar="FILE:NAME",
            help="Only this kernel: of a technique (srp/tuned_probes.cl:probe_update), or of your "
            "own OpenCL C file, whose arguments --arg gives.",
            rich_help_panel=options.GRID,
        ),
    ] = _NONE,
    arg: Annotated[
        list[str],
        typer.Option(
            "--arg",
            metavar="NAME=VALUE",
            help="Argument of your own kernel: a number; for a buffer or local memory its number "
            "of elements, or a .npy file.",
            rich_help_panel=options.GRID,
        ),
    ] = _NONE,
    define: Annotated[
        list[str],
        typer.Option(
            "--define",
            metavar="NAME=VALUE",
            help="Macro of your own kernel.",
            rich_help_panel=options.GRID,
        ),
    ] = _NONE,
    items: Annotated[
        str | None,
        typer.Option(
            "--items",
            metavar="N[xN[xN]]",
            help="Work-items of your own kernel; by default the elements of its largest buffer.",
            rich_help_panel=options.GRID,
        ),
    ] = None,
    group: Annotated[
        str | None,
        typer.Option(
            "--group",
            metavar="N[xN[xN]]",
            help="Work-group of your own kernel where it has several dimensions, instead of -w.",
            rich_help_panel=options.GRID,
        ),
    ] = None,
    project: Annotated[
        list[str],
        typer.Option(
            "--project",
            metavar="NAME|FILE",
            help="Also say as a range how long your own kernel would take on a device that is not "
            "here. Repeat it for several.",
            rich_help_panel=options.GRID,
        ),
    ] = _NONE,
    layout: options.Layouts = None,
    sh_order: options.ShOrders = None,
    probes: options.Probes = None,
    receivers: options.ReceiverCounts = None,
    workgroup_size: options.WorkgroupSizes = None,
    settings: options.Set = None,
    frame: Annotated[
        int | None,
        typer.Option(
            "--frame",
            min=0,
            metavar="N",
            help="The frame that is traced; those before it run as ever. By default the first that "
            "finds the technique at rest, the 33rd at least.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    resolution: options.Resolution = "1334x750",
    camera: options.CameraChoice = None,
    camera_path: flight.CameraPathChoice = "rest",
    rest_frames: flight.RestFrames = 0,
    flight_frames: flight.FlightFrames = 240,
    moving: motion.MotionChoice = "rest",
    out: Annotated[
        Path | None,
        options.out_folder(
            "Folder for explain.csv, explain.md and the plot; by default "
            "results/explain/<UTC time>-<profile>."
        ),
    ] = None,
    seed: options.Seed = 0,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Say what each pass does to a GPU's memory, and what stands in its way.

    Traces whole sampled work-groups of a frame's launches on PoCL and forms them into waves of 32
    and 64 lanes: cache lines touched over the fewest, lanes active, bank conflicts, bytes of DRAM
    behind caches, atomics on one address. Nothing is timed. Needs the extra 'project'.

    Examples:

      gibench explain -t srp -t ddgi --device-profile vega56

      gibench explain -t srp -s hall --motion scene

      gibench explain --kernel mine.cl:blur --arg image=1048576 --arg out=1048576 --arg width=1024

      gibench explain --kernel mine.cl:blur --define RADIUS=3 --items 1024x1024 --group 16x16
      --arg image=1048576 --arg out=1048576 --project titan-x-pascal
    """
    from gibench.commands.explain import explain as explained

    result = explained(
        device_profile=device_profile,
        scene=scene,
        technique=technique,
        variant=variant,
        layout=layout,
        kernel=kernel,
        arg=arg,
        define=define,
        items=items,
        group=group,
        project=project,
        sh_order=sh_order,
        probes=probes,
        receivers=receivers,
        workgroup_size=workgroup_size,
        settings=settings,
        frame=frame,
        resolution=resolution,
        camera=camera,
        camera_path=camera_path,
        rest_frames=rest_frames,
        flight_frames=flight_frames,
        motion=moving,
        out=out,
        seed=seed,
        cache_dir=cache_dir,
    )
    if not quiet:
        from gibench.report.explain import show_explanation

        show_explanation(result.table, result.profile)
        if result.projected is not None:
            from gibench.report.projected_terminal import show_projection, show_ratios

            show_projection(result.projected.table)
            show_ratios(result.projected.ratios)
        typer.echo(f"see {printable(str(result.folder))}")
    if result.error is not None:
        raise result.error
