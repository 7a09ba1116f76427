"""Faults that an eye finds in light which is right on average: how far each goes. No I/O here.

Light is luminance throughout (Rec. 709), at the receivers of a lightmap. What each figure is, and
from where on it counts as a fault, docs/metrics.md says; blotches have a module of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Bools, Doubles
from gibench.reference.luminance import LUMINANCE, luminance

DARK = 0.05
"""Of the truth's mean: what has less light is dark."""
LEAST_DARK = 0.001
"""Share of the surface that must be dark for a scene to have a dark region."""
SIGMAS = 1.96
"""Standard errors of the truth that are held for its noise (95 %, two-sided)."""
LEAST_CHANGE = 0.01
"""Of the light, root mean square: what changes by less does not change."""
HALF, NEARLY = 0.5, 0.95
"""Of the way from the old light to the new one."""
ROUNDING = 1e-9
"""Of the way: what sums over receivers may be off by where light is exactly half way."""
NAN, NEVER = float("nan"), float("inf")


@dataclass(frozen=True)
class Fault:
    """A figure of a fault.

    Attributes:
        name: its column.
        title: where it is read.
        threshold: more than this counts as a fault.
        unit: ``share`` or ``frames``.
        meaning: in words.
    """

    name: str
    title: str
    threshold: float
    unit: str
    meaning: str


FAULTS = (
    Fault("leak", "leak", 0.02, "share", "light where the truth is dark, of its mean"),
    Fault("flicker_p50", "flicker, half of the receivers", 0.02, "share",
          "standard deviation over frames, of a receiver's mean: the median receiver"),
    Fault("flicker_p99", "flicker, the worst 1 %", 0.05, "share",
          "the same of the receiver that 1 % flicker more than"),
    Fault("lag_light_half", "light switched: half way", 8.0, "frames",
          "until half of a light that is switched is there"),
    Fault("lag_light_95", "light switched: 95 %", 30.0, "frames", "until 95 % of it are"),
    Fault("lag_object_half", "object moved: half way", 8.0, "frames",
          "until half of what an object that was moved changes is there"),
    Fault("lag_object_95", "object moved: 95 %", 30.0, "frames", "until 95 % of it are"),
    Fault("blotches", "blotches", 0.03, "share", "low-frequency error on flat surfaces"),
    Fault("missing", "missing", 0.0, "share", "receivers that nothing is said of"),
)  # fmt: skip
"""Thresholds: 2 % of flicker or leak is about what an eye tells apart at all (Weber's law), 30
frames are a second at 30 frames per second. They are ours, and only say what is shown as a
fault.
"""


def dark(truth: Doubles, stderr: Doubles, area: npt.NDArray[np.floating], among: Bools) -> Bools:
    """Which receivers (n,) of those ``among`` are dark for certain, whatever the truth's noise.

    Args:
        truth: (n, 3) irradiance, W/m2.
        stderr: (n, 3) its standard error.
        area: (n,) of the receivers, m2.
        among: (n,) those that count.
    """
    light = luminance(truth)
    mean = float((area * light).sum() / area.sum())
    found = among & (light + SIGMAS * _noise(truth, stderr) <= DARK * mean)
    if mean <= 0 or float(area[found].sum()) < LEAST_DARK * float(area[among].sum()):
        return np.zeros(len(light), np.bool_)
    return np.asarray(found, np.bool_)


def leak(
    result: Doubles, truth: Doubles, stderr: Doubles, area: npt.NDArray[np.floating], among: Bools
) -> float:
    """Light where the truth is dark: the mean over the dark receivers, by area, of what exceeds the
    truth and its noise, over the mean of the truth. nan where no region is dark.

    Args:
        result: (n, 3) irradiance, W/m2.
        truth: (n, 3).
        stderr: (n, 3) of the truth.
        area: (n,) of the receivers, m2.
        among: (n,) those that count: a receiver inside of a wall is dark for no fault of any.
    """
    where = dark(truth, stderr, area, among)
    if not where.any():
        return NAN
    light = luminance(truth)
    mean = float((area * light).sum() / area.sum())
    over = luminance(result) - light - SIGMAS * _noise(truth, stderr)
    excess = np.maximum(over, 0.0)[where]
    return float((area[where] * excess).sum() / area[where].sum()) / mean


def missing(result: Doubles, covered: Bools, truth: Doubles, stderr: Doubles) -> float:
    """Share of the receivers that a technique says nothing of: those it does not cover, and those
    it leaves all black where the truth is lit for certain.

    Args:
        result: (n, 3) irradiance, W/m2.
        covered: (n,) those it has anything to say of.
        truth: (n, 3).
        stderr: (n, 3) of the truth.
    """
    light = luminance(truth)
    lit = light - SIGMAS * _of_luminance(stderr) > DARK * light.mean()
    black = ~result.any(axis=1)
    return float((~covered | (black & lit)).mean())


@dataclass
class Moments:
    """Mean and standard deviation over frames of every receiver, frame by frame (Welford 1962).

    Attributes:
        count: of frames.
        mean: (n,) over the frames.
    """

    count: int = 0
    mean: Doubles = field(default_factory=lambda: np.zeros(0))
    _squares: Doubles = field(default_factory=lambda: np.zeros(0), repr=False)

    def add(self, values: Doubles) -> None:
        """Take a frame's values (n,)."""
        if not self.count:
            self.mean, self._squares = np.zeros(len(values)), np.zeros(len(values))
        self.count += 1
        off = values - self.mean
        self.mean = self.mean + off / self.count
        self._squares = self._squares + off * (values - self.mean)

    @property
    def deviation(self) -> Doubles:
        """(n,) sample standard deviations; nan from fewer than two frames."""
        if self.count < 2:
            return np.full(len(self.mean), NAN)
        return np.asarray(np.sqrt(np.maximum(self._squares, 0.0) / (self.count - 1)))


def flicker(moments: Moments, percentiles: Sequence[float] = (50.0, 99.0)) -> tuple[float, ...]:
    """Standard deviation over frames as a share of each receiver's own mean, at these percentiles
    of the receivers; those with less than ``DARK`` of the mean light do not count. nan where none
    does.
    """
    lit = moments.mean > DARK * moments.mean.mean() if len(moments.mean) else np.zeros(0, bool)
    if not lit.any():
        return tuple(NAN for _ in percentiles)
    shares = moments.deviation[lit] / moments.mean[lit]
    return tuple(float(value) for value in np.percentile(shares, percentiles))


def progress(now: Doubles, old: Doubles, new: Doubles, area: npt.NDArray[np.floating]) -> float:
    """How far light has come on its way from ``old`` to ``new``, (n,) each: 0 is not at all, 1 is
    there. The change is projected on what it is to become, by area, so that noise of many receivers
    hardly counts.
    """
    way = new - old
    return float((area * (now - old) * way).sum() / (area * way * way).sum())


def changes(old: Doubles, new: Doubles, area: npt.NDArray[np.floating], deviation: Doubles) -> bool:
    """Whether light (n,) changes at all: r.m.s. by area, by ``LEAST_CHANGE`` of the brighter one
    and by twice what its own flicker could make of two frames.

    Args:
        old: before.
        new: after.
        area: of the receivers, m2.
        deviation: standard deviations over frames.
    """
    most = max(float((area * old * old).sum()), float((area * new * new).sum()))
    noise = 2 * float((area * deviation * deviation).sum())
    change = float((area * (new - old) ** 2).sum())
    return change > LEAST_CHANGE**2 * most and change > 2**2 * noise


def frames_until(shares: Sequence[float], share: float) -> float:
    """The first frame, counted from 1, that has come ``share`` of the way; ``NEVER`` where none
    has.
    """
    least = share - ROUNDING
    return next((float(n) for n, value in enumerate(shares, 1) if value >= least), NEVER)


def _noise(truth: Doubles, stderr: Doubles) -> Doubles:
    """Standard error (n,) of the luminance, at least that of a receiver with ``DARK`` of the mean
    light.

    Where few paths find light, one that found none has an estimate of 0 without any error. Light
    that is found by chance has a variance in proportion to its mean: k = sum s^2 / sum y of all
    receivers.
    """
    light, found = luminance(truth), _of_luminance(stderr)
    total = float(light.sum())
    if total <= 0:
        return found
    least = float((found**2).sum()) / total * DARK * float(light.mean())
    return np.asarray(np.maximum(found, np.sqrt(least)))


def _of_luminance(stderr: Doubles) -> Doubles:
    """Standard error (n,) of the luminance, the channels being independent."""
    return np.asarray(np.sqrt((stderr**2) @ LUMINANCE**2))
