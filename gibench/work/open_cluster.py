"""A Dask cluster found by its address, or started on this machine, and let go again."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gibench.errors import BadInput
from gibench.work.cluster import EXCLUSIVE, Dask
from gibench.work.cluster_worker import TellFacts

_LOG = logging.getLogger(__name__)
_CONNECT_SECONDS = 10
_NEAR_SECONDS = "5s"
"""For a worker on this machine to answer. Whoever asks one for a result as it dies tries so long,
half a minute as Dask would have it, before another worker computes it again."""
_ALLOWED_DEATHS = 20
"""Workers that may die while they compute a unit, before it is given up."""

_MIB = 1024 * 1024
_ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), 1),
    "MALLOC_MMAP_THRESHOLD_": 32 * _MIB,
    "MALLOC_TRIM_THRESHOLD_": 64 * _MIB,
}
"""Of the workers started here. Dask's own ``MALLOC_TRIM_THRESHOLD_`` lets the C library ask the
system anew for every large array, and a truth takes a fifth longer; these are where glibc's own
thresholds end up in a process that uses large arrays (mallopt(3), DEFAULT_MMAP_THRESHOLD_MAX)."""


@contextmanager
def open_cluster(
    facts: TellFacts,
    *,
    scheduler: str | None = None,
    scheduler_file: Path | None = None,
    workers: int | None = None,
) -> Iterator[Dask]:
    """The executor of a cluster while the block runs: one of these three is given.

    Args:
        facts: see :class:`Dask`.
        scheduler: address of a scheduler, as ``tcp://head:8786``.
        scheduler_file: that a scheduler wrote (``dask scheduler --scheduler-file``).
        workers: processes to start on this machine, with a scheduler of their own.

    Raises:
        BadInput: not one is given, no scheduler answers, or the extra is not installed.
        CannotRun: a worker runs other code, or one that times shares its machine.
    """
    if sum(one is not None for one in (scheduler, scheduler_file, workers)) != 1:
        raise BadInput(
            "give one of --scheduler, --scheduler-file and --workers", where="the cluster"
        )
    if workers is not None and workers < 1:
        raise BadInput(
            f"{workers} workers compute nothing", where="--workers", mend="give 1 or more"
        )
    require_extra()
    import dask
    from distributed import Client, LocalCluster

    settings: dict[str, Any] = {
        "distributed.admin.large-graph-warning-threshold": "1 TiB",
        "distributed.scheduler.allowed-failures": _ALLOWED_DEATHS,
        "distributed.nanny.pre-spawn-environ": _ENVIRONMENT,
        "distributed.worker.profile.enabled": False,  # it stops the worker every 10 ms
    }
    if workers is not None:
        settings["distributed.comm.timeouts.connect"] = _NEAR_SECONDS
    with ExitStack() as stack, dask.config.set(settings):
        stack.enter_context(_quiet("distributed"))
        if workers is not None:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
                memory_limit=0,  # as without a cluster
                resources={EXCLUSIVE: 1},
                silence_logs=logging.CRITICAL,
            )
            stack.callback(_close, cluster)
            # Also those that die as they start, which nobody else starts again.
            cluster.adapt(minimum=workers, maximum=workers, interval="1s")
            client = Client(cluster)
        else:
            client = _client(Client, scheduler, scheduler_file)
        stack.callback(_close, client)
        executor = Dask(client, facts, one_machine=workers is not None)
        executor.look()
        kinds = executor.check_workers()
        if len(kinds) > 1:
            _LOG.warning(
                "the workers are on %d kinds of machines (%s): bakes may differ in their last bits "
                "from those of one machine",
                len(kinds),
                "; ".join(kinds),
            )
        yield executor


def require_extra() -> None:
    """Refuse where the packages of the extra ``cluster`` are missing.

    Raises:
        BadInput: they are.
    """
    if find_spec("distributed") is None:
        raise BadInput(
            "a cluster needs Dask's package distributed",
            mend="install the extra: pip install 'gibench[cluster]'",
        )


def _client(make: Any, address: str | None, file: Path | None) -> Any:
    try:
        if file is None:
            return make(address, timeout=_CONNECT_SECONDS)
        if not file.is_file():
            raise BadInput("there is no such file", where=file)
        return make(scheduler_file=str(file), timeout=_CONNECT_SECONDS)
    except (OSError, ValueError, TimeoutError) as error:
        raise BadInput(
            "no Dask scheduler answers",
            where=address or file,
            mend="start one with 'dask scheduler' and give the address that it prints",
        ) from error


def _close(one: Any) -> None:
    """Close a client or cluster; one whose scheduler is gone has nothing to say about it."""
    try:
        one.close(timeout=5)
    except Exception as error:
        _LOG.debug("not closed: %s", error)


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """What a library logs of workers that come and go is not told: results tell it."""
    known = logging.root.manager.loggerDict
    names = [name, *(each for each in list(known) if each.startswith(f"{name}."))]
    before = {each: logging.getLogger(each).level for each in names}
    for each in names:  # Dask gives some of them levels of their own
        logging.getLogger(each).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for each, level in before.items():
            logging.getLogger(each).setLevel(level)
