"""The packages that tracing needs beside gibench's own: the extra ``project``."""

from __future__ import annotations

from importlib.util import find_spec

from gibench.errors import CannotRun

PACKAGES = ("llvmlite", "numba", "greenlet")


def require_extra() -> None:
    """Refuse to trace where a package of the extra is missing.

    Raises:
        CannotRun: one is.
    """
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise CannotRun(
            f"tracing needs {', '.join(missing)}",
            mend="install the extra: pip install 'gibench[project]'",
        )
