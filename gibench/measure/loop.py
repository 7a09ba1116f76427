"""The frame loop: every configuration set up, warmed up, run and recorded."""

from __future__ import annotations

import gc
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np

from gibench.device import Device
from gibench.errors import CannotRun, GibenchError
from gibench.measure.configuration import Configuration
from gibench.measure.enqueue import FrameTimes, PreparedPass, enqueue_frame, prepare_passes
from gibench.measure.environment import without_paths
from gibench.measure.fit import FEWEST_RECEIVERS, Footprint, measure_demand
from gibench.measure.results import FAILED, OK, SKIPPED, ConfigurationResult, PassResult
from gibench.measure.run_folder import RunFolder
from gibench.measure.shared import Shared
from gibench.measure.view import choose_camera
from gibench.progress import progress
from gibench.techniques.registry import CreateContext
from gibench.techniques.technique import HasNotes, Technique

TakeImages = Callable[[ConfigurationResult, dict[str, Any]], None]


@dataclass(frozen=True)
class LoopOptions:
    """How configurations are run.

    Attributes:
        frames: measured per configuration, at least 1.
        warmup: run before them and not recorded.
        width: of the camera image, pixels.
        height: of the camera image, pixels.
        camera: number or name; None for the scene's first.
        fit: lower the receivers until a configuration fits its profile.
        seed: of every random choice.
        kernel_root: another kernel tree than the installed one.
    """

    frames: int = 30
    warmup: int = 3
    width: int = 1334
    height: int = 750
    camera: str | None = None
    fit: bool = False
    seed: int = 0
    kernel_root: Traversable | None = None


@dataclass
class Outcome:
    """What became of a run.

    Attributes:
        results: one per configuration, in order.
        interrupted: whether Ctrl-C ended it early.
        samples: stored, over all configurations.
    """

    results: list[ConfigurationResult]
    interrupted: bool = False
    samples: int = 0

    @property
    def first_error(self) -> BaseException | None:
        """The first thing that went wrong, if anything did."""
        return next((r.error for r in self.results if r.error is not None), None)


def run_configurations(
    configurations: Sequence[Configuration],
    options: LoopOptions,
    shared: Shared,
    cl_device: Any,
    folder: RunFolder,
    take_images: TakeImages | None = None,
) -> Outcome:
    """Run every configuration; samples go to ``folder`` as they come.

    One that cannot run is recorded with its reason and the others go on. Ctrl-C ends the run; what
    was measured until then is kept.

    Raises:
        BadInput: a scene or its camera is wrong, told before anything long.
        GibenchError: the samples cannot be written.
    """
    names = {}
    for configuration in configurations:
        scene = shared.scene(configuration.scene)
        choose_camera(scene, options.camera)
        names[configuration.scene] = scene.name
    outcome = Outcome([])
    folder.start_samples()
    for configuration in configurations:
        result = ConfigurationResult(configuration, names[configuration.scene], options.warmup)
        outcome.results.append(result)
        if outcome.interrupted:
            result.refuse(SKIPPED, "not reached: the run was interrupted")
            continue
        rows: list[tuple[Any, ...]] = []
        try:
            _run(result, options, shared, cl_device, rows, take_images)
        except KeyboardInterrupt:
            outcome.interrupted = True
            result.refuse(
                OK if result.frames else SKIPPED,
                f"interrupted after {result.frames} of {options.frames} frames",
            )
        except CannotRun as error:
            result.refuse(SKIPPED, without_paths(str(error)), error)
        except GibenchError as error:
            result.refuse(FAILED, without_paths(str(error)), error)
        except Exception as error:  # a fault in one configuration must not cost the others
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            result.refuse(FAILED, without_paths(reason), error)
        finally:
            folder.append_samples(rows)
            outcome.samples += len(rows)
            if result.error is not None:  # its frames would hold the device's buffers
                traceback.clear_frames(result.error.__traceback__)
            gc.collect()  # the device's buffers go before the next configuration's come
    return outcome


def _run(
    result: ConfigurationResult,
    options: LoopOptions,
    shared: Shared,
    cl_device: Any,
    rows: list[tuple[Any, ...]],
    take_images: TakeImages | None,
) -> None:
    device, technique = set_up(result, options, shared, cl_device)
    try:
        prepared = prepare_passes(technique, result.configuration.workgroup_size)
        result.counts = dict(technique.counts())
        result.passes = [
            PassResult(p.name, p.work, p.status, without_paths(p.problem or result.reason))
            for p in prepared
        ]
        complete = all(p.status == OK for p in prepared)
        if any(p.status == OK for p in prepared):
            _frames(result, options, technique, prepared, rows)
        result.memory_bytes = device.memory.peak_bytes
        if not complete:
            _tell_of_missing_passes(result, prepared)
            return
        _check_output(technique)
        if take_images is not None:
            take_images(result, technique.images())
    finally:
        device.queue.finish()


def set_up(
    result: ConfigurationResult, options: LoopOptions, shared: Shared, cl_device: Any
) -> tuple[Device, Technique]:
    """A fresh device held to the profile, and the technique on it.

    What a reader must know about the configuration is noted in ``result``.

    Raises:
        CannotRun: it does not fit the profile (with ``fit``: at no number of receivers).
    """
    configuration = result.configuration
    spec, settings, profile = configuration.spec, configuration.settings, configuration.profile
    scene = shared.scene(configuration.scene)
    camera = choose_camera(scene, options.camera)
    result.camera = camera.name
    asked = receivers = configuration.receivers or scene.receivers
    result.receivers_asked = asked
    footprint = Footprint(spec, scene, settings, options.width, options.height, profile)
    if options.fit:
        receivers = footprint.most_receivers(asked) or asked
    footprint.check(receivers)
    while True:
        lightmap, baked = shared.baked(spec, settings, configuration.scene, receivers)
        context = CreateContext(
            device=Device(profile, cl_device, options.kernel_root),
            scene=scene,
            lightmap=lightmap,
            settings=settings,
            baked=baked,
            variant=configuration.variant,
            workgroup_size=configuration.workgroup_size,
            width=options.width,
            height=options.height,
            camera=camera,
            seed=options.seed,
        )
        try:
            technique = spec.create(context)
            break
        except CannotRun as error:
            demand = measure_demand(spec, context)
            fewer = demand.receivers_that_fit(profile, receivers) if demand else 0
            if not options.fit or fewer < FEWEST_RECEIVERS:
                raise demand.refusal(spec, scene, profile, receivers) if demand else error from None
            receivers = fewer
    if receivers != asked:
        result.reason = f"fitted: aims for {receivers:,} receivers instead of {asked:,}"
        result.notes.append(f"{result.reason}, so that it fits profile {profile.name}")
    if isinstance(technique, HasNotes):
        result.notes += technique.notes()
    return context.device, technique


def _frames(
    result: ConfigurationResult,
    options: LoopOptions,
    technique: Technique,
    prepared: Sequence[PreparedPass],
    rows: list[tuple[Any, ...]],
) -> None:
    """Warm up and measure; one row per pass and frame."""
    keys = tuple(result.keys().values())
    counts = result.counts
    title = result.configuration.label(result.scene)
    with progress(title, options.warmup + options.frames) as advance:
        for frame in range(options.warmup + options.frames):
            times = enqueue_frame(technique, prepared, frame)
            if frame >= options.warmup:
                rows.extend(_rows(keys, counts, times, frame, result.configuration.number))
                result.frames += 1
            advance(1)


def _rows(
    keys: tuple[Any, ...], counts: dict[str, int], times: FrameTimes, frame: int, number: int
) -> list[tuple[Any, ...]]:
    tail = (counts.get("probes"), counts.get("receivers"), f"{times.wall_ms:.6f}", number)
    return [(*keys, name, frame, f"{ms:.6f}", *tail) for name, ms in times.pass_ms.items()]


def _tell_of_missing_passes(result: ConfigurationResult, prepared: Sequence[PreparedPass]) -> None:
    """A frame without all its passes is no frame: its time is left blank, with the reason."""
    missing = [p for p in prepared if p.status != OK]
    status = FAILED if any(p.status == FAILED for p in missing) else SKIPPED
    first = missing[0]
    reason = without_paths(f"{first.name}: {first.problem}")
    if len(missing) > 1:
        reason += f" (and {len(missing) - 1} more passes)"
    if result.reason:
        reason = f"{result.reason}; {reason}"
    error = GibenchError(reason) if status == FAILED else CannotRun(reason)
    result.status, result.reason, result.error = status, reason, error


def _check_output(technique: Technique) -> None:
    """Times of a frame that computes nonsense are worth nothing.

    Raises:
        GibenchError: the indirect irradiance of some receiver is not finite.
    """
    irradiance = np.asarray(technique.indirect_irradiance())
    broken = int((~np.isfinite(irradiance)).any(axis=-1).sum()) if irradiance.size else 0
    if broken:
        raise GibenchError(
            f"the indirect irradiance of {broken:,} of {len(irradiance):,} receivers is not finite"
        )
