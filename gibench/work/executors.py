"""Executors: they compute units of work, one after another or several at once.

An executor knows nothing of what it computes. ``compute`` is a function of a module and everything
it is given is plain data, so that an executor that runs it in another process or on another machine
can stand beside these two.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, TypeVar

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from gibench.errors import GibenchError
from gibench.work.turns import Turns
from gibench.work.worker import Resources, Worker


class Named(Protocol):
    """A unit of work, as an executor sees it."""

    @property
    def name(self) -> str:
        """In messages."""
        ...


C = TypeVar("C")
U = TypeVar("U", bound=Named)
R = TypeVar("R")

Compute = Callable[[C, U, Worker], R]
Done = Callable[[U, R], None]


def ignore(unit: Named, result: object) -> None:
    """What to do with a result that is only returned."""


class Executor(Protocol):
    """Computes units of work."""

    def run(
        self, compute: Compute[C, U, R], common: C, units: Iterable[U], done: Done[U, R] = ignore
    ) -> list[R]:
        """``compute(common, unit, worker)`` of every unit, in the order of ``units``.

        Results do not depend on the executor: libraries for linear algebra, whose sums do depend
        on their number of threads, get one thread a worker. What a unit times it computes inside
        :meth:`Worker.alone`, while nothing else of this run is computed on its machine; where that
        takes a machine of its own, a unit tells ahead by an attribute ``timed`` that is true.

        Args:
            compute: a function of a module, so that it can be sent elsewhere.
            common: plain data that all units need.
            units: plain data; taken one by one, no sooner than a worker is free.
            done: called in the calling thread with each unit and result as soon as it is there.

        Raises:
            Exception: what a unit raised, with the unit's name in its message or its notes. Units
                that were under way then, or at Ctrl-C, are finished and given to ``done`` first.
        """
        ...


@dataclass(frozen=True)
class Serial:
    """Computes in the calling thread, one unit after another.

    Attributes:
        says_unit: whether what a unit raises says which; needless where there is only one.
    """

    says_unit: bool = True

    def run(
        self, compute: Compute[C, U, R], common: C, units: Iterable[U], done: Done[U, R] = ignore
    ) -> list[R]:
        """See :meth:`Executor.run`."""
        worker, results = Worker(), []
        for unit in units:
            with threadpool_limits(limits=1):
                run = named_unit if self.says_unit else _plainly
                result = run(compute, common, unit, worker)
            done(unit, result)
            results.append(result)
        return results


@dataclass(frozen=True)
class Threads:
    """Computes in threads of this process.

    Attributes:
        count: of threads; None: one per core.
    """

    count: int | None = None

    def __post_init__(self) -> None:
        if self.count is not None and self.count < 1:
            raise ValueError(f"{self.count} threads: use 1 or more")

    def run(
        self, compute: Compute[C, U, R], common: C, units: Iterable[U], done: Done[U, R] = ignore
    ) -> list[R]:
        """See :meth:`Executor.run`."""
        count = self.count or os.cpu_count() or 1
        shared, turns, of_thread = Resources(), Turns(), threading.local()
        results: dict[int, R] = {}
        running: dict[Future[R], tuple[int, U]] = {}

        def call(unit: U) -> R:
            if not hasattr(of_thread, "worker"):
                of_thread.worker = Worker(shared, turns)
            with turns.beside():
                return named_unit(compute, common, unit, of_thread.worker)

        def keep(future: Future[R]) -> None:
            number, unit = running.pop(future)
            results[number] = future.result()
            done(unit, results[number])

        waiting = enumerate(units)
        with threadpool_limits(limits=1), ThreadPoolExecutor(count) as pool:
            try:
                while True:
                    while len(running) < count and (entry := next(waiting, None)) is not None:
                        running[pool.submit(call, entry[1])] = entry
                    if not running:
                        break
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        with turns.beside():
                            keep(future)
            except BaseException:
                for future in wait(running).done:
                    with suppress(Exception):  # the first error is the one that is told
                        keep(future)
                raise
        return [results[number] for number in sorted(results)]


def elsewhere(executor: Executor | None) -> bool:
    """Whether units are computed in other processes; None stands for threads of this one."""
    return not (executor is None or isinstance(executor, Serial | Threads))


def run_in_order(
    executor: Executor, compute: Compute[C, U, R], common: C, units: Sequence[U], done: Done[U, R]
) -> None:
    """As :meth:`Executor.run`, with ``done`` called in the order of ``units``, as results have it
    whose order shows in a file. At Ctrl-C, and where a unit raised, what is finished is given to
    ``done`` first.
    """
    place = {id(unit): number for number, unit in enumerate(units)}
    waiting: dict[int, tuple[U, R]] = {}
    given, refused = 0, False

    def give(number: int) -> None:
        nonlocal refused
        refused = True
        done(*waiting.pop(number))
        refused = False

    def take(unit: U, result: R) -> None:
        nonlocal given
        waiting[place[id(unit)]] = unit, result
        while given in waiting:
            give(given)
            given += 1

    try:
        executor.run(compute, common, units, take)
    finally:
        for number in sorted(waiting):
            if not refused:
                give(number)


def _plainly(compute: Compute[C, U, R], common: C, unit: U, worker: Worker) -> R:
    return compute(common, unit, worker)


def named_unit(compute: Compute[C, U, R], common: C, unit: U, worker: Worker) -> R:
    """One unit; what it raises says which."""
    try:
        return compute(common, unit, worker)
    except GibenchError as error:
        named = type(error)(f"{unit.name}: {error.what}", where=error.where, mend=error.mend)
        raise named from error
    except Exception as error:
        error.add_note(f"in {unit.name}")
        raise
