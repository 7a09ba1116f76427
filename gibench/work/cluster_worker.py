"""What runs on a worker of a cluster: one unit, computed from what was sent."""

from __future__ import annotations

import pickle
import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from gibench.work.executors import named_unit
from gibench.work.packing import digest_of, unpacked
from gibench.work.worker import Resources, Worker

_RUNS = 2
"""Runs whose common data and live things a worker keeps: the latest."""


@dataclass(frozen=True)
class Facts:
    """Of a process: what must be the same wherever units of one run are computed.

    Attributes:
        code: names and versions of what results depend on.
        machine: the kind of its machine, in words: times of different kinds are never mixed.
    """

    code: tuple[tuple[str, str], ...]
    machine: str

    def differs_in(self, other: Facts) -> str:
        """What of the code is not the same, in words; empty where all is."""
        mine, theirs = dict(self.code), dict(other.code)
        found = [n for n in sorted({*mine, *theirs}) if mine.get(n) != theirs.get(n)]
        return ", ".join(f"{n} {theirs.get(n)} instead of {mine.get(n)}" for n in found)


TellFacts = Callable[[], Facts]


@dataclass(frozen=True)
class Answer:
    """What became of a unit.

    Attributes:
        body: its result, or its error and the error's traceback as text, pickled.
        digest: SHA-256 of the body.
        failed: whether it is an error.
        seconds: that computing took.
        facts: of the process that computed it.
    """

    body: bytes = field(repr=False)
    digest: str
    failed: bool
    seconds: float
    facts: Facts


def given(content: bytes) -> bytes:
    """``content``: the scheduler can have it sent again where the worker that held it has died."""
    return content


def sees(path: str) -> bool:
    """Whether this process sees the file."""
    return Path(path).exists()


def local_folder() -> Path:
    """Where a worker keeps what was sent to it: in Dask's folder for it, or a temporary one."""
    with suppress(ImportError, ValueError):
        from distributed import get_worker

        return Path(get_worker().local_directory) / "gibench"
    return Path(mkdtemp(prefix="gibench-"))


def facts_of_worker(tell: TellFacts) -> Facts:
    """The facts of this process."""
    return _facts(tell)


def answer(
    run: str, body: bytes, names: Sequence[str], parts: Sequence[bytes], unit: bytes, timed: bool
) -> Answer:
    """Compute a unit.

    Args:
        run: digest of ``body``.
        body: of the packed function, common data and :class:`Facts` function.
        names: digests of the parts.
        parts: large arrays of ``body``.
        unit: pickled.
        timed: whether the worker may time, as it has its machine to itself.
    """
    under = _held().run(run, lambda: unpacked(body, dict(zip(names, parts, strict=True))))
    begin, failed = time.perf_counter(), False
    try:
        with threadpool_limits(limits=1):
            compute = named_unit(
                under.compute, under.common, pickle.loads(unit), under.worker(timed)
            )
        content = pickle.dumps(compute, protocol=5)
    except Exception as error:
        failed, content = True, _told(error)
    seconds = time.perf_counter() - begin
    return Answer(content, digest_of(content), failed, seconds, _facts(under.tell))


def _told(error: Exception) -> bytes:
    """The error and its traceback; one that cannot be sent is named."""
    text = "".join(traceback.format_exception(error))
    try:
        content = pickle.dumps((error, text), protocol=5)
        pickle.loads(content)
    except Exception:
        what = RuntimeError(f"{type(error).__name__}: {error}")
        content = pickle.dumps((what, text), protocol=5)
    return content


class _Run:
    """A run of an executor, as a worker's process has it."""

    def __init__(self, compute: Any, common: Any, tell: TellFacts) -> None:
        self.compute, self.common, self.tell = compute, common, tell
        self._shared = Resources()
        self._of_thread = threading.local()

    def worker(self, timed: bool) -> Worker:
        """What this thread keeps."""
        held: dict[str, Worker] = self._of_thread.__dict__
        key = "timed" if timed else "beside"
        if key not in held:
            held[key] = Worker(self._shared, may_time=timed)
        return held[key]


class _Held:
    """The latest runs of this process."""

    def __init__(self) -> None:
        self._runs: OrderedDict[str, _Run] = OrderedDict()
        self._lock = threading.Lock()

    def run(self, digest: str, make: Callable[[], tuple[Any, Any, TellFacts]]) -> _Run:
        """The run of ``digest``, made by the first that asks."""
        with self._lock:
            if digest not in self._runs:
                self._runs[digest] = _Run(*make())
                while len(self._runs) > _RUNS:
                    self._runs.popitem(last=False)
            self._runs.move_to_end(digest)
            return self._runs[digest]


@cache
def _held() -> _Held:
    return _Held()


@cache
def _facts(tell: TellFacts) -> Facts:
    return tell()
