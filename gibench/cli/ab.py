"""``gibench ab``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gibench.cli import comparing, options
from gibench.errors import BadInput, CheckFailed, GibenchError

if TYPE_CHECKING:
    from gibench.measure.compare.ab import AbResult
    from gibench.report.comparison import Row


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
    device_profile: Annotated[
        str, typer.Option("--device-profile", "-d", metavar="NAME|FILE", help="Device to model.")
    ] = "iphone7",
    sh_order: Annotated[
        int | None, typer.Option("--sh-order", metavar="0-7", help="As in 'gibench run'.")
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
    threshold: comparing.Threshold = "5%",
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
    seed: options.Seed = 0,
    cache_dir: options.CacheDir = None,
    markdown: comparing.MarkdownFile = None,
    json: comparing.JsonFile = None,
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
    import tempfile

    from gibench.commands import asked
    from gibench.device.device import list_devices
    from gibench.measure.compare.ab import AbOptions, bake_once, check
    from gibench.measure.compare.kernel_trees import kernel_tree
    from gibench.measure.compare.lockstep import SideFailed
    from gibench.measure.compare.paired import alarmed
    from gibench.measure.compare.replicate import Place
    from gibench.progress import progress
    from gibench.report import comparison

    limit = comparing.percentage(threshold)
    (job,) = asked.jobs_of(
        device_profile=device_profile,
        scene=scene,
        technique=technique,
        variant=variant,
        sh_order=sh_order,
        probes=probes,
        receivers=receivers,
        workgroup_size=workgroup_size,
        settings=settings,
        shot=asked.shot_of(resolution, None),
        seed=seed,
    )
    width, height = job.shot.width, job.shot.height
    cache = asked.cache_folder(cache_dir)
    list_devices()
    bake_once(job, cache)
    how = AbOptions(limit, replicates, seconds=seconds, frames=frames, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        first, second = (kernel_tree(name, Path(folder)) for name in (old, new))
        try:
            with progress(f"{old} against {new}", replicates or how.most) as advance:
                result = check(job, Place(str(cache)), first, second, how, advance)
        except SideFailed as error:
            if error.side == "OLD":
                raise BadInput(
                    f"the baseline does not run: {error}",
                    mend="nothing was compared; give a baseline that this gibench can run",
                ) from error
            raise GibenchError(f"{error}; nothing was compared") from error
    slower = alarmed(result.judged)
    title = f"gibench ab: {technique} ({variant}) on {Path(scene).name}, {width} x {height}"
    remarks = _remarks(result, limit)
    rows = _rows(result)
    facts = {
        "schema_version": 1,
        "kind": "ab",
        "old": {"name": result.old.name, "kernels": result.old.content_hash},
        "new": {"name": result.new.name, "kernels": result.new.content_hash},
        "threshold": limit,
        "slower": slower,
        "seconds": round(result.seconds, 1),
        "log_ratios": result.log_ratios,
        "output_difference": result.output_difference,
    }
    comparing.write_comparison(
        markdown, comparison.markdown(rows, title, remarks), json, comparison.as_json(rows, facts)
    )
    if not quiet and json != Path("-") and markdown != Path("-"):
        comparison.show(rows, title, remarks)
    if slower:
        raise CheckFailed(f"slower by more than {threshold}: {', '.join(slower)}")


def _rows(result: AbResult) -> list[Row]:
    from gibench.report.comparison import Row

    return [
        Row("", name, result.old_ms[name], result.new_ms[name], judged)
        for name, judged in result.judged.items()
    ]


def _remarks(result: AbResult, limit: float) -> list[str]:
    from gibench.measure.compare.paired import undecided

    pairs = max(len(values) for values in result.log_ratios.values())
    remarks = [
        f"{pairs} pairs of fresh processes in {result.seconds:.0f} s, frame by frame in turns; "
        f"threshold {100 * limit:.3g} %. frame: wall time; passes: device time. Old: "
        f"{result.old.name} ({result.old.content_hash[:12]}), new: {result.new.name} "
        f"({result.new.content_hash[:12]})."
    ]
    if (load := os.getloadavg()[0]) > 1.5 * (os.cpu_count() or 1):
        remarks.append(
            f"The machine is busy (load {load:.1f} on {os.cpu_count()} threads): intervals are "
            "wide and a slowdown may be missed."
        )
    if result.old.content_hash == result.new.content_hash:
        remarks.append("Old and new are the same kernels.")
    if rows := undecided(result.judged):
        remarks.append(
            f"Ambiguous: {', '.join(rows)}. More replicates may tell (--replicates "
            f"{2 * max(pairs, 12)})."
        )
    moved = {name: by for name, by in result.output_difference.items() if not by <= 1e-6}
    if moved:
        told = ", ".join(f"{name} by {by:.2g}" for name, by in moved.items())
        remarks.append(f"What they compute differs (relative root mean square): {told}.")
    return remarks
