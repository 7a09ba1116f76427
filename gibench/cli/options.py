"""Options that several subcommands share, and the reading of those that need it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gibench.cli.notices import errors_only
from gibench.errors import BadInput, printable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from gibench.measure.plan.configuration import Request
    from gibench.profiles import DeviceProfile
    from gibench.techniques.registry import TechniqueSpec

GRID, OUTPUT = "What to run (repeat an option to make a grid)", "How and where"
TRUTH = "The truth to compare with"
MAX_IMAGE_PIXELS = 16384
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
ShOrders = Annotated[
    list[int] | None,
    typer.Option(
        "--sh-order",
        metavar="0-7",
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
        help="Any other setting of a technique, for instance srp.storage=fp16.",
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
        help="The lights stand still where they are in this frame.",
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


def paragraphs(text: str | None) -> str:
    """Help text with each paragraph on one line, for the terminal to wrap."""
    blocks = re.split(r"\n\s*\n", (text or "").strip())
    return "\n\n".join(" ".join(block.split()) for block in blocks)


def cache_folder(given: Path | None) -> Path:
    """The bake cache, made and found writable.

    Raises:
        BadInput: it cannot be written.
    """
    from platformdirs import user_cache_dir

    path = Path(user_cache_dir("gibench")) if given is None else given
    try:
        path.mkdir(parents=True, exist_ok=True)
        (path / ".writable").touch()
    except OSError as error:
        raise BadInput(
            f"the cache folder cannot be written ({error.strerror or error})",
            where=path,
            mend="give another folder with --cache-dir",
        ) from error
    return path


def load_profiles(names: Sequence[str]) -> list[DeviceProfile]:
    """The profiles, each once.

    Raises:
        BadInput: one is unknown or unsound, or two different ones carry the same name.
    """
    from gibench.profiles import load_profile

    found: dict[str, DeviceProfile] = {}
    for name in names:
        profile = load_profile(name)
        other = found.setdefault(profile.name, profile)
        if other.content_hash != profile.content_hash:
            raise BadInput(
                f"another profile of this run is called '{profile.name}' too",
                where=name,
                mend="give it a name of its own",
            )
    return list(found.values())


def find_techniques(names: Sequence[str]) -> list[TechniqueSpec]:
    """The techniques, each once.

    Raises:
        BadInput: there is no such technique.
    """
    from gibench.techniques.registry import find_technique

    return [find_technique(name) for name in dict.fromkeys(names)]


def request(
    scenes: Sequence[str],
    variants: Sequence[str],
    sh_orders: Sequence[int] | None,
    probes: Sequence[int] | None,
    receivers: Sequence[int] | None,
    workgroup_sizes: Sequence[int] | None,
    settings: Sequence[str] | None,
) -> Request:
    """The grid that the options ask for.

    Raises:
        BadInput: a ``--set`` cannot be read.
    """
    from gibench.measure.plan.configuration import Request

    return Request(
        scenes=tuple(scenes),
        variants=tuple(variants),
        sh_orders=tuple(sh_orders or ()),
        probes=tuple(probes or ()),
        receivers=tuple(receivers or ()),
        workgroup_sizes=tuple(workgroup_sizes or ()),
        settings=_settings(settings or ()),
    )


def workgroup_sizes(texts: Sequence[str] | None) -> tuple[list[int], bool]:
    """The sizes asked for, and whether ``auto`` is among them.

    Raises:
        BadInput: one is neither a whole number from 1 up nor ``auto``.
    """
    sizes = []
    for text in texts or ():
        if text != "auto":
            if not re.fullmatch(r"\d+", text) or int(text) < 1:
                raise BadInput(
                    f"--workgroup-size '{text}' is out of range", mend="give 1 or more, or auto"
                )
            sizes.append(int(text))
    return sizes, "auto" in (texts or ())


def resolution(text: str) -> tuple[int, int]:
    """Width and height of ``WxH``, pixels.

    Raises:
        BadInput: it is not of that form, or out of range.
    """
    match = re.fullmatch(r"(\d+)x(\d+)", text.strip().lower())
    if match is None:
        raise BadInput(f"--resolution '{text}' is not WxH", mend="give for instance 1334x750")
    width, height = int(match[1]), int(match[2])
    if not (1 <= width <= MAX_IMAGE_PIXELS and 1 <= height <= MAX_IMAGE_PIXELS):
        raise BadInput(
            f"--resolution {text} is out of range", mend=f"give 1 to {MAX_IMAGE_PIXELS} each way"
        )
    return width, height


def _settings(texts: Sequence[str]) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    for text in texts:
        match = re.fullmatch(r"\s*([\w-]+)\.(\w+)\s*=\s*(.*?)\s*", text)
        if match is None:
            raise BadInput(
                f"--set '{text}' is not technique.setting=value",
                mend="write for instance --set srp.storage=fp16",
            )
        found.setdefault(match[1], {})[match[2]] = match[3]
    return found


def recorded(given: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """What a command was asked for, for its record: of what runs and studies share all that it
    takes, and ``names``; files by base name, folders not at all.
    """
    shared = (
        *("device_profile", "scene", "technique", "variant", "sh_order", "probes", "receivers"),
        *("workgroup_size", "settings", "frames", "resolution", "camera", "seed", "device"),
        *("camera_path", "rest_frames", "flight_frames"),
    )
    arguments = {name: given[name] for name in shared if name in given}
    arguments |= {name: given[name] for name in names}
    for name in {"device_profile", "scene", "camera_path"} & set(arguments):
        value = arguments[name]
        is_one = isinstance(value, str)
        names_only = [printable(Path(each).name) for each in ([value] if is_one else value)]
        arguments[name] = names_only[0] if is_one else names_only
    return arguments
