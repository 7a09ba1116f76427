"""Where the probes are, and which rays they cast."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats
from gibench.errors import BadInput
from gibench.scene.model import Scene
from gibench.techniques.ddgi.settings import Counts, DdgiSettings, Triple

PROBES_PER_SRP_PROBE = 8  # our choice: half of SRP's probe distance along every axis


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
        """What kernels_cl/ddgi/volume.cl reads: origin, spacing, scroll; (9,) float32."""
        stored = np.mod(self.scroll, self.counts)
        return np.concatenate([self.origin, self.spacing, stored]).astype(np.float32)


def make_volume(scene: Scene, settings: DdgiSettings) -> Volume:
    """The volume that the settings ask for.

    Raises:
        BadInput: it misses the scene.
    """
    low, high = scene.bounds
    counts = settings.given_counts
    origin, spacing = settings.given_origin, settings.given_spacing
    if origin is None or spacing is None:
        budget = settings.probes or PROBES_PER_SRP_PROBE * scene.probes.count
        return fit_volume(low, high, counts or fit_counts(low, high, budget))
    assert counts is not None  # the settings refuse it
    volume = Volume(origin, spacing, counts)
    first = np.array(origin) - spacing
    last = np.array(origin) + np.array(counts) * np.array(spacing)
    if (first > high).any() or (last < low).any():
        raise BadInput(
            f"the volume of {'x'.join(str(c) for c in counts)} probes from {settings.origin} "
            f"misses the scene '{scene.name}', which lies between {_point(low)} and {_point(high)}",
            mend="change origin, spacing or counts",
        )
    return volume


def fit_volume(low: Doubles, high: Doubles, counts: Counts) -> Volume:
    """The box cut into equal cells, a probe in the middle of each.

    Probes on the box itself would lie in a room's walls; a flat box gets a spacing of 1 cm.
    """
    spacing = np.maximum((high - low) / np.array(counts), 0.01)
    origin = (low + high) / 2 - (np.array(counts) - 1) / 2 * spacing
    (x, y, z), (dx, dy, dz) = (tuple(float(v) for v in a) for a in (origin, spacing))
    return Volume((x, y, z), (dx, dy, dz), counts)


def fit_counts(low: Doubles, high: Doubles, budget: int) -> Counts:
    """The counts of at most ``budget`` probes whose cells have the least diagonal."""
    extent = np.maximum(high - low, 0.01)
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


def spherical_fibonacci(count: int) -> Doubles:
    """``count`` directions (count, 3) spread evenly over the sphere.

    Keinert et al. 2015, "Spherical Fibonacci Mapping", equation 2.
    """
    i = np.arange(count)
    azimuth = 2 * np.pi * np.mod(i * ((math.sqrt(5) - 1) / 2), 1)
    z = 1 - (2 * i + 1) / count
    r = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1)


def random_rotation(rng: np.random.Generator) -> Doubles:
    """A rotation matrix (3, 3), uniform over all (Shoemake 1992: a uniform unit quaternion)."""
    quaternion = rng.normal(size=4)
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def ray_directions(settings: DdgiSettings, seed: int, frame: int) -> Floats:
    """A frame's ray directions (rays, 3): the fixed ones, then the rotated ones."""
    rotation = random_rotation(np.random.default_rng((seed, frame)))
    rotated = spherical_fibonacci(settings.blended) @ rotation.T
    directions = np.concatenate([spherical_fibonacci(settings.fixed), rotated])
    return directions.astype(np.float32)


def _point(p: npt.NDArray[Any]) -> str:
    return ", ".join(f"{v:.3g}" for v in p)
