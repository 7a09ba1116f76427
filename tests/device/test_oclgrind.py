"""Every kernel runs under Oclgrind without a finding: memory, data races, uninitialised values."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from filelock import FileLock
from support.oclgrind_runner import SCRIPTS, Simulator, needs_oclgrind

from gibench.device import list_devices
from gibench.device.build import vector_width

sys.path.insert(0, str(SCRIPTS))

from cases import (
    BAKES,
    FRAMES,
    MOVING,
    OTHERS,
    SLOW_BAKES,
    SLOW_FRAMES,
    SLOW_OTHERS,
    Case,
    distinct,
)
from recording import all_kernels

CASES = [*BAKES, *FRAMES, *MOVING, *OTHERS]
SLOW = [
    pytest.param(case, marks=pytest.mark.slow) for case in (*SLOW_BAKES, *SLOW_FRAMES, *SLOW_OTHERS)
]
# All of SRP's that frames at rest have; those of the others have no kernels.
_OF_SRP = [case.settings for case in FRAMES if case.technique == "srp"]
BAKED = distinct([Case("bake", 1, 1, "srp", settings=settings) for settings in _OF_SRP])


def arguments(cache: Path, *cases: Case) -> list[str]:
    return [str(cache), *(json.dumps(asdict(case)) for case in cases)]


def natively(cache: Path, *cases: Case) -> set[str]:
    """The kernels that run when ``cases`` do, without the simulator."""
    ran = subprocess.run(
        [sys.executable, str(SCRIPTS / "run_case.py"), *arguments(cache, *cases)],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr
    return set(ran.stdout.split())


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all workers of a run see."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "oclgrind"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def cache(shared: Path) -> Path:
    """Where the frames find their bake, made without the simulator: baking is a case of its own."""
    folder = shared / "baked"
    with FileLock(shared / "baking.lock"):
        if not folder.exists():
            folder.mkdir()
            natively(folder, *BAKED)
    return folder


@pytest.mark.slow
def test_no_kernel_is_left_out(tmp_path: Path) -> None:
    """The cases below, run without the simulator, enqueue every kernel there is.

    The same is asked of what runs under the simulator, by the last of test_nothing_is_found.
    """
    widest = vector_width(list_devices()[0])
    cases = [replace(case, width=min(case.width, widest)) for case in CASES]
    assert all_kernels() - natively(tmp_path, *cases) == set()


def left_out(shared: Path, case: Case, ran: list[str]) -> set[str]:
    """The kernels that no case has run, once all of CASES have: which is for their last to ask.

    A slow case counts, too: what it has baked for its frames lies there for the others.
    """
    with FileLock(shared / "ran.lock"):
        (folder := shared / "ran").mkdir(exist_ok=True)
        (folder / str(case)).write_text("\n".join(ran))
        found = {one.name: one.read_text().split() for one in folder.iterdir()}
    if not {str(each) for each in CASES} <= found.keys():
        return set()
    return all_kernels().difference(*found.values())


@pytest.mark.oclgrind
@needs_oclgrind
@pytest.mark.parametrize("fault", ["bounds", "race", "uninitialised"])
def test_a_fault_is_found(tmp_path: Path, oclgrind: Simulator, fault: str) -> None:
    assert oclgrind.looked(tmp_path, "unsound.py", fault)[1]


@pytest.mark.oclgrind
@needs_oclgrind
def test_a_sound_kernel_leaves_an_empty_log(tmp_path: Path, oclgrind: Simulator) -> None:
    assert oclgrind.looked(tmp_path, "unsound.py", "none")[1] == ""


@pytest.mark.oclgrind
@needs_oclgrind
@pytest.mark.parametrize("case", [*CASES, *SLOW], ids=str)
def test_nothing_is_found(
    tmp_path: Path, shared: Path, cache: Path, oclgrind: Simulator, case: Case
) -> None:
    # A bake that lies in the cache would not run.
    folder = tmp_path if case.what == "bake" else cache
    ran, log = oclgrind.looked(tmp_path, "run_case.py", *arguments(folder, case))
    assert log == ""
    assert ran
    assert left_out(shared, case, ran) == set()
