"""Who computes when, among the workers of one machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition


class Turns:
    """Workers compute side by side, but for one that asks to be alone: what is timed must not share
    the machine.
    """

    def __init__(self) -> None:
        self._changed = Condition()
        self._computing = 0
        self._asking = 0
        self._one_is_alone = False

    @contextmanager
    def beside(self) -> Iterator[None]:
        """Compute beside others; waits while one is alone or asks to be."""
        self._begin()
        try:
            yield
        finally:
            self._end()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Inside :meth:`beside`: the machine to oneself, once the others have ended or ask as well;
        beside them again afterwards.
        """
        with self._changed:
            self._computing -= 1
            self._asking += 1
            self._changed.notify_all()
            self._changed.wait_for(lambda: not (self._computing or self._one_is_alone))
            self._asking -= 1
            self._one_is_alone = True
        try:
            yield
        finally:
            with self._changed:
                self._one_is_alone = False
                self._changed.notify_all()
            self._begin()

    def _begin(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: not (self._asking or self._one_is_alone))
            self._computing += 1

    def _end(self) -> None:
        with self._changed:
            self._computing -= 1
            self._changed.notify_all()
