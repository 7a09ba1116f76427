"""``--workgroup-size auto``: each pass's best work-group size inside the profile, by measurement.

Every power of two times the SIMD width up to the profile's maximum is tried with the whole
technique, all sizes taking turns frame by frame in an order drawn under the seed, and every pass is
judged by the median of its device times, once the technique is at rest. Passes that any size fits
(their launches count work-items and share no local memory) then take each its own best; what the
others depend on is decided when the technique is created, so they take the size that is best for
their sum. A size must be faster than the profile's own by more than ``CLEAR`` to replace it: below
that it is noise.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl

from gibench.device import Device
from gibench.device.source import tree_hash
from gibench.errors import CannotRun, GibenchError
from gibench.measure.plan.stopping import Patience
from gibench.measure.runfolder.folder import write_atomically
from gibench.measure.session.rest import RestWatch
from gibench.measure.session.session import Session, with_size
from gibench.measure.session.shared import Shared
from gibench.profiles import DeviceProfile
from gibench.progress import progress
from gibench.resources import data
from gibench.techniques.job import Job
from gibench.techniques.parts.frame_passes import frame_passes
from gibench.techniques.technique import Pass

CLEAR = 0.03
WARMUP, FRAMES = 4, 15
_VERSION = 2


@dataclass(frozen=True)
class Sweep:
    """What was measured and chosen.

    Attributes:
        base: the size the technique is created with.
        chosen: by pass, its size.
        times_ms: by pass, by size, the median device time; sizes a pass cannot run at are left out.
        free: the passes that may take a size of their own.
        rest: what a reader must know of times that were not taken at rest; empty where they were.
        remembered: whether it comes from an earlier run.
    """

    base: int
    chosen: dict[str, int]
    times_ms: dict[str, dict[int, float]]
    free: tuple[str, ...]
    rest: str = ""
    remembered: bool = False

    def notes(self) -> list[str]:
        """The whole sweep in words, one line a pass."""
        when = "remembered from an earlier run" if self.remembered else "measured in this run"
        lines = []
        for name, times in self.times_ms.items():
            swept = ", ".join(f"{size}: {ms:.3f}" for size, ms in times.items())
            bound = "" if name in self.free else ", shared with the passes that depend on it"
            lines.append(
                f"work-group {self.chosen[name]} for {name}{bound} ({when}; median ms by size: "
                f"{swept})"
            )
        return [*lines, f"work-group sizes were chosen {self.rest}"] if self.rest else lines

    def record(self) -> dict[str, Any]:
        """As ``run.json`` has it."""
        return asdict(self)


def candidate_sizes(profile: DeviceProfile) -> list[int]:
    """Powers of two times the SIMD width up to the profile's maximum, and its default."""
    size, sizes = profile.simd_width, {profile.default_workgroup_size}
    while size <= profile.max_workgroup_size:
        sizes.add(size)
        size *= 2
    return sorted(size for size in sizes if not profile.workgroup_size_problem(size))


def tune(
    job: Job,
    shared: Shared,
    cl_device: Any,
    *,
    fit: bool = False,
    patience: Patience | None = None,
) -> Sweep:
    """The sizes of ``job``'s passes: remembered, or measured and remembered.

    ``patience`` is how long it is waited for that the technique is at rest, all sizes together.

    They are remembered per device, driver, profile, kernel sources, scene and settings.

    Raises:
        GibenchError: the technique cannot be set up at any size.
    """
    path = _memory(job, shared, cl_device)
    if sweep := _remembered(path):
        return sweep
    sweep = measure_sweep(job, shared, cl_device, fit=fit, patience=patience)
    write_atomically(path, (json.dumps(sweep.record(), indent=1) + "\n").encode())
    return sweep


def measure_sweep(
    job: Job,
    shared: Shared,
    cl_device: Any,
    *,
    fit: bool = False,
    patience: Patience | None = None,
) -> Sweep:
    """Try every size (see the head of this module).

    Raises:
        GibenchError: the technique cannot be set up at any size.
    """
    default = job.profile.default_workgroup_size
    alive: dict[int, Session] = {}
    refusal: CannotRun | None = None
    free: tuple[str, ...] = ()
    for size in candidate_sizes(job.profile):
        try:
            session = Session.open(with_size(job, size), shared, cl_device, fit=fit)
        except CannotRun as error:  # a size may need more memory than another
            refusal = error
            continue
        session.prepare()
        session.compile()
        alive[size] = session
        free = tuple(
            item.name for item in frame_passes(session.technique) if _is_free(session.device, item)
        )
    if not alive:
        assert refusal is not None
        raise refusal
    times: dict[str, dict[int, list[float]]] = {}
    rng = np.random.default_rng(job.seed)
    with progress("choosing work-group sizes", (WARMUP + FRAMES) * len(alive)) as advance:
        rest = _warm_up(alive, patience or Patience(), advance)
        for frame in range(rest.frames, rest.frames + FRAMES):
            for size in rng.permutation(list(alive)):
                measured = alive[int(size)].frame(frame).pass_ms
                advance(1)
                for name, ms in measured.items():
                    times.setdefault(name, {}).setdefault(int(size), []).append(ms)
    medians = {
        name: {size: float(np.median(found[size])) for size in sorted(found)}
        for name, found in times.items()
    }
    return replace(choose(medians, free, default), rest=rest.warning())


def _warm_up(
    alive: Mapping[int, Session], patience: Patience, advance: Callable[[int], None]
) -> RestWatch:
    """Run the same frames of all sizes until all are at rest; the last that was."""
    watches = [RestWatch.over(session) for session in alive.values()]
    frames = 0
    while frames < WARMUP or (
        any(watch.waits for watch in watches)
        and not patience.over(frames, sum(watch.spent_ms for watch in watches))
    ):
        for watch in watches:
            watch.ran(watch.session.frame(frames).wall_ms)
            advance(1)
        frames += 1
    return max(watches, key=lambda watch: watch.waits)


def choose(
    times_ms: Mapping[str, Mapping[int, float]], free: tuple[str, ...], default: int
) -> Sweep:
    """The sizes to take, from every pass's median time at every size.

    Args:
        times_ms: by pass, by size.
        free: the passes that may take a size of their own.
        default: kept unless another is clearly better.
    """
    bound = {name: times for name, times in times_ms.items() if name not in free}
    sums = {
        size: sum(times[size] for times in bound.values())
        for size in sorted({size for times in times_ms.values() for size in times})
        if all(size in times for times in bound.values())
    }
    base = _best(sums, default) if bound and sums else default
    chosen = {
        name: _best(times, base) if name in free else base for name, times in times_ms.items()
    }
    return Sweep(base, chosen, {name: dict(times) for name, times in times_ms.items()}, free)


def _best(times: Mapping[int, float], default: int) -> int:
    best = min(times, key=lambda size: times[size])
    if default in times and times[best] >= (1 - CLEAR) * times[default]:
        return default
    return best


def _is_free(device: Device, item: Pass) -> bool:
    """Whether any size fits the pass: it counts work-items and shares no local memory."""
    try:
        launches = item.launches()
    except (GibenchError, cl.Error):  # it fails when it is prepared too, and is told there
        return False
    return all(
        one.groups is None
        and one.workgroup_size is None
        and one.local_bytes == 0
        and not device.built(one).asks_for_its_group(one.kernel)
        for one in launches
    )


def _memory(job: Job, shared: Shared, cl_device: Any) -> Path:
    scene = shared.scene(job.scene)
    key = {
        "version": _VERSION,
        "device": cl_device.name,
        "platform": cl_device.platform.version,
        "driver": cl_device.driver_version,
        "profile": job.profile.content_hash,
        "kernels": tree_hash(Path(str(data("kernels_cl")))),
        "technique": [job.technique, job.variant, job.layout, repr(job.settings)],
        "scene": [scene.content_hash(), job.receivers or scene.receivers],
        "image": [job.shot.width, job.shot.height],
    }
    if job.shot.motion.moves:
        key["motion"] = repr(job.shot.motion.motions(scene))
    name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()
    return shared.cache_dir / "workgroup-sizes" / f"{name}.json"


def _remembered(path: Path) -> Sweep | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return Sweep(
            base=int(content["base"]),
            chosen={name: int(size) for name, size in content["chosen"].items()},
            times_ms={
                name: {int(size): float(ms) for size, ms in times.items()}
                for name, times in content["times_ms"].items()
            },
            free=tuple(content["free"]),
            rest=str(content["rest"]),
            remembered=True,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
