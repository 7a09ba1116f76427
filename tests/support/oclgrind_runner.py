"""Running scripts under the Oclgrind simulator and reading what it tells."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[1] / "simulator"

# Races are found between work-items as simulated, not as scheduled: more threads find no more, and
# take a quarter more processor time, which the other tests want.
ONE_THREAD = ("oclgrind", "--num-threads", "1")

LOOKING = {
    "OCLGRIND_DATA_RACES": "1",
    "OCLGRIND_UNINITIALIZED": "1",
    "OCLGRIND_MAX_ERRORS": "100000",
    # Optimised code holds 'freeze', which Oclgrind 21.10 cannot run with --uninitialized.
    "OCLGRIND_BUILD_OPTIONS": "-cl-opt-disable",
}
# Loaded before the forks: what scripts run, and what that loads only where it is needed, which each
# fork would do again.
LOADED = (
    "counts_under_oclgrind",
    "gibench.techniques.srp.bake.stages",
    "gibench.techniques.surfel_cache.bake.surfels",
    "scipy.interpolate",
    "scipy.stats",
)

COUNTING = {"OCLGRIND_INST_COUNTS": "1"}
LIMIT_S = 240.0

needs_oclgrind = pytest.mark.skipif(
    shutil.which("oclgrind") is None, reason="oclgrind is not installed (apt-get install oclgrind)"
)


@dataclass(frozen=True)
class Simulator:
    """A process under Oclgrind whose forks run the scripts of tests/simulator, one at a time."""

    process: subprocess.Popen[str]

    def run(self, folder: Path, environment: Mapping[str, str], script: str, *given: str) -> str:
        """What a script prints on standard output; it must end with code 0.

        It is run once more where it hangs: the simulator stood still, its threads idle, in one of
        some thousand runs, on a case that passed before and after. A kernel that never ends, or
        work-items that miss a barrier, hang every time.

        Args:
            folder: for its output.
            environment: Oclgrind's options.
            script: a file of tests/simulator.
            given: its arguments.
        """
        out, log = folder / "stdout.txt", folder / "stderr.txt"
        job = {"script": script, "arguments": given, "environment": dict(environment)}
        code = self.answer(job | {"out": str(out), "log": str(log), "limit_s": LIMIT_S})
        if code == "hangs":
            code = self.answer(job | {"out": str(out), "log": str(log), "limit_s": LIMIT_S})
        assert code == "0", f"{code}\n{log.read_text()}\n{out.read_text()[-2000:]}"
        return out.read_text()

    def answer(self, job: Mapping[str, object]) -> str:
        assert self.process.stdin is not None and self.process.stdout is not None
        print(json.dumps(job), file=self.process.stdin, flush=True)
        return self.process.stdout.readline().strip()

    def looked(self, folder: Path, script: str, *given: str) -> tuple[list[str], str]:
        """Run a script, looking for bad memory, data races and uninitialised values.

        Returns:
            The words it printed, and the log: empty when nothing was found. Oclgrind exits 0
            whatever it finds, so only the log counts.
        """
        log = folder / "oclgrind.log"
        printed = self.run(folder, {**LOOKING, "OCLGRIND_LOG": str(log)}, script, *given)
        return printed.split(), log.read_text() if log.exists() else ""


@contextmanager
def simulator() -> Iterator[Simulator]:
    """Start one; it ends with the block."""
    environment = dict(os.environ, PYOPENCL_NO_CACHE="1")
    command = [*ONE_THREAD, sys.executable, str(SCRIPTS / "forks.py"), *LOADED]
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield Simulator(process)
        assert process.stdin is not None
        process.stdin.close()
