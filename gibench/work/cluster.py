"""An executor whose workers are processes of a Dask cluster, on this machine or on others.

The parent alone knows which units there are, takes their results and writes; a worker that dies
costs what it was computing, which another one computes again. What all units of a run need goes to
the scheduler once, its large arrays apart and by their content (:mod:`gibench.work.packing`), and
from there to each worker once.

Units that time something (they say so: ``timed``) run on workers that declare the resource
``exclusive``, which have their machine to themselves: one unit at a time, and all of a run on one
kind of machine.
"""

from __future__ import annotations

import itertools
import pickle
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from gibench.errors import CannotRun, GibenchError
from gibench.progress import progress
from gibench.work.cluster_worker import (
    Answer,
    Facts,
    TellFacts,
    answer,
    facts_of_worker,
    given,
    sees,
)
from gibench.work.executors import C, Compute, Done, R, Serial, U, ignore
from gibench.work.packing import Packed, digest_of, packed

EXCLUSIVE = "exclusive"
"""The Dask resource that a worker declares which has its machine to itself."""
AHEAD = 2
"""Units sent for every thread of the workers: one that it computes and the next."""
_LOOK_SECONDS = 1.0
"""Between two looks at which workers there are."""
_LAST_SECONDS = 10.0
"""How long units that are under way at Ctrl-C may still take."""
_KEPT_RUNS = 4
"""Parts that so many runs did not ask for are let go."""


@dataclass
class Tally:
    """What went over the wire.

    Attributes:
        units: results taken.
        sent: bytes given to the scheduler.
        back: bytes of results.
        parts: large arrays that were sent.
        known: large arrays that a run needed and that were there already.
        worker_seconds: that workers took to compute the units.
    """

    units: int = 0
    sent: int = 0
    back: int = 0
    parts: int = 0
    known: int = 0
    worker_seconds: float = 0.0


@dataclass(frozen=True)
class _Sent:
    """A run's common data, where the scheduler has it: futures of bytes."""

    digest: str
    body: Any
    names: list[str]
    parts: list[Any]


@dataclass(frozen=True)
class _Under:
    """A unit under way."""

    number: int
    unit: Any
    timed: bool
    future: Any


class Dask:
    """Computes on the workers of a Dask cluster.

    A copy of it in another process computes there, one unit after another: bakes within a unit stay
    within its worker. At Ctrl-C, units under way get ten seconds to finish; the others are let go.

    Args:
        client: of the cluster.
        facts: tells of the process it is called in what must be the same on all workers, and the
            kind of its machine; a function of a module.
        one_machine: all workers are processes of this machine, started for this: what is timed runs
            on one of them while the others have nothing.
    """

    def __init__(self, client: Any, facts: TellFacts, *, one_machine: bool = False) -> None:
        self.tally = Tally()
        self.timed_on: str | None = None
        self._client = client
        self._tell, self._here = facts, facts()
        self._one_machine = one_machine
        self._parts: dict[str, tuple[Any, int]] = {}
        self._runs, self._units = itertools.count(1), itertools.count(1)
        self._session = f"gibench-{time.time_ns():x}"
        self._threads, self._exclusive, self._looked = 0, 0, float("-inf")

    def __reduce__(self) -> tuple[Any, ...]:
        return Serial, ()

    def run(
        self, compute: Compute[C, U, R], common: C, units: Iterable[U], done: Done[U, R] = ignore
    ) -> list[R]:
        """See :meth:`gibench.work.executors.Executor.run`.

        Raises:
            GibenchError: the scheduler is gone; or workers died of a unit, again and again.
            CannotRun: a unit times something, and no worker has its machine to itself; or a worker
                is of another code, or times on another kind of machine.
        """
        waiting = iter(enumerate(units))
        entry = next(waiting, None)
        if entry is None:
            return []
        self.look()
        number_of_run = next(self._runs)
        sent = self._send(packed((compute, common, self._tell)), number_of_run)
        results: dict[int, R] = {}
        running: dict[str, _Under] = {}
        ended: SimpleQueue[str] = SimpleQueue()

        def keep(key: str) -> None:
            under = running.pop(key)
            results[under.number] = self._result(under)
            done(under.unit, results[under.number])

        try:
            while entry is not None or running:
                while entry is not None and self._has_room(running, entry[1]):
                    under = self._submit(sent, *entry)
                    running[under.future.key] = under
                    under.future.add_done_callback(lambda future: ended.put(future.key))
                    entry = next(waiting, None)
                if not running:
                    self._wait_for_workers()
                with suppress(Empty):
                    keep(ended.get(timeout=_LOOK_SECONDS))
                self.look(_LOOK_SECONDS)
        except KeyboardInterrupt:
            self._finish(running, ended, keep, time.monotonic() + _LAST_SECONDS)
            raise
        except _Gone:
            raise
        except BaseException:
            self._finish(running, ended, keep, float("inf"))
            raise
        finally:
            self._forget(number_of_run)
        return [results[number] for number in sorted(results)]

    def look(self, after: float = 0.0) -> None:
        """See which workers there are, if the last look was longer ago than ``after``, s.

        Raises:
            GibenchError: the scheduler is gone.
            CannotRun: a worker that times shares its machine.
        """
        if time.monotonic() - self._looked < after:
            return
        with _reached():
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
        self._threads = sum(worker["nthreads"] for worker in workers.values())
        alone = {a: w for a, w in workers.items() if w["resources"].get(EXCLUSIVE)}
        self._exclusive = len(alone)
        self._looked = time.monotonic()
        if self._one_machine:
            return
        hosts = [worker["host"] for worker in workers.values()]
        for address, worker in alone.items():
            beside = hosts.count(worker["host"]) - 1
            if beside or worker["nthreads"] > 1:
                raise CannotRun(
                    f"the worker declares itself {EXCLUSIVE} and has {worker['nthreads']} threads "
                    f"and {beside} other workers on its machine",
                    where=address,
                    mend="start it alone, with --nworkers 1 --nthreads 1",
                )

    def check_workers(self) -> list[str]:
        """Ask all workers that are there what they run, before anything is sent.

        Returns:
            The kinds of machines that they are on.

        Raises:
            CannotRun: one runs other code.
            GibenchError: the scheduler is gone, or a worker does not know gibench.
        """
        with _reached():
            found = self._client.run(facts_of_worker, self._tell, on_error="return")
        for address, facts in found.items():
            if not isinstance(facts, Facts):
                raise GibenchError(
                    f"this worker cannot run gibench ({facts})", where=address,
                    mend="install the same gibench for the workers",
                )  # fmt: skip
            self._refuse_other_code(facts, address)
        return sorted({facts.machine for facts in found.values()})

    def shares(self, folder: Path) -> bool:
        """Whether all workers see ``folder`` as this process does.

        Raises:
            GibenchError: the scheduler is gone.
        """
        if self._one_machine:
            return True
        token = folder / f".{self._session}"
        try:
            token.touch()
            with _reached():
                found = self._client.run(sees, str(token), on_error="return")
            return all(seen is True for seen in found.values())
        finally:
            token.unlink(missing_ok=True)

    def _send(self, content: Packed, run: int) -> _Sent:
        for name, part in content.parts.items():
            if name in self._parts:
                self.tally.known += 1
                self._parts[name] = self._parts[name][0], run
                continue
            self.tally.parts += 1
            self._parts[name] = self._give(name, part), run
        names = list(content.parts)
        body = self._give(f"run-{run}", content.body)
        return _Sent(content.digest, body, names, [self._parts[name][0] for name in names])

    def _give(self, name: str, content: bytes) -> Any:
        self.tally.sent += len(content)
        with _reached():
            return self._client.submit(given, content, key=f"{self._session}-{name}")

    def _submit(self, sent: _Sent, number: int, unit: Any) -> _Under:
        timed = _timed(unit)
        content = pickle.dumps(unit, protocol=5)
        self.tally.sent += len(content)
        with _reached():
            future = self._client.submit(
                answer,
                sent.digest, sent.body, sent.names, sent.parts, content, timed,
                key=f"{self._session}-unit-{next(self._units)}",
                resources={EXCLUSIVE: 1} if timed else None,
                pure=False,
            )  # fmt: skip
        return _Under(number, unit, timed, future)

    def _has_room(self, running: dict[str, _Under], unit: Any) -> bool:
        timing = sum(under.timed for under in running.values())
        if _timed(unit):
            self._need_exclusive()
            return not running if self._one_machine else timing < self._exclusive
        if self._one_machine and timing:
            return False
        return len(running) - timing < AHEAD * self._threads

    def _need_exclusive(self) -> None:
        if self._threads and not self._exclusive:
            raise CannotRun(
                f"frames are timed only on workers that declare themselves {EXCLUSIVE}, and none "
                "does",
                where="the cluster",
                mend=f"start one on a machine of its own: dask worker ADDRESS --nthreads 1 "
                f"--resources {EXCLUSIVE}=1",
            )

    def _wait_for_workers(self) -> None:
        with progress("Waiting for a worker"):
            while not self._threads:
                time.sleep(_LOOK_SECONDS)
                self.look()

    def _result(self, under: _Under) -> Any:
        """What a unit gave.

        Raises:
            Exception: what it raised.
        """
        future = under.future
        if future.status == "cancelled":
            raise _Gone()
        if future.status == "error":
            with _reached():
                error = future.exception()
            raise GibenchError(
                f"{under.unit.name}: no worker could compute it ({type(error).__name__}: {error})",
                mend="a worker that dies of it may lack memory: see its log",
            )
        with _reached():  # where its worker died with the result, another computes it again
            found: Answer = future.result()
        if digest_of(found.body) != found.digest:
            raise GibenchError(f"the result of {under.unit.name} came back damaged")
        self._refuse_other_code(found.facts, under.unit.name)
        if under.timed:
            self._refuse_other_machine(found.facts, under.unit.name)
        self.tally.units += 1
        self.tally.back += len(found.body)
        self.tally.worker_seconds += found.seconds
        value = pickle.loads(found.body)
        if found.failed:
            error, text = value
            raise error from _There(text)
        return value

    def _refuse_other_code(self, facts: Facts, where: str) -> None:
        if what := self._here.differs_in(facts):
            raise CannotRun(
                f"a worker runs {what}: its results may differ", where=where,
                mend="install the same for the workers",
            )  # fmt: skip

    def _refuse_other_machine(self, facts: Facts, where: str) -> None:
        self.timed_on = self.timed_on or facts.machine
        if facts.machine != self.timed_on:
            raise CannotRun(
                f"it was timed on {facts.machine}, what came before on {self.timed_on}: times of "
                "different machines are not compared",
                where=where,
                mend=f"let only one kind of machine declare itself {EXCLUSIVE}",
            )

    def _finish(
        self,
        running: dict[str, _Under],
        ended: SimpleQueue[str],
        keep: Callable[[str], None],
        until: float,
    ) -> None:
        """Take what is still under way; the first error is the one that is told."""
        while running and time.monotonic() < until:
            with suppress(Empty, Exception):
                keep(ended.get(timeout=_LOOK_SECONDS))
            if all(under.future.status == "cancelled" for under in running.values()):
                break
        with suppress(Exception):
            self._client.cancel([under.future for under in running.values()])

    def _forget(self, run: int) -> None:
        """Let go of parts that no run has needed for long; workers drop them then."""
        self._parts = {
            name: (future, last)
            for name, (future, last) in self._parts.items()
            if run - last < _KEPT_RUNS
        }


class _Gone(GibenchError):
    """The scheduler does not answer any more."""

    def __init__(self) -> None:
        super().__init__(
            "the Dask scheduler is gone; what is finished is kept",
            mend="start it again and give the same command, which goes on from there",
        )


class _There(Exception):
    """The traceback of an error that was raised on a worker, for ``--debug``."""


@contextmanager
def _reached() -> Iterator[None]:
    """Calls to the scheduler: it may be gone."""
    from concurrent.futures import CancelledError

    from distributed.comm import CommClosedError

    try:
        yield
    except (CommClosedError, CancelledError, OSError, TimeoutError) as error:
        raise _Gone() from error
    except RuntimeError as error:  # a client that was closed as its scheduler went
        raise _Gone() from error


def _timed(unit: Any) -> bool:
    """Whether computing it times something."""
    return bool(getattr(unit, "timed", False))
