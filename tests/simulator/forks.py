"""Runs scripts of this folder in forks of one process that has loaded what they need, which takes a
second and a half each time; meant to be started under Oclgrind, by ``support.oclgrind_runner``.

A job is a line of JSON on standard input: ``script``, ``arguments``, ``environment`` (Oclgrind
reads its options when a context is made), ``out`` and ``log`` (files for standard output and
error), ``limit_s``. The answer is a line too: the exit code, or ``hangs``.
"""

from __future__ import annotations

import importlib
import json
import os
import runpy
import signal
import sys
import traceback
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def child(job: dict[str, Any]) -> int:
    """Become the script; the exit code."""
    for name, number in (("out", 1), ("log", 2)):
        os.dup2(os.open(job[name], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    os.environ.update(job["environment"])
    sys.argv = [job["script"], *job["arguments"]]
    try:
        runpy.run_path(str(HERE / job["script"]), run_name="__main__")
    except SystemExit as leave:
        if leave.code:
            print(leave.code, file=sys.stderr)
        return int(bool(leave.code))
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def waited(process: int, limit_s: float) -> str:
    """The exit code of a child, which is ended after ``limit_s``."""

    def end(number: int, frame: Any) -> None:
        os.kill(process, signal.SIGKILL)

    signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    _, status = os.waitpid(process, 0)
    left = signal.setitimer(signal.ITIMER_REAL, 0)[0]
    return str(os.waitstatus_to_exitcode(status)) if left else "hangs"


def main(*modules: str) -> None:
    """Load ``modules``, then run jobs until standard input ends."""
    for name in modules:
        importlib.import_module(name)
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        job = json.loads(line)
        if (process := os.fork()) == 0:
            code = child(job)
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        print(waited(process, job["limit_s"]), file=answers, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
