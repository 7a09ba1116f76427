"""A profile as the text of its TOML file."""

from __future__ import annotations

import json

from gibench.profiles.machine import MACHINE_FIGURES, Interval
from gibench.profiles.profile import SCHEMA_VERSION, DeviceProfile


def profile_toml(profile: DeviceProfile) -> str:
    """The text of a profile's file: reading it gives the profile again, but for its hashes."""
    lines = [
        f"schema_version = {SCHEMA_VERSION}",
        f"name = {_text(profile.name)}",
        f"title = {_text(profile.title)}",
    ]
    for name, figure in profile.figures.items():
        lines += ["", f"[{name}]", f"value = {_number(figure.value)}"]
        lines.append(f"source = {_text(figure.source)}")
    if profile.machine is not None:
        lines += ["", "[machine]"]
        for name in MACHINE_FIGURES:
            lines.append(f"{name} = {{ {_figures(getattr(profile.machine, name))} }}")
    return "\n".join(lines) + "\n"


def _figures(interval: Interval) -> str:
    numbers = {"low": interval.low, "nominal": interval.nominal, "high": interval.high}
    if interval.low == interval.high:
        numbers = {"value": interval.nominal}
    said = [f"{key} = {_number(value)}" for key, value in numbers.items()]
    return ", ".join([*said, f"source = {_text(interval.source)}"])


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(float(value))


def _text(text: str) -> str:
    """A basic string of TOML, whose escapes are those of JSON."""
    return json.dumps(text, ensure_ascii=False)
