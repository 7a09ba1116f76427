"""A technique run under standing lights until its indirect light stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.errors import CannotRun, GibenchError
from gibench.measure.plan.configuration import Configuration
from gibench.measure.runfolder.results import SKIPPED, ConfigurationResult
from gibench.measure.session.enqueue import PreparedPass, enqueue_frame, prepare_passes
from gibench.measure.session.setup import LoopOptions, set_up
from gibench.measure.session.shared import Shared
from gibench.measure.statistics.summary import Summary, summarize
from gibench.progress import progress
from gibench.scene.lightmap import Lightmap
from gibench.techniques.technique import KnowsItsCover, Technique

FIRST_CHECK = 16
"""Frames after which the indirect light is looked at first, and then whenever they double; a
camera's flight comes before them."""


@dataclass(frozen=True)
class SettleOptions:
    """When a technique counts as settled.

    Attributes:
        frames: run at most.
        tolerance: settled when the mean irradiance moved by no more than this share, and all
            receivers together (root mean square) by no more than ``jitter`` of the mean, while the
            frames doubled.
        jitter: see there; what a technique's own noise may do.
        timed: the times of this many last frames count.
    """

    frames: int = 512
    tolerance: float = 0.005
    jitter: float = 0.25
    timed: int = 30


@dataclass
class Settled:
    """What became of a configuration.

    Attributes:
        result: counts, memory and notes.
        lightmap: the receivers.
        irradiance: (n, 3) of the last frame, W/m2.
        covered: (n,) receivers the technique has anything to say of; the others it calls black.
        frames: run in all.
        settled: whether it stood still at the end.
        change: of the mean irradiance in the last doubling of frames, as a share.
        times: wall times of the last frames.
    """

    result: ConfigurationResult
    lightmap: Lightmap = field(repr=False)
    irradiance: Doubles = field(repr=False)
    covered: npt.NDArray[np.bool_] = field(repr=False)
    frames: int
    settled: bool
    change: float
    times: Summary


def settle(
    configuration: Configuration,
    options: SettleOptions,
    loop: LoopOptions,
    shared: Shared,
    cl_device: Any,
    among: str = "",
) -> Settled:
    """Run ``configuration`` until it is settled or has run all its frames.

    Args:
        configuration: what to run.
        options: when to stop.
        loop: image, camera and seed as in a run; without ``fit``; its frames do not count.
        shared: scenes whose lights stand still.
        cl_device: where to run.
        among: what it is among others, for the progress bar, as in "3 of 18".

    Raises:
        CannotRun: the profile, device or budget forbids it or one of its passes.
        GibenchError: a pass failed, or the irradiance is not finite.
    """
    refuse_motion(loop)
    scene = shared.scene(configuration.scene)
    result = ConfigurationResult(configuration, scene.name)
    device, technique = set_up(result, loop, shared, cl_device)
    try:
        prepared = prepare_passes(technique, configuration.workgroup_size)
        refuse_missing(prepared)
        title = f"settling {configuration.label(scene.name)}" + (f" ({among})" if among else "")
        with progress(title, options.frames) as advance:
            frames, times = 0, []
            watch = _Watch(options, _next=loop.flight.frames + FIRST_CHECK)
            while frames < options.frames:
                times.append(enqueue_frame(technique, prepared, frames).wall_ms)
                frames += 1
                advance(1)
                if watch.asks(frames) and watch.stands_still(_irradiance(technique)):
                    break
            result.memory_bytes = device.memory.peak_bytes
            result.counts, result.frames = dict(technique.counts()), frames
            irradiance = _irradiance(technique)
            covered = np.ones(len(irradiance), bool)
            if isinstance(technique, KnowsItsCover):
                covered = technique.covered()
    finally:
        device.queue.finish()
    lightmap = shared.lightmap(configuration.scene, configuration.receivers or scene.receivers)
    warm = times[min(3, len(times) - 1) :][-options.timed :]
    return Settled(
        *(result, lightmap, irradiance, covered),
        *(frames, watch.settled, watch.change, summarize(warm)),
    )


def refuse_motion(loop: LoopOptions) -> None:
    """Refuse objects that move: nothing settles, and there is no truth to settle on.

    Raises:
        CannotRun: they do.
    """
    if loop.motion.moves:
        raise CannotRun(
            "light settles, and has a path-traced truth, only where all objects rest",
            where="--motion",
            mend="leave it out, or measure times with gibench run --motion",
        )


@dataclass
class _Watch:
    """Compares the irradiance whenever the frames have doubled."""

    options: SettleOptions
    settled: bool = False
    change: float = float("nan")
    _next: int = FIRST_CHECK
    _before: Doubles | None = None

    def asks(self, frames: int) -> bool:
        """Whether the irradiance is to be looked at now."""
        return frames in (self._next, self.options.frames)

    def stands_still(self, now: Doubles) -> bool:
        """Take ``now`` (n, 3) and tell whether it is settled."""
        before, self._before = self._before, now
        self._next *= 2
        if before is None:
            return False
        mean = float(np.abs(now).mean())
        if mean == 0:
            self.change, self.settled = 0.0, not before.any()
            return self.settled
        self.change = float((now - before).mean()) / mean
        off = float(np.sqrt(((now - before) ** 2).mean())) / mean
        self.settled = abs(self.change) <= self.options.tolerance and off <= self.options.jitter
        return self.settled


def refuse_missing(prepared: Sequence[PreparedPass]) -> None:
    """Refuse a frame without all its passes.

    Raises:
        CannotRun: the profile or device forbids one.
        GibenchError: one failed.
    """
    for item in prepared:
        if item.status != "ok":
            kind = CannotRun if item.status == SKIPPED else GibenchError
            raise kind(f"{item.name}: {item.problem}")


def _irradiance(technique: Technique) -> Doubles:
    """Of all receivers.

    Raises:
        GibenchError: some of it is not finite.
    """
    values: npt.NDArray[Any] = np.asarray(technique.indirect_irradiance())
    broken = int((~np.isfinite(values)).any(axis=-1).sum())
    if broken:
        raise GibenchError(
            f"the indirect irradiance of {broken:,} of {len(values):,} receivers is not finite"
        )
    return values.astype(np.float64)
