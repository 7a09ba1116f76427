"""Colours that are told apart."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gibench.report.colors import distinct, oklab
from gibench.report.plots import (
    COLORS,
    PASS_COLORS,
    TECHNIQUE_COLORS,
    pass_colors,
    technique_colors,
)


def luminance(color):
    c = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(c <= 0.03928, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ [
        0.2126,
        0.7152,
        0.0722,
    ]


def contrast(a, b):
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_oklab_of_known_colours():
    """Ottosson 2020: white is 1, 0, 0; sRGB's red is 0.6280, 0.2249, 0.1258."""
    np.testing.assert_allclose(oklab("#FFFFFF"), [1, 0, 0], atol=2e-4)
    np.testing.assert_allclose(oklab("#FF0000"), [0.62796, 0.22486, 0.12585], atol=2e-4)


@pytest.mark.parametrize("first", [COLORS, TECHNIQUE_COLORS, PASS_COLORS])
@pytest.mark.parametrize("count", [0, 3, 8, 40, 120])
def test_as_many_colours_as_are_asked_for_and_no_two_alike(first, count):
    found = distinct(first, count)
    assert len(found) == len(set(found)) == count
    assert found[:8] == list(first)[:count]
    if 8 < count <= 40:
        labs = [oklab(color) for color in found]
        least = min(np.linalg.norm(a - b) for a, b in itertools.combinations(labs, 2))
        assert least > 0.03  # twice what is just told apart side by side (about 0.02 at most)


def test_colours_of_passes_stand_out_from_white_and_from_near_black():
    for color in pass_colors(f"pass {n}" for n in range(60)).values():
        assert contrast(color, "#FFFFFF") >= 3, color
        assert contrast(color, "#14171A") >= 3, color
    with pytest.raises(ValueError, match="colours"):
        distinct(COLORS, 1000)


def test_no_two_of_many_techniques_share_a_colour():
    names = [f"other {n}" for n in range(12)]
    colors = technique_colors(["srp", *names])
    assert len(set(colors.values())) == 13
    assert technique_colors(["srp"])["srp"] == colors["srp"]
