"""A regular grid of probes: where they are."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats
from gibench.device.build import Define
from gibench.errors import BadInput
from gibench.scene.model import Scene

AUTO: Final = "auto"
"""What a user writes for a volume that fits the scene."""

# A side is no shorter than this share of the longest one.
_FLAT_SHARE = 0.005

Counts = tuple[int, int, int]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Volume:
    """A regular grid of probes.

    Attributes:
        origin: of probe (0, 0, 0), m.
        spacing: between neighbours along x, y and z, m.
        counts: probes along x, y and z.
        scroll: how far the volume has been moved, in spacings. A probe's data lie where its
            coordinates plus the scroll, modulo the counts, say (x fastest), so that a volume that
            moves keeps what it still covers.
    """

    origin: Triple
    spacing: Triple
    counts: Counts
    scroll: Counts = (0, 0, 0)

    @property
    def probes(self) -> int:
        """Number of probes."""
        return math.prod(self.counts)

    @property
    def defines(self) -> dict[str, Define]:
        """Macros of kernels_cl/parts/probe_volume.cl."""
        x, y, z = self.counts
        return {"PROBES": self.probes, "PROBES_X": x, "PROBES_Y": y, "PROBES_Z": z}

    @property
    def coordinates(self) -> npt.NDArray[np.int64]:
        """Grid coordinates (p, 3) of the probes in the order of their data."""
        x, y, _ = self.counts
        i = np.arange(self.probes)
        stored = np.stack([i % x, i // x % y, i // (x * y)], axis=1)
        return np.asarray((stored - self.scroll) % self.counts)

    @property
    def positions(self) -> Doubles:
        """Grid positions (p, 3) of the probes in the order of their data, m."""
        return np.asarray(np.array(self.origin) + self.coordinates * np.array(self.spacing))

    def scrolled(self, centre: npt.ArrayLike) -> Volume:
        """The volume moved by whole spacings so that its middle is nearest to ``centre``."""
        spacing = np.array(self.spacing)
        middle = np.array(self.origin) + (np.array(self.counts) - 1) / 2 * spacing
        steps = np.rint((np.asarray(centre, np.float64) - middle) / spacing).astype(np.int64)
        ox, oy, oz = (float(v) for v in np.array(self.origin) + steps * spacing)
        sx, sy, sz = (int(v) for v in np.array(self.scroll) + steps)
        return replace(self, origin=(ox, oy, oz), scroll=(sx, sy, sz))

    def table(self) -> Floats:
        """What kernels_cl/parts/probe_volume.cl reads: origin, spacing, scroll; (9,) float32."""
        stored = np.mod(self.scroll, self.counts)
        return np.concatenate([self.origin, self.spacing, stored]).astype(np.float32)


def given_volume(scene: Scene, counts: Counts, origin: Triple, spacing: Triple) -> Volume:
    """The volume that a user gives.

    Args:
        scene: that it is for.
        counts: probes along x, y and z.
        origin: of the first probe, m.
        spacing: between probes, m.

    Raises:
        BadInput: it misses the scene.
    """
    low, high = scene.bounds
    first = np.array(origin) - spacing
    last = np.array(origin) + np.array(counts) * np.array(spacing)
    if (first > high).any() or (last < low).any():
        raise BadInput(
            f"the volume of {'x'.join(str(c) for c in counts)} probes from "
            f"{','.join(f'{v:g}' for v in origin)} misses the scene '{scene.name}', which lies "
            f"between {_point(low)} and {_point(high)}",
            mend="change origin, spacing or counts",
        )
    return Volume(origin, spacing, counts)


def fit_volume(low: Doubles, high: Doubles, counts: Counts) -> Volume:
    """The box from ``low`` to ``high`` (3,), m, cut into equal cells, a probe in the middle of
    each.

    Probes on the box itself would lie in a room's walls; a flat box gets a little depth.
    """
    spacing = np.maximum((high - low) / np.array(counts), _least_extent(low, high))
    origin = (low + high) / 2 - (np.array(counts) - 1) / 2 * spacing
    (x, y, z), (dx, dy, dz) = (tuple(float(v) for v in a) for a in (origin, spacing))
    return Volume((x, y, z), (dx, dy, dz), counts)


def fit_counts(low: Doubles, high: Doubles, budget: int) -> Counts:
    """The counts of at most ``budget`` probes whose cells have the least diagonal."""
    extent = np.maximum(high - low, _least_extent(low, high))
    best, found = math.inf, (1, 1, 1)
    for x in range(1, budget + 1):
        y = np.arange(1, budget // x + 1)
        z = budget // (x * y)
        diagonal = (extent[0] / x) ** 2 + (extent[1] / y) ** 2 + (extent[2] / z) ** 2
        i = int(np.argmin(diagonal))
        if diagonal[i] < best:
            best, found = float(diagonal[i]), (x, int(y[i]), int(z[i]))
        # No y and z with y z <= budget / x fall below this (inequality of the means).
        if 2 * extent[1] * extent[2] * x / budget > best:
            break
    return found


def _least_extent(low: Doubles, high: Doubles) -> float:
    """What a flat box counts as deep, m."""
    return _FLAT_SHARE * float((high - low).max())


def parse_counts(text: str) -> Counts | None:
    """Probes along x, y and z as a user writes them, ``20x10x10``; None for automatic.

    Raises:
        BadInput: it is not that.
    """
    if text == AUTO:
        return None
    match = re.fullmatch(r"(\d+)x(\d+)x(\d+)", text.strip().lower())
    if match is None or 0 in (found := tuple(int(n) for n in match.groups())):
        raise BadInput(
            f"counts is '{text}'", mend="give three whole numbers of 1 or more: 20x10x10"
        )
    return found[0], found[1], found[2]


def parse_triple(name: str, text: str) -> Triple | None:
    """Three lengths, m, as a user writes them, ``1.5,1,1.5``; None for automatic.

    Raises:
        BadInput: it is not that; the message has the setting's ``name``.
    """
    if text == AUTO:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise BadInput(f"{name} is '{text}'", mend="give three lengths: 1.5,1,1.5") from None
    if not all(math.isfinite(v) for v in (x, y, z)):
        raise BadInput(f"{name} is '{text}'", mend="give three finite lengths")
    return x, y, z


def _point(p: npt.NDArray[Any]) -> str:
    return ", ".join(f"{v:.3g}" for v in p)
