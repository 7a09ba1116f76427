"""Running a bake: what is stored is read, the rest is computed by an executor and stored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, sleep
from typing import Any

from gibench.bake.stage import Keep, Stage, Unit
from gibench.bake.store import BakeStore
from gibench.progress import progress
from gibench.work import Executor, Serial, Threads, Worker

# Seconds between two looks at a unit that another run is computing.
LOOK_AGAIN = 0.05


@dataclass
class StageReport:
    """What a bake did for one stage.

    Attributes:
        baked: units computed by this run.
        loaded: units that were in the store, or that another run stored meanwhile.
        seconds: wall time, that of stages made on its behalf among it.
    """

    baked: int = 0
    loaded: int = 0
    seconds: float = 0.0


@dataclass
class BakeReport:
    """What a bake did.

    Attributes:
        stages: by the stage's name, in the order they were finished.
    """

    stages: dict[str, StageReport] = field(default_factory=dict)


def run_bake(
    stages: Sequence[Stage],
    folder: Path,
    executor: Executor | None = None,
    report: BakeReport | None = None,
) -> Any:
    """The value of the last stage; None where there are no stages.

    Only what it takes is looked at: where the last stage is stored, the stages it needs are not.
    Each unit is stored as soon as it is computed, and is not computed again; interrupted, a rerun
    goes on from there. A unit is computed by one run at a time: two runs of the same bake share the
    units, and what a run that died had claimed goes to another.

    Args:
        stages: of the bake, each after those it needs.
        folder: of the stores.
        executor: computes the units of stages that have several; a thread per core by default.
        report: filled in with what was done, where one is given.

    Raises:
        BadInput: the store cannot be written, or a stage cannot be computed from its input.
        CannotRun: the disk is full, or a stage needs a device that is not there.
    """
    if not stages:
        return None
    bake = _Bake(folder, Threads() if executor is None else executor, report or BakeReport())
    value = bake.value(stages[-1])
    for stage in stages:
        if stage.keep is Keep.WHILE_NEEDED:
            BakeStore.of(folder, stage).remove([unit.name for unit in stage.pieces])
    return value


def bake_seconds(stages: Sequence[Stage], folder: Path) -> float:
    """Wall time, s, that computing what is stored of ``stages`` has taken, whenever that was."""
    stored = [stage for stage in stages if stage.keep is not Keep.NEVER]
    return sum(BakeStore.of(folder, stage).seconds() for stage in stored)


@dataclass
class _Bake:
    """A bake under way.

    Attributes:
        values: of the stages that are done, by key.
    """

    folder: Path
    executor: Executor
    report: BakeReport
    values: dict[str, Any] = field(default_factory=dict)

    def value(self, stage: Stage) -> Any:
        """The value of ``stage``, from memory, from the store or computed."""
        if stage.key not in self.values:
            begin, told = perf_counter(), StageReport()
            made = self._stored if stage.keep is not Keep.NEVER else self._computed
            self.values[stage.key] = stage.value(made(stage, told))
            told.seconds = perf_counter() - begin
            self.report.stages[stage.name] = told
        return self.values[stage.key]

    def _computed(self, stage: Stage, told: StageReport) -> list[Any]:
        told.baked = len(stage.pieces)
        return self._executor(stage.pieces).run(compute_unit, self._task(stage), stage.pieces)

    def _stored(self, stage: Stage, told: StageReport) -> list[Any]:
        store = BakeStore.of(self.folder, stage)
        found = {unit.name: _read(stage, store, unit) for unit in stage.pieces}
        missing = [unit for unit in stage.pieces if found[unit.name] is None]
        told.loaded = len(stage.pieces) - len(missing)
        with store:
            while missing:
                shared = _Shared(stage, store, missing, found, told)
                first = next(shared.claimed, None)
                if first is not None:
                    self._run(shared, first)
                elif shared.elsewhere:
                    shared.wait()
                missing = shared.elsewhere
        return [found[unit.name] for unit in stage.pieces]

    def _run(self, shared: _Shared, first: Unit) -> None:
        """Compute and store ``first`` and what more of a stage can be claimed."""
        stage = shared.stage
        task = self._task(stage)
        begin = perf_counter()
        try:
            self._run_task(shared, first, task)
        finally:
            shared.store.add_seconds(perf_counter() - begin)

    def _run_task(self, shared: _Shared, first: Unit, task: Task) -> None:
        stage = shared.stage
        total = sum(unit.size for unit in shared.missing)

        def units() -> Iterator[Unit]:
            yield first
            yield from shared.claimed

        if stage.title is None:
            self._executor(shared.missing).run(compute_unit, task, units(), shared.keep)
            return
        with progress(stage.title, total) as advance:

            def keep(unit: Unit, value: Any) -> None:
                shared.keep(unit, value)
                advance(unit.size)

            self._executor(shared.missing).run(compute_unit, task, units(), keep)

    def _task(self, stage: Stage) -> Task:
        return Task(stage, tuple(self.value(need) for need in stage.needs))

    def _executor(self, units: Sequence[Unit]) -> Executor:
        """A single unit is computed here: nothing is gained elsewhere, and Ctrl-C stops it."""
        return self.executor if len(units) > 1 else Serial(says_unit=False)


@dataclass(frozen=True)
class Task:
    """What all units of a stage are computed from; plain data.

    Attributes:
        stage: the stage.
        needed: values of the stages it needs, in order.
    """

    stage: Stage
    needed: tuple[Any, ...]


def compute_unit(task: Task, unit: Unit, worker: Worker) -> Any:
    """The value of ``unit``."""
    return task.stage.compute(task.stage.given, task.needed, unit, worker)


class _Shared:
    """Units of a stage that are missing, shared with whoever else bakes it."""

    def __init__(
        self,
        stage: Stage,
        store: BakeStore,
        missing: list[Unit],
        found: dict[str, Any],
        told: StageReport,
    ) -> None:
        self.stage, self.store, self.missing = stage, store, missing
        self.elsewhere: list[Unit] = []
        self.claimed = self._claim()
        self._found, self._told = found, told

    def _claim(self) -> Iterator[Unit]:
        """The missing units that nobody else has claimed, claimed one by one as they are taken."""
        for unit in self.missing:
            if not self.store.claim(unit.name):
                self.elsewhere.append(unit)
            elif (value := _read(self.stage, self.store, unit)) is not None:
                self.store.release(unit.name)
                self._found[unit.name] = value
                self._told.loaded += 1
            else:
                yield unit

    def keep(self, unit: Unit, value: Any) -> None:
        """Store what was computed."""
        assert self.stage.format is not None
        self.store.save(unit.name, self.stage.format.write(value))
        self.store.release(unit.name)
        self._found[unit.name] = value
        self._told.baked += 1

    def wait(self) -> None:
        """Until a unit that another run has claimed is stored, or is left by a run that died."""
        with progress("Waiting for another run that bakes the same"):
            while not any(self.store.is_free(unit.name) for unit in self.elsewhere):
                sleep(LOOK_AGAIN)


def _read(stage: Stage, store: BakeStore, unit: Unit) -> Any | None:
    assert stage.format is not None
    stored = store.load(unit.name)
    return None if stored is None else stage.format.read(unit, stored)
