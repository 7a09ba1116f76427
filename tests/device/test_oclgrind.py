"""Every kernel runs under Oclgrind without a finding: memory, data races, uninitialised values."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from support.oclgrind_runner import SCRIPTS, needs_oclgrind, under_oclgrind

from gibench.device import list_devices
from gibench.device.build import vector_width

sys.path.insert(0, str(SCRIPTS))

from cases import BAKES, FRAMES, MOVING, OTHERS, Case
from recording import all_kernels

CASES = [*BAKES, *FRAMES, *MOVING, *OTHERS]


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


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the frames find their bake, made without the simulator: baking is a case of its own."""
    folder = tmp_path_factory.mktemp("baked")
    natively(folder, next(case for case in BAKES if case.width == 1))
    return folder


def test_no_kernel_is_left_out(tmp_path: Path) -> None:
    """The cases below, run without the simulator, enqueue every kernel there is.

    The widest of each do, and every bake, but frames with the default settings alone: what other
    sizes and settings change is within the kernels.
    """
    widest = 16 if vector_width(list_devices()[0]) >= 16 else 8
    chosen = [c for c in CASES if c.width == 16 and (c.what == "bake" or not c.settings)]
    cases = [replace(case, width=widest) for case in chosen]
    assert all_kernels() - natively(tmp_path, *cases) == set()


@pytest.mark.oclgrind
@needs_oclgrind
@pytest.mark.parametrize("fault", ["bounds", "race", "uninitialised"])
def test_a_fault_is_found(tmp_path: Path, fault: str) -> None:
    assert under_oclgrind(tmp_path, "unsound.py", fault)[1]


@pytest.mark.oclgrind
@needs_oclgrind
def test_a_sound_kernel_leaves_an_empty_log(tmp_path: Path) -> None:
    assert under_oclgrind(tmp_path, "unsound.py", "none")[1] == ""


@pytest.mark.oclgrind
@needs_oclgrind
@pytest.mark.parametrize("case", CASES, ids=str)
def test_nothing_is_found(tmp_path: Path, cache: Path, case: Case) -> None:
    # A bake that lies in the cache would not run.
    folder = tmp_path if case.what == "bake" else cache
    ran, log = under_oclgrind(tmp_path, "run_case.py", *arguments(folder, case))
    assert log == ""
    assert ran
