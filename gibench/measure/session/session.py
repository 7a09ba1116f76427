"""A job set up and run, frame by frame: what every command and study does with a technique."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources.abc import Traversable
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.device import Device
from gibench.errors import BadInput, CannotRun, GibenchError
from gibench.measure.machine.environment import without_paths
from gibench.measure.plan.fit import FEWEST_RECEIVERS, Footprint, demand_of, has_receivers
from gibench.measure.plan.grid import job_label
from gibench.measure.plan.view import choose_camera
from gibench.measure.session.compiling import compile_launches
from gibench.measure.session.enqueue import (
    FrameTimes,
    PreparedPass,
    enqueue_frame,
    prepare_passes,
)
from gibench.measure.session.shared import Shared
from gibench.scene.model import Scene
from gibench.techniques.job import Job, Known, World
from gibench.techniques.registry import (
    Follows,
    TechniqueSpec,
    find_technique,
    left_out,
    techniques,
)
from gibench.techniques.technique import (
    FloatArray,
    HasNotes,
    KnowsItsCover,
    Technique,
    Work,
)

_LOG = logging.getLogger(__name__)


@dataclass
class Session:
    """A job on its device: opened, prepared, run frame by frame, read and closed.

    Attributes:
        job: what is asked.
        world: what is seen.
        device: a fresh one, held to the job's profile.
        technique: set up on it.
        receivers_asked: what was aimed for, before it was fitted to the profile.
        fitted: what was lowered so that it fits the profile, in words; empty where nothing was.
        notes: what a reader of its figures must know.
        prepared: its passes, once :meth:`prepare` was called.
    """

    job: Job
    world: World
    device: Device
    technique: Technique
    receivers_asked: int
    fitted: str = ""
    notes: list[str] = field(default_factory=list)
    prepared: list[PreparedPass] = field(default_factory=list, repr=False)
    _sizes: dict[str, int] = field(default_factory=dict, repr=False)

    @staticmethod
    def open(
        job: Job,
        shared: Shared,
        cl_device: Any,
        *,
        fit: bool = False,
        kernel_root: Traversable | None = None,
    ) -> Session:
        """Load and bake what ``job`` needs and set its technique up on a fresh device.

        Args:
            job: what is asked.
            shared: what is loaded and baked.
            cl_device: executes.
            fit: lower the receivers until it fits its profile.
            kernel_root: another kernel tree than the installed one.

        Raises:
            CannotRun: it does not fit the profile (with ``fit``: at no number of receivers), or
                cannot follow objects that move.
            GibenchError: something cannot be loaded or baked.
        """
        spec, scene, shot = find_technique(job.technique), shared.scene(job.scene), job.shot
        camera = choose_camera(scene, shot.camera)
        flight, motion = shot.flight.of(scene, camera), shot.motion.of(scene)
        moves = motion is not None and motion.moves
        if moves and Follows.DIRECT_LIGHT not in spec.follows:
            raise _stands_still(spec)
        if moves:
            try:
                spec.check_moving(job.settings)
            except BadInput as error:  # of several configurations the others run
                raise CannotRun(error.what, where=error.where, mend=error.mend) from error
        remarks = [
            *spec.remarks(job, scene, camera),
            *spec.flaws(job, scene, camera),
            *left_out(spec, job.settings, scene),
        ]
        _tell(spec, scene, remarks)
        asked = receivers = job.receivers or scene.receivers
        footprint = Footprint(spec, Known(job, scene, receivers, motion=motion))
        if fit:
            receivers = footprint.most_receivers(asked) or asked
        footprint.check(receivers)
        moving = motion.triangles if motion is not None and motion.moves else None
        lightmap = shared.lightmap(job.scene, receivers)
        of_bake = spec.bake_remarks(job, shared.context(job.settings, scene, lightmap, moving))
        _tell(spec, scene, of_bake)
        remarks += of_bake
        while True:
            lightmap, baked = shared.baked(spec, job.settings, job.scene, receivers, moving)
            if motion is not None and motion.held is not None:
                lightmap = motion.lightmap_in(scene, lightmap, motion.held)
            world = World(scene, lightmap, baked, camera, flight, motion)
            device = Device(job.profile, cl_device, kernel_root, job.layout)
            try:
                technique = spec.create(device, job, world)
                break
            except CannotRun as error:
                demand = demand_of(spec, job, world, device)
                fewer = 0
                if demand is not None and has_receivers(spec):
                    fewer = demand.receivers_that_fit(job.profile, receivers)
                if not fit or fewer < FEWEST_RECEIVERS:
                    told = demand and demand.refusal(spec, scene, job.profile, receivers)
                    raise told or error from None
                receivers = fewer
        session = Session(job, world, device, technique, asked)
        if receivers != asked:
            session.fitted = f"fitted: aims for {receivers:,} receivers instead of {asked:,}"
            session.notes.append(f"{session.fitted}, so that it fits profile {job.profile.name}")
        session.notes += remarks
        if motion is not None:
            session.notes.append(motion.note())
            if moves and Follows.INDIRECT_LIGHT not in spec.follows:
                session.notes.append("its indirect light stays that of the scene at rest")
        if isinstance(technique, HasNotes):
            session.notes += technique.notes()
        return session

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def prepare(self, sizes: Mapping[str, int] | None = None, *, whole: bool = False) -> None:
        """Build every pass: kernels made and their arguments set once, limits checked.

        A pass that cannot run has its reason in ``prepared``, and the others go on.

        Args:
            sizes: work-group sizes by pass, where they are not the job's.
            whole: refuse a frame without all its passes.

        Raises:
            CannotRun: with ``whole``, where the profile or device forbids a pass.
            GibenchError: with ``whole``, where a pass failed.
        """
        self._sizes = dict(sizes or {})
        self.prepared = prepare_passes(self.technique, self.job.group_size, self._sizes)
        if whole:
            refuse_missing(self.prepared)

    def compile(self) -> None:
        """Have every kernel compiled for its launch, so that no frame does it: to be called once
        the passes are prepared (see :mod:`gibench.measure.session.compiling`).

        Where there is no room for a second technique, or it fails, the first frames compile, which
        is logged and among ``notes``.
        """
        try:
            spec = find_technique(self.job.technique)
            twin = spec.create(self.device.beside(), self.job, self.world)
            compile_launches(twin, prepare_passes(twin, self.job.group_size, self._sizes))
        except Exception as error:  # a fault of the technique is told by its own first frame too
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            note = f"kernels were not compiled ahead, its first frames did that ({reason})"
            _LOG.warning("%s: %s", job_label(self.job, self.world.scene.name), note)
            self.notes.append(without_paths(note))

    def size_of(self, name: str) -> int:
        """The work-group size of the pass ``name``."""
        return self._sizes.get(name, self.job.group_size)

    def frame(self, number: int) -> FrameTimes:
        """Run frame ``number`` with every pass that can run, and wait for its end."""
        return enqueue_frame(self.technique, self.prepared, number)

    def irradiance(self) -> Doubles:
        """Indirect irradiance (n, 3) at the receivers after the last frame, W/m2.

        Raises:
            GibenchError: some of it is not finite.
        """
        values: npt.NDArray[Any] = np.asarray(self.technique.indirect_irradiance())
        broken = int((~np.isfinite(values)).any(axis=-1).sum()) if values.size else 0
        if broken:
            raise GibenchError(
                f"the indirect irradiance of {broken:,} of {len(values):,} receivers is not finite"
            )
        return values.astype(np.float64)

    def covered(self) -> npt.NDArray[np.bool_]:
        """Which receivers (n,) the technique has anything to say of."""
        if isinstance(self.technique, KnowsItsCover):
            return np.asarray(self.technique.covered())
        return np.ones(len(self.world.lightmap.receivers), bool)

    def images(self) -> dict[str, FloatArray]:
        """Linear radiance images (h, w, 3) of the last frame by title."""
        return self.technique.images()

    def counts(self) -> dict[str, int]:
        """Probes, receivers, surfels: those that apply, after the last frame."""
        return dict(self.technique.counts())

    def counted(self) -> dict[str, Work]:
        """The work of the passes whose work only the last frame can tell. Overwrites the image."""
        return {
            item.name: item.counted(self.size_of(item.name))
            for item in self.prepared
            if item.counted is not None and item.status == "ok"
        }

    @property
    def memory_bytes(self) -> int:
        """The most that was allocated at once."""
        return self.device.memory.peak_bytes

    def close(self) -> None:
        """Wait until the device is idle; its buffers go with the session."""
        self.device.queue.finish()


def _tell(spec: TechniqueSpec, scene: Scene, remarks: Sequence[str]) -> None:
    for remark in remarks:
        _LOG.warning("%s on %s: %s", spec.name, scene.name, remark)


def check_job(job: Job, shared: Shared) -> Scene:
    """Find what is wrong with a job before anything long; its scene.

    Raises:
        BadInput: its scene, camera, camera path or motion is wrong, or the settings do not suit the
            scene or objects that move.
    """
    scene = shared.scene(job.scene)
    choose_camera(scene, job.shot.camera)
    job.shot.flight.check()
    motion, spec = job.shot.motion.of(scene), find_technique(job.technique)
    spec.check(scene, job.settings)
    if motion is not None and motion.moves:
        spec.check_moving(job.settings)
    return scene


def with_size(job: Job, size: int) -> Job:
    """``job`` with ``size`` work-items per group."""
    return replace(job, workgroup_size=size)


def refuse_missing(prepared: Sequence[PreparedPass]) -> None:
    """Refuse a frame without all its passes.

    Raises:
        CannotRun: the profile or device forbids one.
        GibenchError: one failed.
    """
    for item in prepared:
        if item.problem:
            kind = CannotRun if item.status == "skipped" else GibenchError
            raise kind(f"{item.name}: {item.problem}")


def _stands_still(spec: TechniqueSpec) -> CannotRun:
    able = sorted(one.name for one in techniques().values() if Follows.DIRECT_LIGHT in one.follows)
    return CannotRun(
        f"{spec.name} cannot follow objects that move: what it bakes holds for the scene at rest",
        mend=f"run it without --motion, or {', '.join(able)} with it",
    )
