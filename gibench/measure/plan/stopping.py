"""When a configuration has warmed up and when it has been measured enough. No I/O here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from gibench.measure.statistics.summary import NAN

WARMUP_WINDOW = 5
"""Frames compared with as many before them to see whether times still fall."""


@dataclass(frozen=True)
class Patience:
    """How long warm-up waits for a technique to be at rest.

    Attributes:
        frames: at most.
        seconds: at most, of frames.
    """

    frames: int = 1000
    seconds: float = 180.0

    def over(self, frames: int, spent_ms: float) -> bool:
        """Whether so many frames, which took so long, are all that it waits."""
        return frames >= self.frames or spent_ms >= 1e3 * self.seconds

    def spent(self, walls_ms: Sequence[float]) -> int | None:
        """After how many of these frames (times in order, ms) it was over; None where it is not."""
        if not self.over(len(walls_ms), sum(walls_ms)):
            return None
        elapsed = accumulate(walls_ms, initial=0.0)
        return next(frames for frames, ms in enumerate(elapsed) if self.over(frames, ms))


@dataclass(frozen=True)
class Plan:
    """How long a configuration is run.

    Warm-up goes on until a technique that tells is at rest, or ``patience`` with it is over, and
    then for two windows of ``WARMUP_WINDOW`` frames at least, until the median of the last one is
    within ``settled`` of that of the one before (the steady state of Georges, Buytaert and
    Eeckhout, "Statistically rigorous Java performance evaluation", OOPSLA 2007, section 3.4, with
    medians for their coefficient of variation, which stalls of a shared machine never let settle).

    Measuring ends when the distribution-free 95 % confidence interval of the median frame time is
    narrower than ``relative_width`` of the median (Hoefler and Belli, "Scientific benchmarking of
    parallel computing systems", SC 2015, section 4.2.2), but not before ``least`` frames, and at
    ``most`` frames or after ``seconds``.

    Attributes:
        frames: exactly so many are measured; None lets the rule decide.
        warmup: exactly so many are run first; None lets the rule decide.
        settled: relative change of the median that counts as settled.
        warmup_most: frames of warm-up at most.
        warmup_seconds: of warm-up at most; both are counted from when it is at rest, or no longer
            waited for.
        patience: how long it is waited for until it is.
        relative_width: of the confidence interval.
        least: frames at least.
        most: frames at most.
        seconds: of measuring at most, per configuration.
    """

    frames: int | None = None
    warmup: int | None = None
    settled: float = 0.05
    warmup_most: int = 60
    warmup_seconds: float = 10.0
    patience: Patience = field(default_factory=Patience)
    relative_width: float = 0.05
    least: int = 30
    most: int = 500
    seconds: float = 30.0

    def warm(self, walls_ms: Sequence[float], waited: int | None = 0) -> bool:
        """Whether these frames (times in order, ms) were warm-up enough.

        Args:
            walls_ms: of all frames of warm-up.
            waited: how many of them it took until the technique was at rest: 0 where it is not
                waited for, None while it is.
        """
        done = len(walls_ms)
        if self.warmup is not None:
            return done >= self.warmup
        if waited is None and (waited := self.patience.spent(walls_ms)) is None:
            return False
        since = walls_ms[waited:]
        if len(since) >= self.warmup_most or sum(since) > 1e3 * self.warmup_seconds:
            return True
        if len(since) < 2 * WARMUP_WINDOW:
            return False
        before = float(np.median(walls_ms[-2 * WARMUP_WINDOW : -WARMUP_WINDOW]))
        return abs(float(np.median(walls_ms[-WARMUP_WINDOW:])) - before) <= self.settled * before

    def enough(self, walls_ms: Sequence[float]) -> str | None:
        """Why these measured frames (times in order, ms) are enough; None when they are not."""
        done = len(walls_ms)
        if self.frames is not None:
            return "the frames asked for" if done >= self.frames else None
        if done < self.least and sum(walls_ms) <= 1e3 * self.seconds:
            return None
        low, high = median_interval(walls_ms)
        if high - low <= self.relative_width * float(np.median(walls_ms)):
            return f"the median is known to {100 * self.relative_width:.0f} %"
        if done >= self.most:
            return f"the cap of {self.most} frames"
        if sum(walls_ms) > 1e3 * self.seconds:
            return f"the cap of {self.seconds:.0f} s"
        return None

    def waited(self, walls_ms: Sequence[float], rested: int | None) -> int | None:
        """After how many frames a technique was no longer waited for; None while it is.

        Args:
            walls_ms: times of all frames of warm-up, in order, ms.
            rested: how many it took until it was at rest, None while it is not.
        """
        if self.warmup is not None:
            return 0
        return self.patience.spent(walls_ms) if rested is None else rested

    def image_frame(self) -> int:
        """The last of the scene's frames that is shown whatever the rules decide, but for caps on
        seconds. The scene's clock begins where a technique is no longer waited for, so that images
        are of the same frame in every configuration.
        """
        warmup = 2 * WARMUP_WINDOW if self.warmup is None else self.warmup
        return warmup + (self.least if self.frames is None else self.frames) - 1

    def expected(self, waits: bool = False) -> int:
        """Frames at most, warm-up included: for progress.

        Args:
            waits: whether the technique is waited for until it is at rest.
        """
        warmup = self.warmup_most if self.warmup is None else self.warmup
        if waits and self.warmup is None:
            warmup += self.patience.frames
        return warmup + (self.most if self.frames is None else self.frames)


def median_interval(
    times_ms: Sequence[float] | npt.NDArray[np.floating], confidence: float = 0.95
) -> tuple[float, float]:
    """The confidence interval of the median by order statistics (Le Boudec, "Performance
    Evaluation of Computer and Communication Systems", 2010, theorem 2.1), ms.

    nan where there are too few times for one (fewer than 6 at 95 %).
    """
    from scipy.stats import binom  # slow to load

    ordered = np.sort(np.asarray(times_ms, np.float64))
    n = len(ordered)
    chance = binom.cdf(np.arange(n // 2 + 1), n, 0.5)
    outside = int(np.count_nonzero(chance <= (1 - confidence) / 2))
    if not outside:
        return NAN, NAN
    return float(ordered[outside - 1]), float(ordered[n - outside])
