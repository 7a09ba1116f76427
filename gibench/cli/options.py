"""Options that several subcommands share, and the reading of those that need it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer

from gibench.cli.notices import errors_only

GRID, OUTPUT = "What to run (repeat an option to make a grid)", "How and where"
TRUTH = "The truth to compare with"
CLUSTER = "On a cluster (docs/cluster.md)"


def out_folder(text: str) -> Any:
    """The option of the folder that a command leaves.

    Args:
        text: its help.
    """
    return typer.Option("--out", "-o", metavar="DIR", help=text, rich_help_panel=OUTPUT)


_SCENE_HELP = "Built-in scene, mesh (.gltf, .glb, .obj) or scene file (.toml)."

Profiles = Annotated[
    list[str],
    typer.Option(
        "--device-profile",
        "-d",
        metavar="NAME|FILE",
        help="Device whose limits bind: iphone7, radeon560, vega56, or a TOML file.",
        rich_help_panel=GRID,
    ),
]
Profile = Annotated[
    str,
    typer.Option(
        "--device-profile",
        "-d",
        metavar="NAME|FILE",
        help="Device to model: its limits bind.",
        rich_help_panel=GRID,
    ),
]
ProjectedOn = Annotated[
    list[str],
    typer.Option(
        "--device-profile",
        "-d",
        metavar="NAME|FILE",
        help="Device to project onto; its profile has a machine part. Repeat it for several.",
        rich_help_panel=GRID,
    ),
]
Scenes = Annotated[
    list[str],
    typer.Option(
        "--scene",
        "-s",
        metavar="NAME|FILE",
        help=_SCENE_HELP,
        rich_help_panel=GRID,
    ),
]
Scene = Annotated[
    str,
    typer.Option(
        "--scene",
        "-s",
        metavar="NAME|FILE",
        help=_SCENE_HELP,
        rich_help_panel=GRID,
    ),
]
Techniques = Annotated[
    list[str],
    typer.Option(
        "--technique",
        "-t",
        metavar="NAME",
        help="Technique to run; 'gibench techniques' lists them and their settings.",
        rich_help_panel=GRID,
    ),
]
TechniquesOrAll = Annotated[
    list[str] | None,
    typer.Option(
        "--technique",
        "-t",
        metavar="NAME",
        help="Technique to run; by default every one that the scene and the profile allow. "
        "'gibench techniques' lists them and their settings.",
        rich_help_panel=GRID,
    ),
]
Variants = Annotated[
    list[str],
    typer.Option(
        "--variant",
        metavar="published|tuned",
        help="published: structured as the paper has it. tuned: the same result, "
        "as fast as we can make it.",
        rich_help_panel=GRID,
    ),
]
Layouts = Annotated[
    list[str] | None,
    typer.Option(
        "--layout",
        metavar="wide|simt",
        help="How tuned kernels are shaped, by default as the device prefers. wide: explicit "
        "vectors, as PoCL on a CPU wants; simt: neighbouring work-items on neighbouring "
        "addresses, as GPUs do.",
        rich_help_panel=GRID,
    ),
]
ShOrders = Annotated[
    list[int] | None,
    typer.Option(
        "--sh-order",
        metavar="N",
        help="Order of the probes' spherical harmonics. Higher keeps sharper light and costs time "
        "and memory by (order + 1)².",
        rich_help_panel=GRID,
    ),
]
Probes = Annotated[
    list[int] | None,
    typer.Option(
        "--probes",
        min=1,
        metavar="N",
        help="Probes to place; by default the scene's. More follow the light more closely and cost "
        "time in proportion.",
        rich_help_panel=GRID,
    ),
]
ReceiverCounts = Annotated[
    list[int] | None,
    typer.Option(
        "--receivers",
        min=1,
        metavar="N",
        help="Lightmap texels to aim for; by default the scene's. More sharpen the light and cost "
        "time and memory in proportion.",
        rich_help_panel=GRID,
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="TECHNIQUE.SETTING=VALUE",
        help="Any other setting of a technique, for instance srp.storage=fp16; given twice, both "
        "are run and every table has a column of it.",
        rich_help_panel=GRID,
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed",
        min=0,
        max=2**32 - 1,
        metavar="N",
        help="Seed of every random choice: same seed, same images.",
        rich_help_panel=OUTPUT,
    ),
]
CacheDir = Annotated[
    Path | None,
    typer.Option(
        "--cache-dir",
        metavar="DIR",
        help="Where baked data is kept between runs; by default the platform's cache folder.",
        rich_help_panel=OUTPUT,
    ),
]
WorkgroupSizes = Annotated[
    list[int] | None,
    typer.Option(
        "--workgroup-size",
        "-w",
        min=1,
        metavar="N",
        help="Work-items per group; by default the profile's. A pass that cannot run at one is "
        "skipped with its reason.",
        rich_help_panel=GRID,
    ),
]
WorkgroupSizesOrAuto = Annotated[
    list[str] | None,
    typer.Option(
        "--workgroup-size",
        "-w",
        metavar="N|auto",
        help="Work-items per group; by default the profile's. A pass that cannot run at one is "
        "skipped with its reason. auto: each pass at its best, by measurement, remembered "
        "in the cache folder.",
        rich_help_panel=GRID,
    ),
]
Resolution = Annotated[
    str,
    typer.Option(
        "--resolution",
        metavar="WxH",
        help="Camera image, pixels; by default the iPhone 7's screen.",
        rich_help_panel=OUTPUT,
    ),
]
CameraChoice = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="N|NAME",
        help="Which of the scene's cameras, counted from 0; by default its first.",
        rich_help_panel=OUTPUT,
    ),
]
DeviceNumber = Annotated[
    int | None,
    typer.Option(
        "--device",
        min=0,
        metavar="N",
        help="OpenCL device to execute on, as 'gibench devices' counts them.",
        rich_help_panel=OUTPUT,
    ),
]
LightFrame = Annotated[
    int,
    typer.Option(
        "--light-frame",
        min=0,
        metavar="N",
        help="Lights and what moves stand still where they are in this frame.",
        rich_help_panel=TRUTH,
    ),
]
TargetError = Annotated[
    float,
    typer.Option(
        "--target-error",
        metavar="SHARE",
        help="Path-trace until the mean standard error is this share of the mean irradiance; half "
        "of it costs four times the time.",
        rich_help_panel=TRUTH,
    ),
]
ReferencePaths = Annotated[
    int | None,
    typer.Option(
        "--reference-paths",
        metavar="N",
        help="Paths per receiver or pixel at most, whatever the target error; by default as many "
        "as it takes.",
        rich_help_panel=TRUTH,
    ),
]
SettleFrames = Annotated[
    int,
    typer.Option(
        "--frames",
        "-n",
        min=1,
        metavar="N",
        help="Frames a technique runs at most until its indirect light stands still.",
        rich_help_panel=OUTPUT,
    ),
]
WarmupFrames = Annotated[
    int,
    typer.Option(
        "--warmup-frames",
        min=0,
        metavar="N",
        help="Frames at most that warm-up waits for a technique to be at rest (filled, settled); 0 "
        "does not wait.",
        rich_help_panel=OUTPUT,
    ),
]
WarmupSeconds = Annotated[
    float,
    typer.Option(
        "--warmup-seconds",
        min=0,
        metavar="S",
        help="Seconds of frames at most that it waits.",
        rich_help_panel=OUTPUT,
    ),
]
WarmupSecondsOrAuto = Annotated[
    float | None,
    typer.Option(
        "--warmup-seconds",
        min=0,
        metavar="S",
        help="Seconds of frames at most that it waits; by default 180, and 20 where all techniques "
        "are run.",
        rich_help_panel=OUTPUT,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Compute on the workers of this Dask scheduler, for instance tcp://head:8786; needs "
        "the extra 'cluster'.",
        rich_help_panel=CLUSTER,
    ),
]
SchedulerFile = Annotated[
    Path | None,
    typer.Option(
        "--scheduler-file",
        metavar="FILE",
        help="The same, by the file that the scheduler wrote.",
        rich_help_panel=CLUSTER,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        metavar="N",
        help="Compute on so many worker processes of this machine.",
        rich_help_panel=CLUSTER,
    ),
]
Shard = Annotated[
    str | None,
    typer.Option(
        "--shard",
        metavar="I/N",
        help="Measure the I-th of N shares only, for instance one of a Slurm array; "
        "'gibench merge' joins them.",
        rich_help_panel=OUTPUT,
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=errors_only,
        help="Print errors only.",
        rich_help_panel=OUTPUT,
    ),
]
Threshold = Annotated[
    str,
    typer.Option(
        "--threshold", metavar="PERCENT", help="The least change that matters, for instance 5%."
    ),
]
MarkdownFile = Annotated[
    Path | None,
    typer.Option(
        "--markdown",
        metavar="FILE",
        help="Write a table for a pull request; - for standard output.",
    ),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", metavar="FILE", help="Write everything as JSON; - for standard output."),
]


def paragraphs(text: str | None) -> str:
    """Help text with each paragraph on one line, for the terminal to wrap."""
    blocks = re.split(r"\n\s*\n", (text or "").strip())
    return "\n\n".join(" ".join(block.split()) for block in blocks)
