"""The ``map_`` statements of MTL files."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from gibench.scene.readers.text import without_comment

# Options of texture maps and how many arguments each takes at most (MTL specification); -o, -s and
# -t take one to three numbers.
_MAP_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1,
    "-mm": 2, "-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-type": 1,
}  # fmt: skip
# Options that change nothing here: of filtering, of images' resolution, of colour correction.
_HARMLESS = ("-blendu", "-blendv", "-boost", "-cc", "-texres", "-type")
_SWITCHES = ("-blendu", "-blendv", "-cc", "-clamp")

Transform = tuple[tuple[float, float], tuple[float, float]]
"""Scale and offset of texture coordinates: u' = u * scale + offset."""


@dataclass(frozen=True)
class MapStatement:
    """A ``map_`` statement.

    Attributes:
        file: the name as written, without quotes.
        transform: of its texture coordinates.
        ignored: options that would change the picture and are not used.
        strength: of a bump map (-bm).
        channel: of the image (-imfchan), a letter; "" where nothing is said.
    """

    file: str
    transform: Transform = ((1.0, 1.0), (0.0, 0.0))
    ignored: tuple[str, ...] = ()
    strength: float = 1.0
    channel: str = ""


def map_statement(text: str) -> MapStatement:
    """A ``map_`` statement's file, which may hold blanks, and its options, which stand before it or
    behind it.
    """
    options, rest = _options(without_comment(text))
    for blank in re.finditer(r"\s+(?=-)", rest):
        behind, left = _options(rest[blank.end() :])
        if behind and not left and all(_is_sound(*option) for option in behind):
            options += behind
            rest = rest[: blank.start()]
            break
    scale, offset, strength, channel = [1.0, 1.0], [0.0, 0.0], 1.0, ""
    ignored = []
    for option, given in options:
        if option in ("-s", "-o"):
            for i, number in enumerate(numbers_of(" ".join(given))[:2]):
                (scale if option == "-s" else offset)[i] = number
        elif option == "-bm":
            strength = next(iter(numbers_of(" ".join(given))), 1.0)
        elif option == "-imfchan":
            channel = "".join(given).lower()
        elif option not in _HARMLESS and not (option == "-clamp" and given == ["off"]):
            ignored.append(f"{option} {' '.join(given)}")
    transform = ((scale[0], scale[1]), (offset[0], offset[1]))
    if not np.isfinite(transform).all():
        transform = MapStatement("").transform
    strength = strength if np.isfinite(strength) else 1.0
    name = rest.strip().strip('"')
    return MapStatement(name, transform, tuple(ignored), strength, channel)


def _options(text: str) -> tuple[list[tuple[str, list[str]]], str]:
    """The options that ``text`` begins with, each with its arguments, and what follows them."""
    found = []
    option, rest = _first(text)
    while option.lower() in _MAP_OPTIONS:
        option = option.lower()
        given: list[str] = []
        for i in range(_MAP_OPTIONS[option]):
            word, after = _first(rest)
            if (i > 0 or option in ("-o", "-s", "-t", "-mm")) and not numbers_of(word):
                break
            given.append(word)
            rest = after
        found.append((option, given))
        text = rest
        option, rest = _first(text)
    return found, text


def _first(text: str) -> tuple[str, str]:
    """The first word, and what follows it."""
    words = text.split(None, 1)
    return (words[0] if words else "", words[1] if len(words) > 1 else "")


def _is_sound(option: str, given: list[str]) -> bool:
    """Whether an option has arguments that it can have, so that it is no piece of a name."""
    if option in _SWITCHES:
        return given in (["on"], ["off"])
    if option == "-imfchan":
        return len(given) == 1 and given[0].lower() in tuple("rgbmlz")
    return option == "-type" or bool(numbers_of(" ".join(given)))


def numbers_of(text: str) -> list[float]:
    """The numbers that ``text`` is made of; none where a word is no number, but for a comment."""
    try:
        return [float(word) for word in without_comment(text).split()]
    except ValueError:
        return []
