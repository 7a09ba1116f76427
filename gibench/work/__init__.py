"""Who does the work: one thread, several, a cluster (:mod:`gibench.work.cluster`)."""

from gibench.work.executors import Executor, Serial, Threads, elsewhere, run_in_order
from gibench.work.worker import Worker

__all__ = ["Executor", "Serial", "Threads", "Worker", "elsewhere", "run_in_order"]
