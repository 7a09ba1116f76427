"""The ``map_`` statements of MTL files."""

from __future__ import annotations

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
_HARMLESS = ("-blendu", "-blendv", "-boost", "-cc", "-texres", "-type", "-imfchan")

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
    """

    file: str
    transform: Transform = ((1.0, 1.0), (0.0, 0.0))
    ignored: tuple[str, ...] = ()
    strength: float = 1.0


def map_statement(text: str) -> MapStatement:
    """A ``map_`` statement's file, which may hold blanks, and its options."""
    rest = without_comment(text)
    scale, offset, strength = [1.0, 1.0], [0.0, 0.0], 1.0
    ignored = []
    while (option := rest.partition(" ")[0].lower()) in _MAP_OPTIONS:
        rest = rest.partition(" ")[2].strip()
        given: list[str] = []
        for i in range(_MAP_OPTIONS[option]):
            word, _, after = rest.partition(" ")
            if (i > 0 or option in ("-o", "-s", "-t", "-mm")) and not numbers_of(word):
                break
            given.append(word)
            rest = after.strip()
        if option in ("-s", "-o"):
            for i, number in enumerate(numbers_of(" ".join(given))[:2]):
                (scale if option == "-s" else offset)[i] = number
        elif option == "-bm":
            strength = next(iter(numbers_of(" ".join(given))), 1.0)
        elif option not in _HARMLESS and not (option == "-clamp" and given == ["off"]):
            ignored.append(f"{option} {' '.join(given)}")
    transform = ((scale[0], scale[1]), (offset[0], offset[1]))
    if not np.isfinite(transform).all():
        transform = MapStatement("").transform
    strength = strength if np.isfinite(strength) else 1.0
    return MapStatement(rest.strip().strip('"'), transform, tuple(ignored), strength)


def numbers_of(text: str) -> list[float]:
    """The numbers that ``text`` is made of; none where a word is no number, but for a comment."""
    try:
        return [float(word) for word in without_comment(text).split()]
    except ValueError:
        return []
