"""Who does the work: one thread, several, or whatever else implements ``Executor``."""

from gibench.work.executors import Executor, Serial, Threads, run_in_order
from gibench.work.worker import Worker

__all__ = ["Executor", "Serial", "Threads", "Worker", "run_in_order"]
