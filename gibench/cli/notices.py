"""What is worth knowing but stops nothing: one line each on standard error, each once."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_LOG = logging.getLogger("gibench")
_DEVICE = logging.getLogger("gibench.device")  # which one runs is said, too


class _Lines(logging.Handler):
    """Prints ``gibench: warning: ...``; a line that was printed before is not printed again. What
    a library has logged bears its name.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Print the record unless it was printed before."""
        line = " ".join(record.getMessage().split())
        if record.name.partition(".")[0] != _LOG.name:
            line = f"{line} (told by {record.name.partition('.')[0]})"
        if line not in self._said:
            self._said.add(line)
            told = "" if record.levelno < logging.WARNING else "warning: "
            print(f"gibench: {told}{line}", file=sys.stderr)


@contextmanager
def notices() -> Iterator[None]:
    """While the block runs, warnings of gibench and of libraries are printed in lines of ours."""

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        _LOG.warning("%s (%s of a library)", message, category.__name__)

    handler, root = _Lines(), logging.getLogger()
    level = _DEVICE.level
    _DEVICE.setLevel(logging.INFO)
    root.addHandler(handler)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = show
            yield
    finally:
        root.removeHandler(handler)
        _DEVICE.setLevel(level)


def errors_only(quiet: bool) -> bool:
    """Print no warnings any more if ``quiet``, which is handed back: what ``-q`` does."""
    for handler in logging.getLogger().handlers:
        if quiet and isinstance(handler, _Lines):
            handler.setLevel(logging.ERROR)
    return quiet
