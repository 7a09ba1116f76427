"""Running a script under the Oclgrind simulator and reading its log."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[1] / "simulator"

# Races are found between work-items as simulated, not as scheduled: more threads find no more, and
# take a quarter more processor time, which the other tests want.
ONE_THREAD = ("oclgrind", "--num-threads", "1")

needs_oclgrind = pytest.mark.skipif(
    shutil.which("oclgrind") is None, reason="oclgrind is not installed (apt-get install oclgrind)"
)


def patiently(command: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run ``command``, and once more where it hangs.

    The simulator stood still, its threads idle, in one of some thousand runs, on a case that passed
    before and after. A kernel that never ends, or work-items that miss a barrier, hang every time.
    """
    for tries_left in (1, 0):
        try:
            return subprocess.run(
                command, env=environment, capture_output=True, text=True, timeout=240
            )
        except subprocess.TimeoutExpired:
            if not tries_left:
                raise
    raise AssertionError


def under_oclgrind(tmp_path: Path, script: str, *arguments: str) -> tuple[list[str], str]:
    """Run ``script`` of tests/oclgrind under Oclgrind, which looks for bad memory, data races and
    uninitialised values.

    Args:
        tmp_path: for the log.
        script: a file of tests/oclgrind.
        arguments: its arguments.

    Returns:
        The lines it printed, and the log: empty when nothing was found. Oclgrind exits 0 whatever
        it finds, so only the log counts.
    """
    log = tmp_path / "oclgrind.log"
    environment = dict(os.environ, PYOPENCL_NO_CACHE="1")
    # Optimised code holds 'freeze', which Oclgrind 21.10 cannot run with --uninitialized.
    environment["OCLGRIND_BUILD_OPTIONS"] = "-cl-opt-disable"
    command = [
        *(*ONE_THREAD, "--data-races", "--uninitialized", "--max-errors", "100000"),
        *("--log", str(log), sys.executable, str(SCRIPTS / script), *arguments),
    ]
    ran = patiently(command, environment)
    assert ran.returncode == 0, ran.stderr + ran.stdout
    return ran.stdout.split(), log.read_text() if log.exists() else ""
