"""``gibench ab``."""

from __future__ import annotations

from typing import Annotated

import typer

from gibench.cli import options
from gibench.cli.give_comparison import give_comparison


def ab(
    old: Annotated[str, typer.Argument(metavar="OLD", help="The baseline: a folder or revision.")],
    new: Annotated[str, typer.Argument(metavar="NEW", help="The one to judge, likewise.")] = ".",
    scene: Annotated[
        str, typer.Option("--scene", "-s", metavar="NAME|FILE", help="Scene to run.")
    ] = "cornell-box",
    technique: Annotated[
        str, typer.Option("--technique", "-t", metavar="NAME", help="Technique to run.")
    ] = "srp",
    variant: Annotated[
        str, typer.Option("--variant", metavar="published|tuned", help="The technique's variant.")
    ] = "tuned",
    layout: Annotated[
        str | None,
        typer.Option("--layout", metavar="wide|simt", help="As in 'gibench run'."),
    ] = None,
    device_profile: Annotated[
        str, typer.Option("--device-profile", "-d", metavar="NAME|FILE", help="Device to model.")
    ] = "iphone7",
    sh_order: Annotated[
        int | None, typer.Option("--sh-order", metavar="N", help="As in 'gibench run'.")
    ] = None,
    probes: Annotated[
        int | None, typer.Option("--probes", min=1, metavar="N", help="As in 'gibench run'.")
    ] = None,
    receivers: Annotated[
        int | None, typer.Option("--receivers", min=1, metavar="N", help="As in 'gibench run'.")
    ] = None,
    workgroup_size: Annotated[
        int | None,
        typer.Option("--workgroup-size", "-w", min=1, metavar="N", help="As in 'gibench run'."),
    ] = None,
    settings: options.Set = None,
    resolution: Annotated[
        str, typer.Option("--resolution", metavar="WxH", help="Camera image, pixels.")
    ] = "320x180",
    threshold: options.Threshold = "5%",
    replicates: Annotated[
        int | None,
        typer.Option(
            "--replicates",
            min=1,
            metavar="N",
            help="Pairs of processes, exactly; by default 9 to 24, until every row is decided or "
            "--seconds are over.",
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option("--seconds", min=1, metavar="S", help="Start no pair later than this.")
    ] = 100.0,
    frames: Annotated[
        int, typer.Option("--frames", "-n", min=1, metavar="N", help="Frames per process.")
    ] = 24,
    warmup_frames: options.WarmupFrames = 1000,
    warmup_seconds: options.WarmupSeconds = 30.0,
    seed: options.Seed = 0,
    cache_dir: options.CacheDir = None,
    markdown: options.MarkdownFile = None,
    json: options.JsonFile = None,
    quiet: options.Quiet = False,
) -> None:
    """Time one kernel tree against another and fail only if it is established to be slower.

    OLD and NEW are folders with kernels (or checkouts that hold a kernels_cl) or git revisions; NEW
    is the working folder by default. Pairs of fresh processes, one for each, take turns frame by
    frame, so that what a shared machine does to one it does to the other. Only the kernels differ:
    the Python code is this installation's.

    Exit code 1: the frame or a pass is slower beyond the threshold with 99 % confidence, or NEW
    does not run. 2: OLD is missing or does not run. A row that stays ambiguous does not fail.

    Examples:

      gibench ab main

      gibench ab HEAD~1 HEAD --technique srp --variant published --markdown comment.md
    """
    from gibench.commands import ab as command

    found = command.ab(
        old,
        new,
        scene=scene,
        technique=technique,
        variant=variant,
        layout=layout,
        device_profile=device_profile,
        sh_order=sh_order,
        probes=probes,
        receivers=receivers,
        workgroup_size=workgroup_size,
        settings=settings,
        resolution=resolution,
        threshold=threshold,
        replicates=replicates,
        seconds=seconds,
        frames=frames,
        warmup_frames=warmup_frames,
        warmup_seconds=warmup_seconds,
        seed=seed,
        cache_dir=cache_dir,
    )
    give_comparison(found, markdown, json, quiet=quiet)
