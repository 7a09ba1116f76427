"""The frame loop: configurations set up, warmed up, run in turns and recorded."""

from __future__ import annotations

import gc
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyopencl as cl

from gibench.errors import CannotRun, GibenchError
from gibench.measure.machine.environment import without_paths
from gibench.measure.plan.grid import job_label
from gibench.measure.plan.stopping import Plan
from gibench.measure.runfolder.axes import Axis, steady_counts
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.runfolder.results import FAILED, OK, SKIPPED, JobResult, PassResult
from gibench.measure.session.beside import ConstantWork
from gibench.measure.session.cold import CacheFlush
from gibench.measure.session.enqueue import FrameTimes, PreparedPass
from gibench.measure.session.interrupts import Interrupts
from gibench.measure.session.live import Live, Loop, RunOutcome, TakeImages
from gibench.measure.session.rest import RestWatch
from gibench.measure.session.session import Session, check_job, with_size
from gibench.measure.session.shared import Shared
from gibench.measure.session.tune import tune
from gibench.progress import progress
from gibench.techniques.job import AUTO, Job
from gibench.techniques.registry import declared_counts, find_technique, nothing_baked

BLOCK = 5
"""Frames a configuration runs before the next one's turn: caches are its own again after one."""
MOST_ALIVE = 8
"""Configurations that take turns at most."""
ALIVE_SHARE = 0.25
"""Share of the free host memory (and of the device's) that they may take together."""


def run_jobs(
    jobs: Sequence[Job],
    plan: Plan,
    shared: Shared,
    cl_device: Any,
    folder: RunFolder,
    *,
    axes: Sequence[Axis] = (),
    fit: bool = False,
    take_images: TakeImages | None = None,
    flush: CacheFlush | None = None,
    first: int = 1,
) -> RunOutcome:
    """Run every job; samples go to ``folder`` as they come.

    As many as fit into memory are alive at once and take turns in blocks of frames, in an order
    drawn anew every round under the seed, so that a drift of the machine does not favour the last.
    One that cannot run is recorded with its reason and the others go on. Ctrl-C or a full disk ends
    the run; what was measured until then is kept.

    Args:
        jobs: to run, those that share a bake next to each other.
        plan: how many frames.
        shared: what is baked.
        cl_device: the OpenCL device.
        folder: where samples go.
        axes: settings with a column of their own.
        fit: lower the receivers until a job fits its profile.
        take_images: is given every finished configuration's images.
        flush: is called before every frame, where caches are to be cold.
        first: number of the first configuration.

    Raises:
        BadInput: a scene, its camera or settings for it are wrong; raised before any long work.
        GibenchError: not even the head of the samples can be written.
    """
    names = {job.scene: check_job(job, shared).name for job in jobs}
    outcome = RunOutcome([])
    folder.start_samples([axis.column for axis in axes], steady_counts(declared_counts()))
    rng = np.random.default_rng(jobs[0].seed if jobs else 0)
    with Interrupts() as interrupts:
        loop = Loop(
            plan=plan,
            fit=fit,
            axes=axes,
            shared=shared,
            cl_device=cl_device,
            folder=folder,
            outcome=outcome,
            take_images=take_images,
            flush=flush,
            rng=rng,
            interrupts=interrupts,
        )
        alive: list[Live] = []
        group = 1
        for number, job in enumerate(jobs, first):
            result = JobResult(number, job, names[job.scene], group=group)
            outcome.results.append(result)
            outcome.interrupted |= interrupts.came()
            if outcome.ended:
                result.refuse(SKIPPED, _not_reached(outcome))
                continue
            with _guarded(loop, result):
                alive.append(_bring_up(loop, result))
            if outcome.ended or _full(alive, cl_device):
                _take_turns(loop, alive)
                _let_go(alive, outcome)
                group += 1
        _take_turns(loop, alive)
        _let_go(alive, outcome)
    outcome.interrupted |= interrupts.came()
    return outcome


def _not_reached(outcome: RunOutcome) -> str:
    why = "the run was interrupted" if outcome.interrupted else "samples could not be stored"
    return f"not reached: {why}"


def _full(alive: Sequence[Live], cl_device: Any) -> bool:
    import psutil

    there = min(int(psutil.virtual_memory().available), int(cl_device.global_mem_size))
    taken = sum(live.session.memory_bytes for live in alive)
    return len(alive) >= MOST_ALIVE or taken > ALIVE_SHARE * there


@contextmanager
def _guarded(loop: Loop, result: JobResult) -> Iterator[None]:
    """Whatever goes wrong inside becomes the configuration's reason; the others go on."""
    try:
        with loop.interrupts.work():
            yield
    except KeyboardInterrupt:
        loop.outcome.interrupted = True
        _mark_interrupted(result, loop.plan)
    except CannotRun as error:
        result.refuse(SKIPPED, without_paths(str(error)), error)
    except GibenchError as error:
        result.refuse(FAILED, without_paths(str(error)), error)
    except Exception as error:  # a fault in one configuration must not cost the others
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        result.refuse(FAILED, without_paths(reason), error)
    if result.error is not None:  # its frames would hold the device's buffers
        traceback.clear_frames(result.error.__traceback__)
        gc.collect()


def _mark_interrupted(result: JobResult, plan: Plan) -> None:
    asked = plan.frames
    of = "" if asked is None else f" of {asked}"
    reason = f"interrupted after {result.frames}{of} frames"
    if not result.frames and result.warmup:
        reason += f", {result.warmup} of warm-up"
    result.refuse(OK if result.frames else SKIPPED, reason)


def _bring_up(loop: Loop, result: JobResult) -> Live:
    job, sweep = result.job, None
    if job.workgroup_size == AUTO:
        patience = loop.plan.patience
        sweep = tune(job, loop.shared, loop.cl_device, fit=loop.fit, patience=patience)
        result.base_size, result.sweep = sweep.base, sweep.record()
        job = with_size(job, sweep.base)
    session = Session.open(job, loop.shared, loop.cl_device, fit=loop.fit)
    result.receivers_asked = session.receivers_asked
    result.camera = session.world.camera.name
    world, spec = session.world, find_technique(job.technique)
    if spec.stages is not nothing_baked:
        motion = world.motion
        moving = motion.triangles if motion is not None and motion.moves else None
        result.bake_seconds = loop.shared.bake_seconds(
            spec, job.settings, world.scene, world.lightmap, moving
        )
    result.reason = session.fitted
    chosen = sweep.chosen if sweep else {}
    session.prepare(chosen)
    session.compile()
    result.notes += session.notes
    if sweep is not None:
        result.notes += sweep.notes()
    result.counts = session.counts()
    result.passes = [
        PassResult(
            name=p.name,
            work=p.work,
            status=p.status,
            reason=without_paths(p.problem or result.reason),
            workgroup_size=chosen.get(p.name),
            stage=p.stage,
        )
        for p in session.prepared
    ]
    result.memory_bytes = session.memory_bytes
    return Live(result, session, RestWatch.over(session))


def _take_turns(loop: Loop, alive: list[Live]) -> None:
    """Warm up and measure the configurations of a group."""
    outcome = loop.outcome
    title = job_label(alive[0].result.job, alive[0].result.scene) if alive else ""
    if len(alive) > 1:
        title = f"{len(alive)} configurations in turns"
    active = list(alive)
    frames = sum(loop.plan.expected(live.rest.waits) for live in active)
    with progress(title, frames) as advance:
        while active and not outcome.ended:
            for turn in loop.rng.permutation(len(active)):
                live, over = active[turn], True
                with _guarded(loop, live.result):
                    over = not live.runs or _block(loop, live, advance)
                    if over:
                        _finish(loop, live)
                _store(loop, live)
                outcome.interrupted |= loop.interrupts.came()
                if outcome.ended:
                    break
                if over:
                    active[turn] = None  # type: ignore[call-overload]
            active = [live for live in active if live is not None]
    for live in active:
        if outcome.interrupted and not live.result.reason:
            _mark_interrupted(live.result, loop.plan)
        elif outcome.write_error is not None:
            live.result.refuse(FAILED, str(outcome.write_error), outcome.write_error)
    for live in alive:
        live.session.close()
        if live.result.frames and live.result.status == OK:
            with _guarded(loop, live.result):
                _count_work(live)


def _count_work(live: Live) -> None:
    """Replace what was declared ahead by what the last frame is found to have done."""
    live.result.counts = live.session.counts()
    counted = live.session.counted()
    for told in live.result.passes:
        told.work = counted.get(told.name, told.work)


def _let_go(alive: list[Live], outcome: RunOutcome) -> None:
    """Free the devices' buffers before the next group's come; errors hold frames that hold them."""
    alive.clear()
    for result in outcome.results:
        if result.error is not None:
            traceback.clear_frames(result.error.__traceback__)
    gc.collect()


def _block(loop: Loop, live: Live, advance: Callable[[int], None]) -> bool:
    """Run one block of frames; whether the configuration is measured enough."""
    plan, result, rest = loop.plan, live.result, live.rest
    for _ in range(BLOCK):
        live.wait(plan)
        warm = plan.warm(live.warming_ms, live.waited)
        if loop.flush is not None:
            loop.flush()
        frame = live.ran
        times = live.session.frame(frame)
        advance(1)
        if _shows_image(loop, live, frame):
            _take_images(loop, live, frame)
        if not warm:
            live.warming_ms.append(times.wall_ms)
            rest.ran(times.wall_ms)
            result.warmup = len(live.warming_ms)
            _tell_rest(result, rest)
            continue
        live.walls_ms.append(times.wall_ms)
        live.rows.extend(_rows(result, loop.axes, times, frame))
        result.frames += 1
        _time_beside(loop, live, times)
        if why := plan.enough(live.walls_ms):
            result.stopped = why
            return True
    return False


def _time_beside(loop: Loop, live: Live, times: FrameTimes) -> None:
    """Time constant work after a frame of a flight or of objects that move, and note what it ran
    itself: these frames differ, so that times alone cannot tell a long one from one held up.
    """
    shot = live.result.job.shot
    if not (shot.flight.frames or shot.motion.moves):
        return
    if live.beside is None:
        recent = [*live.warming_ms, *live.walls_ms][-BLOCK:]
        live.beside = ConstantWork(float(np.median(recent)), loop.cl_device)
    live.result.beside_ms.append(live.beside())
    on_cpu = loop.cl_device.type & cl.device_type.CPU
    live.result.own_ms.append(times.cpu_ms if on_cpu else sum(times.pass_ms.values()))


def _tell_rest(result: JobResult, rest: RestWatch) -> None:
    result.rest = rest.in_words()
    result.frames_to_rest, result.ms_to_rest = rest.frames_to_rest, rest.ms_to_rest


def _rows(
    result: JobResult, axes: Sequence[Axis], times: FrameTimes, frame: int
) -> list[tuple[Any, ...]]:
    """One row per pass."""
    sizes = {p.name: p.workgroup_size for p in result.passes if p.workgroup_size}
    counts = [result.counts.get(name) for name in (*steady_counts(declared_counts()), "receivers")]
    tail = (*counts, f"{times.wall_ms:.6f}", result.number)
    rows = []
    for name, ms in times.pass_ms.items():
        keys = result.keys(axes, sizes.get(name)).values()
        rows.append((*keys, name, frame, f"{ms:.6f}", *tail))
    return rows


def _store(loop: Loop, live: Live) -> None:
    """Append the samples; a disk that refuses ends the run."""
    try:
        loop.folder.append_samples(live.rows)
        loop.outcome.samples += len(live.rows)
    except GibenchError as error:
        loop.outcome.write_error = error
        live.result.refuse(FAILED, without_paths(str(error)), error)
    live.rows.clear()


def _finish(loop: Loop, live: Live) -> None:
    result = live.result
    result.memory_bytes = live.session.memory_bytes
    if any(p.status != OK for p in live.session.prepared):
        _tell_of_missing_passes(result, live.session.prepared)
        return
    live.session.irradiance()  # times of a frame that computes nonsense are worth nothing
    live.rest.look_again(live.ran)
    _tell_rest(result, live.rest)
    result.reason = "; ".join(filter(None, (result.reason, live.rest.warning())))
    if loop.take_images is not None and not live.pictured:
        frame = live.ran - 1
        while live.session.world.moves and not _shows_image(loop, live, frame):
            frame += 1  # a cap on seconds came first: on to what all others show, untimed
            live.session.frame(frame)
        _take_images(loop, live, frame)


def _shows_image(loop: Loop, live: Live, frame: int) -> bool:
    """Whether ``frame`` shows what the images of all configurations show."""
    begun = live.waited is not None
    return begun and live.session.world.clock.shows(frame) == loop.plan.image_frame()


def _take_images(loop: Loop, live: Live, frame: int) -> None:
    """Give away the images of ``frame``, just run, where it is whole."""
    if loop.take_images is not None and all(p.status == OK for p in live.session.prepared):
        loop.take_images(live.result, live.session.images())
        live.result.pictured = live.session.world.clock.shows(frame)
    live.pictured = True


def _tell_of_missing_passes(result: JobResult, prepared: Sequence[PreparedPass]) -> None:
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
