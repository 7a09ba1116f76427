"""The cluster that a command computes on, and :func:`gibench.cluster`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gibench.measure.machine.facts import facts_here
from gibench.work.cluster import Dask
from gibench.work.open_cluster import open_cluster


@contextmanager
def cluster(
    scheduler: str | None = None,
    scheduler_file: str | Path | None = None,
    workers: int | None = None,
) -> Iterator[Dask | None]:
    """The executor of a Dask cluster while the block runs; None where none is asked for.

    Give it to a command as ``executor``. At most one is given: the address of a scheduler, the file
    that a scheduler wrote, or how many worker processes to start here. They import the main module:
    a script that starts some is guarded by ``if __name__ == "__main__":``.

    Raises:
        BadInput: several are given, no scheduler answers, or the extra ``cluster`` is missing.
        CannotRun: a worker runs other code than this, or one that times shares its machine.
    """
    if scheduler is None and scheduler_file is None and workers is None:
        yield None
        return
    file = None if scheduler_file is None else Path(scheduler_file)
    with open_cluster(
        facts_here, scheduler=scheduler, scheduler_file=file, workers=workers
    ) as executor:
        yield executor
