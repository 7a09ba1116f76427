"""The DeviceProfile and its TOML file.

A profile is a file of figures. Each figure is a table with a ``value`` and a ``source`` (a
publication, a data sheet, or the word ``estimate``). Two kinds of figure: limits, which gibench
enforces on whatever device executes, and rates (bandwidth, FLOP/s), which describe the modelled
device and are only ever reported. A ``[machine]`` table may follow, from which times on the device
are projected (:mod:`gibench.profiles.machine`).
"""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib.resources import files
from pathlib import Path
from typing import Any

from gibench.errors import BadInput
from gibench.profiles.machine import Machine, read_machine

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Figure:
    """One figure of a profile: its value and where it comes from."""

    value: float
    source: str


@dataclass(frozen=True)
class DeviceProfile:
    """The limits of a device that is modelled.

    Attributes:
        name: short name, the one used on the command line.
        title: the device in words.
        simd_width: lanes that execute together; work-group sizes are multiples of it.
        max_workgroup_size: work-items in a work-group, at most.
        default_workgroup_size: what is used when the user names none.
        local_memory_bytes: local memory one work-group may use.
        memory_budget_bytes: what all buffers together may take.
        max_buffer_bytes: what one buffer may take.
        compute_units: number of compute units; reported only.
        fp32_gflop_per_s: peak single-precision rate; reported only.
        bandwidth_gb_per_s: peak DRAM bandwidth; reported only.
        dispatch_us: cost of one dispatch; reported only.
        figures: every figure above with its source, by field name.
        content_hash: SHA-256 of the file without its machine part, for the run record: no
            measurement depends on that part.
        machine: what times are projected from, None where the file has no such part.
        machine_hash: SHA-256 of the whole file.
    """

    name: str
    title: str
    simd_width: int
    max_workgroup_size: int
    default_workgroup_size: int
    local_memory_bytes: int
    memory_budget_bytes: int
    max_buffer_bytes: int
    compute_units: int
    fp32_gflop_per_s: float
    bandwidth_gb_per_s: float
    dispatch_us: float
    figures: Mapping[str, Figure]
    content_hash: str
    machine: Machine | None = None
    machine_hash: str = ""

    def workgroup_size_problem(self, size: int) -> str | None:
        """Why a work-group of ``size`` cannot run on this profile, or None when it can."""
        if size > self.max_workgroup_size:
            return (
                f"work-group size {size} is over the {self.max_workgroup_size} "
                f"of profile {self.name}"
            )
        if size < 1 or size % self.simd_width:
            return (
                f"work-group size {size} is no multiple of the SIMD width {self.simd_width} "
                f"of profile {self.name}"
            )
        return None


UNLIMITED = 1 << 62
"""More than any device has, bytes."""


def unlimited_profile() -> DeviceProfile:
    """The profile of whatever executes: the device's own limits alone; not for measurements."""
    return DeviceProfile(
        name="unlimited",
        title="The executing device, without limits",
        simd_width=1,
        max_workgroup_size=UNLIMITED,
        default_workgroup_size=1,
        local_memory_bytes=UNLIMITED,
        memory_budget_bytes=UNLIMITED,
        max_buffer_bytes=UNLIMITED,
        compute_units=1,
        fp32_gflop_per_s=0.0,
        bandwidth_gb_per_s=0.0,
        dispatch_us=0.0,
        figures={},
        content_hash="",
    )


_NOT_FIGURES = {"name", "title", "figures", "content_hash", "machine", "machine_hash"}
_FRACTIONAL = {"fp32_gflop_per_s", "bandwidth_gb_per_s", "dispatch_us"}
_FIGURE_NAMES = tuple(f.name for f in fields(DeviceProfile) if f.name not in _NOT_FIGURES)


def built_in_profiles() -> dict[str, str]:
    """The text of every built-in profile's file, by profile name."""
    folder = files("gibench.profiles")
    texts = {
        entry.name.removesuffix(".toml"): entry.read_text(encoding="utf-8")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    }
    return dict(sorted(texts.items()))


def load_profile(name_or_path: str) -> DeviceProfile:
    """Load a built-in profile by name or a user's own by path.

    Raises:
        BadInput: no such profile, or the file is not a sound profile.
    """
    return parse_profile(profile_text(name_or_path), where=name_or_path)


def profile_text(name_or_path: str) -> str:
    """The TOML text of a built-in profile by name or of a user's own by path, unchecked.

    Raises:
        BadInput: no such profile, or the file cannot be read as text.
    """
    built_in = built_in_profiles()
    if name_or_path in built_in:
        return built_in[name_or_path]
    path = Path(name_or_path)
    if not path.is_file():
        raise BadInput(
            f"no device profile called '{name_or_path}'",
            mend=f"use one of {', '.join(built_in)}, or the path of a TOML file like theirs "
            "(gibench profiles show iphone7 --toml)",
        )
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot be read as text ({error})", where=path) from error


_MACHINE = re.compile(
    r"\n\[[ \t]*machine[ \t]*\][ \t]*(?:#[^\n]*)?\n.*?(?=^\[(?![ \t]*machine\b)|\Z)",
    re.MULTILINE | re.DOTALL,
)


def _without_machine(text: str) -> str:
    """What the limits are told by: neither the machine part nor how lines end is in it."""
    return _MACHINE.sub("", text.replace("\r\n", "\n"))


def parse_profile(text: str, *, where: str) -> DeviceProfile:
    """Parse a profile's TOML text.

    Args:
        text: the file's content.
        where: the file's name, for messages.

    Raises:
        BadInput: bad TOML, a missing, unknown or senseless figure, or a figure without a source.
    """
    profile, faults = read_profile(text, where=where)
    if profile is None or faults:
        raise faults[0]
    return profile


def read_profile(text: str, *, where: str) -> tuple[DeviceProfile | None, list[BadInput]]:
    """Parse a profile's TOML text and tell everything that is wrong with it.

    Returns:
        The profile, None where anything is wrong; all that is wrong.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        return None, [BadInput(f"not valid TOML ({error})", where=where)]
    faults = _faults_of_names(table, where)
    figures: dict[str, Figure] = {}
    for name in _FIGURE_NAMES:
        try:
            figures[name] = _figure(table, name, where)
        except BadInput as error:
            faults.append(error)
    machine = None
    if "machine" in table:
        machine, wrong = read_machine(table["machine"], where)
        faults += wrong
    if faults:
        return None, faults
    values = {
        name: figure.value if name in _FRACTIONAL else int(figure.value)
        for name, figure in figures.items()
    }
    profile = DeviceProfile(
        name=table["name"],
        title=table["title"],
        figures=figures,
        content_hash=hashlib.sha256(_without_machine(text).encode()).hexdigest(),
        machine=machine,
        machine_hash=hashlib.sha256(text.encode()).hexdigest(),
        **values,  # type: ignore[arg-type]
    )
    faults = _faults_of_limits(profile, where)
    return (None, faults) if faults else (profile, [])


def _faults_of_names(table: Mapping[str, Any], where: str) -> list[BadInput]:
    """What is wrong with a profile's version, its names, and the names of its figures."""
    faults = []
    if table.get("schema_version") != SCHEMA_VERSION:
        faults.append(
            BadInput(
                f"schema_version is {table.get('schema_version')!r}",
                where=where,
                mend=f"this gibench reads schema_version = {SCHEMA_VERSION}",
            )
        )
    for key in ("name", "title"):
        if not isinstance(table.get(key), str) or not table[key].strip():
            faults.append(BadInput(f"'{key}' is missing", where=where, mend=f'add {key} = "..."'))
    known = {"schema_version", "name", "title", "machine", *_FIGURE_NAMES}
    faults += [
        BadInput(
            f"unknown figure '{name}'",
            where=where,
            mend=f"the figures are {', '.join(_FIGURE_NAMES)}",
        )
        for name in sorted(set(table) - known)
    ]
    return faults


def _faults_of_limits(profile: DeviceProfile, where: str) -> list[BadInput]:
    """Limits of a profile that contradict each other."""
    faults = []
    if profile.max_buffer_bytes > profile.memory_budget_bytes:
        faults.append(
            BadInput(
                "max_buffer_bytes is larger than memory_budget_bytes",
                where=where,
                mend="lower the one or raise the other",
            )
        )
    # A group may have what several units share, but no more than the machine has.
    local, machine = profile.local_memory_bytes, profile.machine
    if machine is not None and (machine.local_bytes.high + 1) * machine.units.high < local:
        faults.append(
            BadInput(
                f"machine.local_bytes: all units have less than the {local:,} bytes of "
                "local_memory_bytes, which one work-group may use",
                where=where,
                mend="raise the one or lower the other",
            )
        )
    if problem := profile.workgroup_size_problem(profile.default_workgroup_size):
        faults.append(BadInput(f"default_workgroup_size: {problem}", where=where))
    return faults


def _figure(table: Mapping[str, Any], name: str, where: str) -> Figure:
    entry = table.get(name)
    example = f'{name} = {{ value = 1, source = "estimate" }}'
    if not isinstance(entry, Mapping) or "value" not in entry:
        raise BadInput(f"figure '{name}' is missing", where=where, mend=f"add {example}")
    value, source = entry["value"], entry.get("source")
    if not isinstance(source, str) or not source.strip():
        raise BadInput(f"figure '{name}' has no source", where=where, mend=f"write {example}")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadInput(f"figure '{name}' is {value!r}, not a number", where=where)
    if not 0 < value < float("inf"):
        raise BadInput(f"figure '{name}' is {value}", where=where, mend="it must be positive")
    if name not in _FRACTIONAL and value != int(value):
        raise BadInput(f"figure '{name}' is {value}", where=where, mend="it must be whole")
    return Figure(float(value), source)
