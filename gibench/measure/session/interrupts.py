"""Ctrl-C that ends the work at once and the bookkeeping never."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class Interrupts:
    """Ctrl-C while a ``with`` block of this object runs.

    Inside :meth:`work` it raises KeyboardInterrupt at once; elsewhere, where samples are stored and
    counted, it waits until :meth:`came` is asked. Without effect in any but the main thread, which
    alone is told of signals.
    """

    def __init__(self) -> None:
        self._waiting = False
        self._working = False
        self._before: Any = None

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._told)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    @contextmanager
    def work(self) -> Iterator[None]:
        """What may be ended anywhere.

        Raises:
            KeyboardInterrupt: Ctrl-C came inside.
        """
        try:
            self._working = True
            yield
        finally:
            self._working = False

    def came(self) -> bool:
        """Whether one came outside of :meth:`work` since this was last asked."""
        came, self._waiting = self._waiting, False
        return came

    def _told(self, _number: int, _frame: FrameType | None) -> None:
        if self._working:
            raise KeyboardInterrupt
        self._waiting = True
