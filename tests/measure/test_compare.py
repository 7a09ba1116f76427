"""`gibench compare`: the bootstrap's coverage, verdicts, exit codes and refusals."""

from __future__ import annotations

import json
import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.run_folders import entry, record, write_run

from gibench.cli.main import call
from gibench.measure.compare.recorded import compare_row

PASSES = ["one", "two"]


def times(rng: np.random.Generator, scale: float = 1.0, frames: int = 40) -> dict[str, Any]:
    process = math.exp(rng.normal(0, 0.01))
    return {
        name: scale * process * ms * rng.lognormal(0, 0.03, frames)
        for name, ms in (("one", 5.0), ("two", 1.0))
    }


def runs(folder: Path, processes: int, scale: float = 1.0, **changes: Any) -> Path:
    """A folder of runs, one a process; one run's own folder for one process."""
    rng = np.random.default_rng(zlib.crc32(folder.name.encode()))
    for turn in range(processes):
        path = folder / f"run{turn}" if processes > 1 else folder
        write_run(path, record(entry(1, PASSES), **changes), {1: times(rng, scale)})
    return folder


def compared(*arguments: Any) -> int:
    return call(["compare", *map(str, arguments)])


def told(capsys: pytest.CaptureFixture[str]) -> str:
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_processes_of_one_revision_are_the_same(tmp_path: Path, capsys) -> None:
    assert compared(runs(tmp_path / "a", 6), runs(tmp_path / "b", 6), "--threshold", "10%") == 0
    out = capsys.readouterr().out
    assert out.count("same") == 3  # the frame and both passes
    assert "hierarchical bootstrap" in out
    assert "assumed" not in out


def test_a_slower_revision_fails_and_names_the_rows(tmp_path: Path, capsys) -> None:
    slow = runs(tmp_path / "b", 6, 1.25)
    assert compared(runs(tmp_path / "a", 6), slow) == 1
    assert "slower by more than 5%: frame of srp (tuned) on box" in told(capsys)
    assert compared(slow, tmp_path / "a") == 0  # faster is fine
    assert capsys.readouterr().out.count("faster") == 3


def test_one_process_a_side_establishes_only_much(tmp_path: Path, capsys) -> None:
    base = runs(tmp_path / "a", 1)
    assert compared(base, runs(tmp_path / "b", 1, 1.15)) == 0
    out = capsys.readouterr().out
    assert out.count("ambiguous") == 3
    assert "not measured but assumed" in out
    assert compared(base, runs(tmp_path / "c", 1, 1.6)) == 1


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"environment": {"cpu": "Another CPU", "usable_threads": 2}}, "processor"),
        ({"environment": {"cpu": "A CPU", "usable_threads": 4}}, "usable threads"),
        ({"device": {"name": "gpu", "platform": "PoCL", "driver": "3.0"}}, "OpenCL device"),
        ({"image": {"width": 64, "height": 64}}, "image size"),
        ({"seed": 7}, "seed"),
        ({"profiles": [{"name": "iphone7", "content_hash": "ee" * 32}]}, "profile iphone7"),
        ({"scenes": [{"name": "box", "content_hash": "00" * 32}]}, "scene box"),
        (
            {"configurations": [entry(1, PASSES, settings={"sh_order": 3})]},
            "work-group 256 (sh_order=2 against sh_order=3)",
        ),
        ({"configurations": [entry(1, PASSES, camera="back")]}, "(front against back)"),
        ({"cold": {"covered": True}}, "caches emptied before frames (False against True)"),
    ],
)
def test_what_differs_is_named_and_refused(tmp_path: Path, capsys, changes, named: str) -> None:
    rng = np.random.default_rng(1)
    base = write_run(tmp_path / "a", record(entry(1, PASSES)), {1: times(rng)})
    new = write_run(tmp_path / "b", record(entry(1, PASSES)) | changes, {1: times(rng)})
    assert compared(base, new) == 2
    line = told(capsys)
    assert "cannot be compared" in line
    assert named in line


def test_a_missing_or_damaged_side_never_passes(tmp_path: Path, capsys) -> None:
    base = runs(tmp_path / "a", 1)
    assert compared(tmp_path / "nowhere", base) == 2
    assert "BASE is missing" in told(capsys)
    (tmp_path / "empty").mkdir()
    assert compared(base, tmp_path / "empty") == 2
    assert "NEW holds nothing to compare" in told(capsys)
    text = (base / "run.json").read_text()
    for damage, words in (
        (text[: len(text) // 2], "cannot be read"),
        ("[]", "schema_version"),
        (text.replace('"schema_version": 1', '"schema_version": 99'), "schema 99"),
        (
            text.replace('"schema_version": 1', '"schema_version": 0'),
            "schema 0; this",
        ),
        (text.replace('"finished": true', '"finished": false'), "never finished"),
        (text.replace('"roofs"', '"rooves"'), "'roofs' is missing"),
    ):
        (base / "run.json").write_text(damage)
        assert compared(base, tmp_path / "b") == 2
        assert words in told(capsys) or words == "x"
        runs(tmp_path / "b", 1)
    (base / "run.json").write_text(text)
    assert compared(base, tmp_path / "b") == 0
    (base / "samples.csv").unlink()
    assert compared(base, tmp_path / "b") == 2
    assert "it has no samples.csv: only the tables" in told(capsys)


def test_a_run_of_before_is_compared(tmp_path: Path, capsys) -> None:
    """One without what was added to records since: more settings, flights, work counted after the
    last frame, roofs that are said to be measured again.
    """
    before = record(entry(1, PASSES))
    now = record(entry(1, PASSES, settings={"sh_order": 2, "bounces": True, "storage": "fp16"}))
    now |= {"flight": {"path": "rest", "rest_frames": 60, "flight_frames": 240}, "cold": None}
    now["roofs"] |= {"measured_again": True}
    for item in now["configurations"][0]["passes"]:
        item |= {"rays": 1234567.0, "flops": 1.0, "atomics": 5}
    rng = np.random.default_rng(4)
    data = times(rng)
    base = write_run(tmp_path / "a", before, {1: data})
    assert compared(base, write_run(tmp_path / "b", now, {1: data})) == 0
    assert "cannot be compared" not in capsys.readouterr().out
    changed = entry(1, PASSES, settings={"sh_order": 2, "bounces": False})
    write_run(tmp_path / "c", record(changed), {1: data})
    assert compared(base, tmp_path / "c") == 2
    assert "bounces=True against bounces=False" in told(capsys)


def test_a_committed_run_is_compared_with_itself_as_run_now(tmp_path: Path) -> None:
    """Each reference run that has samples, and a copy without the fields of today's records."""
    folder = Path(__file__).parents[2] / "results" / "reference"
    found = [one.parent for one in folder.glob("*/*/samples.csv")]
    assert found
    for one in found:
        content = json.loads((one / "run.json").read_text())
        for name in ("flight", "cold"):
            content.pop(name, None)
        for configuration in content["configurations"]:
            for item in configuration["passes"]:
                item["rays"] *= 2
        copy = tmp_path / one.parent.name / one.name
        copy.mkdir(parents=True)
        (copy / "run.json").write_text(json.dumps(content))
        (copy / "samples.csv").write_text((one / "samples.csv").read_text())
        assert compared(one, copy, "--quiet") == 0


def test_a_pass_that_no_longer_runs_fails(tmp_path: Path, capsys) -> None:
    rng = np.random.default_rng(2)
    broken = entry(1, PASSES, status="failed", reason="two: does not build")
    broken["passes"][1] |= {"status": "failed", "reason": "does not build"}
    new = write_run(tmp_path / "b", record(broken), {1: {"one": times(rng)["one"]}})
    assert compared(runs(tmp_path / "a", 1), new) == 1
    assert "no longer runs: frame of srp" in told(capsys)


def test_rows_without_a_baseline_are_told_apart(tmp_path: Path, capsys) -> None:
    rng = np.random.default_rng(3)
    data = times(rng)
    base = write_run(tmp_path / "a", record(entry(1, ["one"])), {1: {"one": data["one"]}})
    new = write_run(tmp_path / "b", record(entry(1, PASSES)), {1: data})
    assert compared(base, new) == 2
    assert "BASE has no two of srp" in told(capsys)


def test_reports_for_people_and_machines(tmp_path: Path, capsys) -> None:
    base, new = runs(tmp_path / "a", 5), runs(tmp_path / "b", 5, 1.3)
    files = "--json", tmp_path / "c.json", "--markdown", tmp_path / "c.md", "--quiet"
    assert compared(base, new, *files) == 1
    content = json.loads((tmp_path / "c.json").read_text())
    assert content["slower"][0][1] == "frame"
    row = content["rows"][0]
    assert row["low"] < row["ratio"] < row["high"]
    assert row["ratio"] == pytest.approx(1.3, rel=0.05)
    text = (tmp_path / "c.md").read_text()
    assert "| 🔴 | frame |" in text
    assert capsys.readouterr().out == ""
    assert compared(base, new, "--json", "-") == 1
    assert json.loads(capsys.readouterr().out)["kind"] == "compare"


def benchmark_file(path: Path, scale: float, *, cpu: str = "A CPU", data: bool = True) -> Path:
    rng = np.random.default_rng(5)
    stats = {"median": 0.01 * scale}
    if data:
        stats["data"] = list(0.01 * scale * rng.lognormal(0, 0.02, 50))
    one = {"fullname": "bench.py::test_pass[a]", "stats": stats, "extra_info": {}}
    machine = {"cpu": {"brand_raw": cpu, "count": 2}, "system": "Linux", "machine": "x86_64"}
    path.write_text(json.dumps({"machine_info": machine, "benchmarks": [one]}))
    return path


def test_files_of_pytest_benchmark(tmp_path: Path, capsys) -> None:
    base = benchmark_file(tmp_path / "a.json", 1.0)
    assert compared(base, benchmark_file(tmp_path / "b.json", 1.0)) == 0
    capsys.readouterr()
    assert compared(base, benchmark_file(tmp_path / "c.json", 1.7)) == 1
    assert "bench.py::test_pass[a]" in told(capsys)
    assert compared(base, benchmark_file(tmp_path / "d.json", 1.0, cpu="B")) == 2
    assert "processor" in told(capsys)
    assert compared(base, benchmark_file(tmp_path / "e.json", 1.0, data=False)) == 2
    assert "--benchmark-save-data" in told(capsys)
    (tmp_path / "f.json").write_text("{}")
    assert compared(base, tmp_path / "f.json") == 2


def test_a_threshold_is_a_percentage(tmp_path: Path, capsys) -> None:
    for bad in ("0", "100%", "five", "-5%"):
        assert compared(tmp_path, tmp_path, f"--threshold={bad}") == 2
        assert "percentage" in told(capsys)


def alarms(processes: int, ratio: float, spread: float, turns: int = 60) -> float:
    rng = np.random.default_rng(processes)

    def side(scale: float) -> list[np.ndarray]:
        found = []
        for _ in range(processes):
            own = scale * math.exp(rng.normal(0, spread) + 0.1 * (rng.random() < 0.05))
            drift = np.exp(np.cumsum(rng.normal(0, 0.01, 30)))
            found.append(10 * own * drift * rng.lognormal(0, 0.05, 30))
        return found

    judged = [
        compare_row(("", "x"), side(1.0), side(ratio), 0.05, rng).judged.verdict
        for _ in range(turns)
    ]
    return judged.count("slower") / turns


@pytest.mark.parametrize(("processes", "spread"), [(1, 0.05), (3, 0.05), (10, 0.08)])
def test_no_false_alarms_on_a_noisy_machine(processes: int, spread: float) -> None:
    assert alarms(processes, 1.0, spread) <= 0.02


def test_enough_processes_find_a_slowdown() -> None:
    assert alarms(10, 1.25, 0.03) >= 0.95


def test_versions_that_differ_are_told(tmp_path: Path, capsys) -> None:
    old = {"gibench": "0.1.0", "numpy": "2.1.0", "xatlas": None}
    new = {"gibench": "0.1.0", "numpy": "2.4.6", "embreex": "4.4"}
    base = runs(tmp_path / "a", 3, versions=old)
    assert compared(base, runs(tmp_path / "b", 3, versions=new), "--json", tmp_path / "c.json") == 0
    assert "numpy 2.1.0 against 2.4.6; embreex none against 4.4." in " ".join(
        capsys.readouterr().out.split()
    )
    facts = json.loads((tmp_path / "c.json").read_text())
    assert facts["versions"] == {"numpy": ["2.1.0", "2.4.6"], "embreex": ["none", "4.4"]}
    assert compared(base, runs(tmp_path / "d", 3, versions=old)) == 0
    assert "Versions differ" not in capsys.readouterr().out
