"""``gibench scenes``, ``techniques``, ``devices`` and ``profiles``: what there is, as tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import pandas as pd

from gibench.commands.asked import BY_OPTION
from gibench.device import list_devices as cl_devices
from gibench.errors import BadInput, GibenchError
from gibench.measure.machine.environment import device_record
from gibench.profiles import (
    MACHINE_FIGURES,
    DeviceProfile,
    built_in_profiles,
    load_profile,
    profile_text,
    read_profile,
)
from gibench.scene.builtin import build, names
from gibench.techniques.registry import TechniqueSpec, techniques


@dataclass(frozen=True)
class ShownProfile:
    """A profile and where its figures come from.

    Attributes:
        profile: as it is used.
        figures: a row for each limit and rate: ``figure``, ``value``, ``source``.
        machine: a row for each figure that times are projected from: ``figure``, ``low``,
            ``nominal``, ``high``, ``source``; None where it has no machine part.
        text: the TOML file as it is, to copy and change.
    """

    profile: DeviceProfile
    figures: pd.DataFrame = field(repr=False)
    machine: pd.DataFrame | None = field(repr=False)
    text: str = field(repr=False)


@dataclass(frozen=True)
class CheckedProfile:
    """What is wrong with a profile, and what its machine part says.

    Attributes:
        profile: None where it cannot be used.
        faults: all of them; none where it is sound.
        estimated: figures of the machine that are estimates.
        spread: of each figure of the machine how many times its highest value is its lowest.
    """

    profile: DeviceProfile | None
    faults: tuple[GibenchError, ...]
    estimated: tuple[str, ...] = ()
    spread: Mapping[str, float] = field(default_factory=dict)


def list_scenes() -> pd.DataFrame:
    """The built-in scenes, as ``gibench scenes`` lists them: ``name``, ``triangles``, ``probes``,
    ``receivers`` and ``lights`` (their numbers), ``cameras`` (their names).
    """
    scenes = [build(name) for name in names()]
    return pd.DataFrame(
        {
            "name": [scene.name for scene in scenes],
            "triangles": [len(scene.triangles) for scene in scenes],
            "probes": [scene.probes.count for scene in scenes],
            "receivers": [scene.receivers for scene in scenes],
            "lights": [len(scene.lights) for scene in scenes],
            "cameras": [[camera.name for camera in scene.cameras] for scene in scenes],
        }
    )


def list_techniques() -> pd.DataFrame:
    """The techniques' settings, as ``gibench techniques`` lists them: ``technique``, ``setting``,
    ``option`` of the command line, ``default``, ``unit``, ``help``. One without settings has a row
    with none.
    """
    columns = ["technique", "setting", "option", "default", "unit", "help"]
    rows = [row for spec in techniques().values() for row in _settings(spec)]
    return pd.DataFrame(rows, columns=columns)


def _settings(spec: TechniqueSpec) -> list[tuple[Any, ...]]:
    usual = spec.settings_type()
    rows: list[tuple[Any, ...]] = []
    for item in fields(spec.settings_type):
        by_option = item.name in BY_OPTION
        option = (
            f"--{item.name.replace('_', '-')}" if by_option else f"--set {spec.name}.{item.name}="
        )
        said = item.metadata
        told = str(said.get("unit", "")), str(said.get("help", ""))
        rows.append((spec.name, item.name, option, getattr(usual, item.name), *told))
    return rows or [(spec.name, None, None, None, None, None)]


def list_devices() -> pd.DataFrame:
    """The OpenCL devices, as ``gibench devices`` lists them: a row for each number that ``device``
    takes, with ``name``, ``platform``, ``driver`` and its limits (bytes, work-items).
    """
    records = [device_record(device) for device in cl_devices()]
    return pd.DataFrame(records).rename_axis("number").reset_index()


def list_profiles() -> pd.DataFrame:
    """The built-in device profiles, as ``gibench profiles`` lists them: ``name``, ``device``, and
    their limits (work-items, bytes).
    """
    found = [load_profile(name) for name in built_in_profiles()]
    limits = (
        *("max_workgroup_size", "simd_width", "local_memory_bytes", "memory_budget_bytes"),
        "max_buffer_bytes",
    )
    return pd.DataFrame(
        {
            "name": [one.name for one in found],
            "device": [one.title for one in found],
            **{limit: [getattr(one, limit) for one in found] for limit in limits},
        }
    )


def show_profile(name: str) -> ShownProfile:
    """A profile, every figure with its source, as ``gibench profiles show`` has it.

    Args:
        name: of a built-in one, or a TOML file's path.

    Raises:
        BadInput: there is no such profile, or it is unsound.
    """
    profile, machine = load_profile(name), None
    figures = [(key, each.value, each.source) for key, each in profile.figures.items()]
    if profile.machine is not None:
        known = ((key, getattr(profile.machine, key)) for key in MACHINE_FIGURES)
        rows = [(key, each.low, each.nominal, each.high, each.source) for key, each in known]
        machine = pd.DataFrame(rows, columns=["figure", "low", "nominal", "high", "source"])
    table = pd.DataFrame(figures, columns=["figure", "value", "source"])
    return ShownProfile(profile, table, machine, profile_text(name))


def check_profile(name: str) -> CheckedProfile:
    """What is wrong with a profile, as ``gibench profiles check`` tells it.

    Args:
        name: of a built-in one, or a TOML file's path.

    Raises:
        BadInput: there is no such profile.
    """
    profile, faults = read_profile(profile_text(name), where=name)
    if profile is None:
        return CheckedProfile(None, tuple(faults))
    if profile.machine is None:
        missing = BadInput(
            "has no machine part: limits hold, nothing can be projected",
            where=name,
            mend=f"add [machine] with {', '.join(MACHINE_FIGURES)}",
        )
        return CheckedProfile(profile, (missing,))
    known = {key: getattr(profile.machine, key) for key in MACHINE_FIGURES}
    estimated = tuple(key for key, each in known.items() if each.estimated)
    return CheckedProfile(profile, (), estimated, {key: e.spread for key, e in known.items()})
