"""`gibench conform`: every kernel is compared or listed, and faults of every kind are found."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections import defaultdict
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "simulator"))
from recording import all_kernels, recorded_kernels

from gibench.cli.main import call
from gibench.conform import worker
from gibench.conform.cases import cases, kernels
from gibench.conform.judge import (
    CANNOT_RUN,
    NO_ORACLE,
    RIGHT,
    WRONG,
    Judged,
    _of_sizes,
    _said,
    judge_cases,
    judge_kernels,
)
from gibench.conform.judge import _judged as _judged_command
from gibench.conform.worker import MARK
from gibench.device import Device, list_devices
from gibench.resources import data
from gibench.techniques.parts.conformance.case import Bench, Case, off


def test_every_kernel_has_an_oracle() -> None:
    there = set(kernels(data("kernels_cl")))
    assert there == all_kernels()
    covered = {kernel for case in cases().values() for kernel in case.kernels}
    assert covered == there


def checked_by(case: Case) -> Any:
    """The function behind a case, which several variants of a kernel share."""
    check = case.check
    while isinstance(check, partial):
        check = check.func
    return check


def one_of_each() -> list[Any]:
    """Cases of every function that checks: one variant of each in turn, the others slow."""
    found = defaultdict(list)
    for name, case in sorted(cases().items()):
        found[checked_by(case)].append(name)
    return [
        pytest.param(name, marks=() if k == n % len(names) else pytest.mark.slow)
        for n, names in enumerate(found.values())
        for k, name in enumerate(names)
    ]


@pytest.mark.parametrize("name", one_of_each())
def test_a_case_runs_the_kernels_that_it_names(name: str, rng: np.random.Generator) -> None:
    case = cases()[name]
    # 7 divides nothing and is what the kernels' own tests run with: no kernel is compiled anew.
    size = 7 if 7 in case.sizes else case.sizes[-1]
    with recorded_kernels() as ran:
        assert max(case.check(Bench(list_devices()[0]), rng, size)) < 1
    assert set(case.kernels) <= ran


@pytest.mark.parametrize(
    "name",
    [f"{what} (simt)" for what in ("DDGI's blending", "SRP's probe update")]
    + ["SRP's projection and transport (simt)"],
)
def test_kernels_as_a_cpu_gets_them_that_makes_vectors_of_work_items(
    monkeypatch: pytest.MonkeyPatch, name: str, rng: np.random.Generator
) -> None:
    """What ``Device.lanes_together`` changes, where no such runtime is at hand."""
    monkeypatch.setattr(Device, "lanes_together", property(lambda device: 16))
    case = cases()[name]
    for size in case.sizes[-2:]:
        assert max(case.check(Bench(list_devices()[0]), rng, size)) < 1


def test_deviations() -> None:
    one = np.array([1.0, -2.0])
    assert off(one, one) == 0
    assert off(one + np.array([0, 0.02]), one, relative=0.01) == pytest.approx(1)
    assert off(one + np.array([0.3, 0]), one, absolute=0.1) == pytest.approx(3)
    assert off(one * np.array([1, np.nan]), one, 1.0, 1.0) == np.inf
    assert off(one[:1], one, 1.0, 1.0) == np.inf
    assert off(np.array([np.inf]), np.array([np.inf])) == 0


def faulty_tree(folder: Path, faults: Iterable[tuple[str, str]]) -> Path:
    """A kernel tree in which each kernel ``file.cl:name`` begins with another statement."""
    tree = Path(shutil.copytree(str(data("kernels_cl")), folder / "kernels"))
    for kernel, statement in faults:
        file, _, name = kernel.partition(":")
        text = (tree / file).read_text()
        found = re.search(rf"void {name}\s*\([^{{]*\{{", text)
        assert found is not None
        (tree / file).write_text(text[: found.end()] + f" {statement}\n" + text[found.end() :])
    return tree


NOTHING = "if (get_global_size(0)) return;"
ONE_A_FOLDER = {
    "ddgi/probes.cl:variability_mean": NOTHING,
    "gibs/life.cl:coverage": NOTHING,
    "measure/roofs.cl:roof_read": NOTHING,
    "parts/dilate.cl:dilate_border": NOTHING,
    "rays/trace.cl:trace_occluded": NOTHING,
    "reference/path.cl:average": NOTHING,
    "srp/tuned_transport.cl:irradiance_transport": NOTHING,
    "surfel_cache/dilation.cl:dilation": NOTHING,
}


def test_the_faults_are_of_each_folder_with_kernels() -> None:
    assert {kernel.partition("/")[0] for kernel in ONE_A_FOLDER} == {
        kernel.partition("/")[0] for kernel in all_kernels()
    }


def _judged(tree: Path, faulty: Iterable[str], limit_s: float = 60.0) -> dict[str, str]:
    mine = {n: case for n, case in cases().items() if set(faulty) & set(case.kernels)}
    found = judge_cases(mine, 0, 1, limit_s, tree)
    return {
        kernel: one.status
        for kernel, one in judge_kernels(kernels(tree), mine, found).items()
        if kernel in faulty and one.failed
    }


@pytest.mark.slow
def test_a_fault_in_each_folder_is_found(tmp_path: Path) -> None:
    tree = faulty_tree(tmp_path, ONE_A_FOLDER.items())
    assert set(_judged(tree, ONE_A_FOLDER)) == set(ONE_A_FOLDER)


def test_wrong_results_hangs_crashes_and_builds_that_fail_stop_no_other(tmp_path: Path) -> None:
    one_item = "if (get_global_id(0) == 0) for (volatile int i = 0; i < 1; ) ;"
    hang = {"parts/dilate.cl:dilate_border": one_item}
    faults = {
        "measure/roofs.cl:roof_read": "*(volatile __global int *)8 = 1;",
        "gibs/life.cl:coverage": "no_such_thing();",
        "parts/border_copy.cl:border_copy": NOTHING,
    }
    tree = faulty_tree(tmp_path, [*hang.items(), *faults.items()])
    assert _judged(tree, hang, 4.0) == dict.fromkeys(hang, WRONG)
    assert _judged(tree, faults) == {
        "measure/roofs.cl:roof_read": WRONG,
        "gibs/life.cl:coverage": CANNOT_RUN,
        "parts/border_copy.cl:border_copy": WRONG,
    }


def test_the_command_tells_and_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    few = {n: case for n, case in cases().items() if n in ("Dilation", "The machine's roofs")}
    monkeypatch.setattr("gibench.commands.conform.cases", lambda: few)
    assert call(["conform", "--json", str(tmp_path / "a.json"), "--device", "0"]) == 0
    out = capsys.readouterr().out
    assert "parts/dilate.cl:dilate " in out
    assert out.rstrip().endswith("no oracle")
    record = json.loads((tmp_path / "a.json").read_text())
    by_name = {row["kernel"]: row for row in record["kernels"]}
    assert set(by_name) == all_kernels()
    assert by_name["parts/dilate.cl:dilate"]["status"] == RIGHT
    assert by_name["parts/dilate.cl:dilate"]["sizes"] == [1, 7, 64, 100]
    assert by_name["surfel_cache/pull.cl:pull"]["status"] == NO_ORACLE
    assert record["device"]["driver"]
    tree = faulty_tree(tmp_path, [("parts/dilate.cl:dilate", NOTHING)])
    assert call(["conform", "--kernels", str(tree), "--json", "-", "-q"]) == 1
    out = capsys.readouterr()
    assert "1 kernel is not right: parts/dilate.cl:dilate" in out.err
    rows = {row["kernel"]: row for row in json.loads(out.out)["kernels"]}
    assert "work-group size 1, 7, 64, 100" in rows["parts/dilate.cl:dilate"]["why"]


def test_what_a_small_device_cannot_run_is_no_fault() -> None:
    small = _of_sizes([{"size": 7, "cannot": "too small"}], "", [7])
    assert (small.status, small.failed) == (CANNOT_RUN, False)
    some = _of_sizes([{"size": 7, "off": 0.5}, {"size": 64, "cannot": "too small"}], "", [7, 64])
    assert (some.status, some.sizes) == (RIGHT, (7,))
    assert _of_sizes([{"size": 7, "off": 0.5}], "the process was ended by SIGSEGV", [7]).failed
    assert isinstance(next(iter(cases().values())), Case)


def test_silence_is_not_right() -> None:
    for said, why in (([], "7, 64"), ([{"size": 64, "off": 0.1}], "7")):
        silent = _of_sizes(said, "", [7, 64])
        assert (silent.status, silent.failed) == (WRONG, True)
        assert silent.why == f"no result at work-group size {why}"
    printed = "import sys; sys.stdout.write({!r})"

    def judged(out: str) -> str:
        return _judged_command([sys.executable, "-c", printed.format(out)], 20.0, [7]).status

    assert judged("") == judged(f"driver: {MARK}" + '{"size": 7, "off": 0}') == WRONG
    assert judged(f"{MARK}driver") == WRONG
    assert judged(f'driver\n{MARK}{{"size": 7, "off": 0}}\n') == RIGHT


def test_a_driver_that_ends_no_line_hides_no_result(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(bench: Bench, rng: np.random.Generator, size: int) -> list[float]:
        sys.stdout.write("driver: ")
        return [0.25]

    monkeypatch.setattr(
        "gibench.conform.cases.cases", lambda: {"made up": Case("made up", ("k",), check, (7,))}
    )
    worker.main(0, 1, "made up", None)
    (said,) = _said(capfd.readouterr().out)
    assert said == {"size": 7, "off": 0.25}


def test_a_build_that_fails_does_not_hide_behind_a_device_too_small() -> None:
    def check(bench: Bench, rng: np.random.Generator, size: int) -> list[float]:
        return []

    both = {name: Case(name, ("k",), check, (7,)) for name in ("small", "broken")}
    found = {
        "small": Judged(CANNOT_RUN, (), 0.0, "too small"),
        "broken": Judged(CANNOT_RUN, (), 0.0, "does not build", failed=True),
    }
    for order in (["small", "broken"], ["broken", "small"]):
        one = judge_kernels(["k"], {name: both[name] for name in order}, found)["k"]
        assert (one.failed, one.why) == (True, "broken: does not build")
