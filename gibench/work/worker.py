"""What a worker keeps between the units it computes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, TypeVar

from gibench.work.turns import Turns

T = TypeVar("T")


class Resources:
    """Live things made on demand and kept by key; asked from several threads."""

    def __init__(self) -> None:
        self._held: dict[Hashable, Any] = {}
        self._lock = threading.RLock()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """What is kept as ``key``; made by the first that asks, while the others wait."""
        with self._lock:
            if key not in self._held:
                self._held[key] = make()
            held: T = self._held[key]
            return held


class Worker:
    """One thread of an executor, and the live things that its units share.

    Units are plain data, so that they can be sent anywhere. An OpenCL queue, a kernel or a ray
    tracer is no plain data: it is made where it is used, and kept here for the next unit. All of it
    is let go when the executor's run ends.

    Args:
        shared: what all workers of this process share.
        turns: of the workers of this machine; None where there is only this one.
        may_time: whether what it times means anything: others may compute on its machine.
    """

    def __init__(
        self, shared: Resources | None = None, turns: Turns | None = None, *, may_time: bool = True
    ) -> None:
        self._own = Resources()
        self._shared = Resources() if shared is None else shared
        self._turns = turns
        self.may_time = may_time

    def own(self, key: Hashable, make: Callable[[], T]) -> T:
        """What this worker alone keeps as ``key``, made where it is missing."""
        return self._own.get(key, make)

    def shared(self, key: Hashable, make: Callable[[], T]) -> T:
        """What all workers of this process keep as ``key``; safe to use from several threads."""
        return self._shared.get(key, make)

    def alone(self) -> AbstractContextManager[None]:
        """While the block runs no other unit of the executor's run is computed on this machine: for
        what is timed.
        """
        return nullcontext() if self._turns is None else self._turns.alone()
