"""Colours that are told apart, as many as are asked for. No I/O here."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from gibench.arrays import Doubles
from gibench.reference.luminance import LUMINANCE

# Lightness and chroma in OKLCH.
_LIGHTNESS = (0.52, 0.58, 0.64, 0.7)
_CHROMA = (0.06, 0.12, 0.17)
_HUES = 60
# Relative luminance of colours that stand out by 3 (WCAG 2.1, 1.4.11) from white, which is
# (1 + 0.05) / 3 - 0.05, and from the page's near-black.
_STANDS_OUT = (0.13, 0.299)
# Ottosson 2020, "A perceptual color space for image processing": OKLab to the roots of LMS, and
# LMS to linear sRGB.
_TO_ROOTS = np.array(
    [
        [1.0, 0.3963377774, 0.2158037573],
        [1.0, -0.1055613458, -0.0638541728],
        [1.0, -0.0894841775, -1.2914855480],
    ]
)
_TO_LINEAR = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)


def distinct(first: Sequence[str], count: int) -> list[str]:
    """``count`` different colours, ``#rrggbb``: ``first`` and then, one by one, that of a wheel
    which is furthest from all before it (OKLab).

    Args:
        first: begin with these, as far as they are needed.
        count: of them; at most 200.

    Raises:
        ValueError: that many are not to be had.
    """
    found = list(first[:count])
    if len(found) == count:
        return found
    names, labs = _wheel()
    if count - len(found) > len(names):
        raise ValueError(f"{count} colours")
    taken = [oklab(color) for color in found]
    far = np.full(len(names), np.inf)
    for lab in taken:
        far = np.minimum(far, np.linalg.norm(labs - lab, axis=1))
    while len(found) < count:
        best = int(np.argmax(far))
        found.append(names[best])
        far = np.minimum(far, np.linalg.norm(labs - labs[best], axis=1))
    return found


def oklab(color: str) -> Doubles:
    """OKLab (3,) of ``#rrggbb``."""
    encoded = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    roots = np.cbrt(np.linalg.solve(_TO_LINEAR, linear))
    return np.asarray(np.linalg.solve(_TO_ROOTS, roots))


@cache
def _wheel() -> tuple[tuple[str, ...], Doubles]:
    """The colours there are to choose from, and their OKLab (n, 3)."""
    names: dict[str, None] = {}
    for chroma in _CHROMA:
        for light in _LIGHTNESS:
            for hue in np.arange(_HUES) / _HUES * 2 * np.pi:
                lab = np.array([light, chroma * np.cos(hue), chroma * np.sin(hue)])
                linear = _TO_LINEAR @ (_TO_ROOTS @ lab) ** 3
                if linear.min() < 0 or linear.max() > 1:
                    continue
                if not _STANDS_OUT[0] <= float(linear @ LUMINANCE) <= _STANDS_OUT[1]:
                    continue
                low = 12.92 * linear
                high = 1.055 * linear ** (1 / 2.4) - 0.055
                encoded = np.where(linear <= 0.0031308, low, high)
                names["#" + "".join(f"{round(255 * value):02X}" for value in encoded)] = None
    return tuple(names), np.array([oklab(name) for name in names])
