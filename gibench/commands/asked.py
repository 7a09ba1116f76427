"""Reading what a command is asked: its options, as typed or as Python gives them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from gibench.errors import BadInput, printable
from gibench.measure.plan.grid import grid
from gibench.measure.runfolder.folder import RunFolder, default_folder
from gibench.measure.session.shared import Shared
from gibench.profiles import DeviceProfile, load_profile
from gibench.scene.load import is_file
from gibench.scene.motion.file import load_motions
from gibench.techniques.camera_path import FlightOptions
from gibench.techniques.job import AUTO, Job, Shot
from gibench.techniques.object_motion import REST, SCENE, MotionOptions
from gibench.techniques.registry import TechniqueSpec, find_technique

MAX_IMAGE_PIXELS = 16384
BY_OPTION = ("sh_order", "probes")
"""Settings that have an option of their own; ``--set`` reaches the others."""
_RECORDED = (
    "device_profile",
    "scene",
    "technique",
    "variant",
    "layout",
    "sh_order",
    "probes",
    "receivers",
    "workgroup_size",
    "settings",
    "frames",
    "resolution",
    "camera",
    "seed",
    "device",
    "camera_path",
    "rest_frames",
    "flight_frames",
)
_SHOT = ("resolution", "camera", "camera_path", "rest_frames", "flight_frames", "motion")

Texts = str | Sequence[str]
"""One name or several."""
Numbers = int | Sequence[int] | None
Sizes = int | str | Sequence[int | str] | None
SettingsAsked = Sequence[str] | Mapping[str, Any] | None
"""``technique.setting=value`` texts, or values by ``technique.setting``: one, or several for an
axis."""


def jobs_of(given: Mapping[str, Any]) -> list[Job]:
    """The grid of jobs that a command's options ask for.

    Args:
        given: the command's options by name; of those of the image and the camera the ones it has.

    Raises:
        BadInput: one of them is wrong, or nothing is asked for.
        CannotRun: no work-group size asked suits any profile asked.
    """
    jobs = grid(
        load_profiles(several(given["device_profile"])),
        find_techniques(several(given["technique"])),
        scenes=several(given["scene"]),
        variants=several(given["variant"]),
        layouts=several(given.get("layout")),
        common=by_option(given["sh_order"], given["probes"]),
        settings=read_settings(given["settings"]),
        receivers=several(given["receivers"]),
        workgroup_sizes=workgroup_sizes(given["workgroup_size"]),
        shot=shot_of(**{name: given[name] for name in _SHOT if name in given}),
        seed=given["seed"],
    )
    if not jobs:
        raise BadInput("nothing is asked for", mend="name a device profile, scene and technique")
    return jobs


def several(value: Any) -> tuple[Any, ...]:
    """One value, several or none as a tuple."""
    if value is None:
        return ()
    if isinstance(value, str | Path) or not isinstance(value, Iterable):
        return (value,)
    return tuple(value)


def by_option(sh_order: Numbers, probes: Numbers) -> dict[str, tuple[int, ...]]:
    """Values of the settings that have an option of their own.

    Raises:
        BadInput: a number of probes is below 1; what else is out of range, a technique says.
    """
    orders, counts = several(sh_order), several(probes)
    for count in counts:
        if count < 1:
            raise BadInput(f"--probes {count} is out of range", mend="give 1 or more")
    return dict(zip(BY_OPTION, (orders, counts), strict=True))


def cache_folder(given: str | Path | None) -> Path:
    """The bake cache, made and found writable.

    Raises:
        BadInput: it cannot be written.
    """
    from platformdirs import user_cache_dir

    path = Path(user_cache_dir("gibench")) if given is None else Path(given)
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


def folder_for(
    out: str | Path | None, kind: str, profiles: Sequence[str], arguments: Mapping[str, Any]
) -> RunFolder:
    """The folder that a command leaves: ``out``, or a new one beneath ``results/<kind>``.

    Raises:
        BadInput: it cannot be written, or holds something else.
    """
    return RunFolder.create(Path(out) if out else default_folder(profiles, kind), arguments)


def load_profiles(names: Sequence[str]) -> list[DeviceProfile]:
    """The profiles, each once.

    Raises:
        BadInput: one is unknown or unsound, or two different ones carry the same name.
    """
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
    return [find_technique(name) for name in dict.fromkeys(names)]


def workgroup_sizes(asked: Sizes) -> tuple[int | Literal["auto"], ...]:
    """The sizes asked for, ``auto`` among them.

    Raises:
        BadInput: one is neither a whole number from 1 up nor ``auto``.
    """
    sizes: list[int | Literal["auto"]] = []
    for text in map(str, several(asked)):
        if text == AUTO:
            sizes.append(AUTO)
        elif re.fullmatch(r"\d+", text) and int(text) >= 1:
            sizes.append(int(text))
        else:
            raise BadInput(
                f"--workgroup-size '{text}' is out of range", mend="give 1 or more, or auto"
            )
    return tuple(sizes)


def shot_of(
    resolution: str | tuple[int, int],
    camera: str | int | None = None,
    camera_path: str = REST,
    rest_frames: int = 60,
    flight_frames: int = 240,
    motion: str = REST,
) -> Shot:
    """Image, camera, flight and motion.

    Raises:
        BadInput: one is wrong, or a file holds none.
    """
    width, height = image_size(resolution)
    flight = FlightOptions(camera_path, rest_frames, flight_frames)
    flight.check()
    if motion not in (REST, SCENE):
        load_motions(Path(motion))
    which = None if camera is None else str(camera)
    return Shot(width, height, which, flight, MotionOptions(motion))


def image_size(asked: str | tuple[int, int]) -> tuple[int, int]:
    """Width and height of ``WxH``, pixels.

    Raises:
        BadInput: it is not of that form, or out of range.
    """
    text = asked if isinstance(asked, str) else "x".join(map(str, asked))
    match = re.fullmatch(r"(\d+)x(\d+)", text.strip().lower())
    if match is None:
        raise BadInput(f"--resolution '{text}' is not WxH", mend="give for instance 1334x750")
    width, height = int(match[1]), int(match[2])
    if not (1 <= width <= MAX_IMAGE_PIXELS and 1 <= height <= MAX_IMAGE_PIXELS):
        raise BadInput(
            f"--resolution {text} is out of range", mend=f"give 1 to {MAX_IMAGE_PIXELS} each way"
        )
    return width, height


def read_settings(asked: SettingsAsked) -> dict[str, dict[str, tuple[Any, ...]]]:
    """Values by technique and setting; a setting given twice is an axis.

    Raises:
        BadInput: a text cannot be read, or the setting has an option of its own.
    """
    if isinstance(asked, Mapping):
        pairs = [(name, several(value)) for name, value in asked.items()]
        texts = {name: f"{name}={', '.join(map(str, values))}" for name, values in pairs}
    else:
        pairs, texts = [], {}
        for text in several(asked):
            name, _, value = (part.strip() for part in text.partition("="))
            pairs.append((name, (value,) if "=" in text else ()))
            texts[name] = text.strip()
    found: dict[str, dict[str, tuple[Any, ...]]] = {}
    for name, values in pairs:
        match = re.fullmatch(r"([\w-]+)\.(\w+)", name)
        if match is None or not values:
            raise BadInput(
                f"--set '{texts[name]}' is not technique.setting=value",
                mend="write for instance --set srp.storage=fp16",
            )
        technique, setting = match.groups()
        if setting in BY_OPTION:
            option = setting.replace("_", "-")
            raise BadInput(f"--set {texts[name]}", mend=f"use --{option} instead")
        mine = found.setdefault(technique, {})
        mine[setting] = (*mine.get(setting, ()), *values)
    return found


def recorded(given: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """What a command was asked for, for its record: of what runs and studies share all that it
    takes, and ``names``; files by base name, folders not at all.
    """
    arguments = {name: given[name] for name in _RECORDED if name in given}
    arguments |= {name: given[name] for name in names}
    arguments = {name: _listed(value) for name, value in arguments.items()}
    for name in {"device_profile", "scene", "camera_path"} & set(arguments):
        value = arguments[name]
        is_one = isinstance(value, str)
        names_only = [printable(Path(each).name) for each in ([value] if is_one else value)]
        arguments[name] = names_only[0] if is_one else names_only
    return arguments


def contents(scenes: Sequence[str], shared: Shared) -> dict[str, str]:
    """What is in the scene files among ``scenes``, SHA-256 by the name that the command gives each:
    files of one name are told apart by it, and a folder of results goes on with the same ones only.

    Raises:
        BadInput: one cannot be loaded.
    """
    loaded = (shared.scene(scene) for scene in scenes if is_file(scene))
    return {scene.name: scene.content_hash() for scene in loaded}


def _listed(value: Any) -> Any:
    """As JSON would give it back."""
    return list(value) if isinstance(value, tuple) else value


def percentage(text: str) -> float:
    """The share that ``5%`` (or ``5``) is.

    Raises:
        BadInput: it is no percentage above 0 and below 100.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*%?\s*", text)
    share = float(match[1]) / 100 if match else 0.0
    if not 0 < share < 1:
        raise BadInput(f"--threshold '{text}' is no percentage", mend="give for instance 5%")
    return share
