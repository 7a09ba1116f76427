"""Flat surfaces of a lightmap: its charts that lie in one plane, as grids of texels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.ndimage import find_objects, label

from gibench.arrays import Doubles
from gibench.measure.statistics.blotches import FlatError
from gibench.measure.statistics.faults import DARK
from gibench.reference.luminance import LUMINANCE, luminance
from gibench.scene.lightmap import Lightmap

NEAR = 0.02
"""Of the scene's diagonal: standard deviation of the narrower Gaussian. What is a fiftieth of a
room wide is seen from across it at about a degree."""
LEAST_NEAR = 1.5
"""Texels that it has at least: narrower ones would let the noise of single receivers through."""
LEAST_SIDE = 4.0
"""Of the narrower Gaussian's width: the shorter side of a surface that counts."""
_ALONG = 0.999  # cosine: how far a receiver's normal may lie off its chart's


@dataclass(frozen=True)
class FlatChart:
    """A chart in one plane.

    Attributes:
        receivers: (h, w) of its texels; -1 where it has none.
        near: standard deviation of the narrower Gaussian, texels.
    """

    receivers: npt.NDArray[np.int32] = field(repr=False)
    near: float


def flat_charts(lightmap: Lightmap) -> list[FlatChart]:
    """The charts of ``lightmap`` that are flat and wide enough to have blotches.

    Charts lie a texel apart, so that they are what hangs together in the atlas.
    """
    table = lightmap.receiver_of_texel.reshape(lightmap.height, lightmap.width)
    numbers, _ = label(table >= 0, structure=np.ones((3, 3)))
    position, normal = lightmap.receivers.position, lightmap.receivers.normal
    diagonal = float(np.linalg.norm(np.ptp(position.astype(np.float64), axis=0)))
    found = []
    for number, box in enumerate(find_objects(numbers), 1):
        own = np.where(numbers[box] == number, table[box], -1).astype(np.int32)
        chosen = own[own >= 0]
        middle = normal[chosen].astype(np.float64).mean(axis=0)
        length = float(np.linalg.norm(middle))
        if length == 0 or (normal[chosen] @ (middle / length)).min() < _ALONG:
            continue
        # A texel that the chart covers whole has the most area.
        texel = float(np.sqrt(np.percentile(lightmap.receivers.area[chosen], 90)))
        near = max(NEAR * diagonal / texel, LEAST_NEAR) if texel > 0 else np.inf
        if min(own.shape) >= LEAST_SIDE * near:
            found.append(FlatChart(own, near))
    return found


def flat_errors(
    charts: Sequence[FlatChart],
    result: Doubles,
    truth: Doubles,
    stderr: Doubles,
    area: npt.NDArray[np.floating],
) -> list[FlatError]:
    """The error of ``result`` on those of ``charts`` that are lit, of each one's own mean light.

    Args:
        charts: see :func:`flat_charts`.
        result: (n, 3) irradiance, W/m2.
        truth: (n, 3).
        stderr: (n, 3) of the truth.
        area: (n,) of the receivers, m2.
    """
    light, off = luminance(truth), luminance(result) - luminance(truth)
    variance = (stderr**2) @ LUMINANCE**2
    mean = float((area * light).sum() / area.sum())
    found = []
    for chart in charts:
        there = chart.receivers >= 0
        own = chart.receivers[there]
        weight = np.zeros(there.shape)
        weight[there] = area[own]
        level = float((area[own] * light[own]).sum() / area[own].sum())
        if level <= DARK * mean:
            continue
        error, noise = np.zeros(there.shape), np.zeros(there.shape)
        error[there], noise[there] = off[own] / level, variance[own] / level**2
        found.append(FlatError(error, noise, weight, chart.near))
    return found
