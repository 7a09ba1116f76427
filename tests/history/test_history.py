"""A history: what is added comes back, twice adds nothing, and a planted step is found and told."""

from __future__ import annotations

import json
import multiprocessing
import shutil
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.browser import CHROMIUM, browser
from support.run_folders import entry, record, write_run

from gibench.cli.main import call
from gibench.commands.history import history_add, history_check, history_page
from gibench.errors import BadInput, GibenchError
from gibench.history.entries import FRAME, GI, SAMPLE_COLUMNS, Entry, read_entry
from gibench.history.series import read_series
from gibench.history.store import History

pytest.importorskip("duckdb")
pytest.importorskip("ruptures")

KINDS = pytest.mark.parametrize("name", ["kept.duckdb", "kept"])


def made_run(folder: Path, number: int, ms: float, rng: np.random.Generator, **changes) -> Path:
    """A run of two passes, one of stage gi, whose times are about ``ms``."""
    one = entry(1, ["shade", "gather"])
    one["passes"][1]["stage"] = "gi"
    content = record(
        one,
        started_utc=f"2026-{1 + number // 28:02}-{1 + number % 28:02} 00:00:00",
        versions={"gibench": "0.1.0", "numpy": "2", "git": {"revision": f"{number:040x}"}},
        **changes,
    )
    times = {name: ms * rng.normal(1, 0.01, 5) for name in ("shade", "gather")}
    return write_run(folder / f"run-{number}", content, {1: times})


@pytest.fixture
def runs(tmp_path: Path, rng: np.random.Generator) -> list[Path]:
    """Twenty runs, 30 % slower from the thirteenth on."""
    return [made_run(tmp_path, n, 2.0 * (1.3 if n >= 12 else 1), rng) for n in range(20)]


@KINDS
def test_what_is_added_comes_back(tmp_path: Path, runs: list[Path], name: str) -> None:
    path = tmp_path / name
    assert history_add(runs[:3], path).new == 3
    again = history_add(runs[1:4], path)
    assert (again.new, again.known) == (1, 2)
    series = {one.pass_name: one for one in read_series(History(path))}
    assert set(series) == {"shade", "gather", FRAME, GI}
    frame = pd.read_csv(runs[2] / "samples.csv")
    walls = frame.groupby("frame")["frame_wall_ms"].first()
    assert series[FRAME].runs["median"][2] == pytest.approx(walls.median(), rel=1e-9)
    gather = frame[frame["pass"] == "gather"]["time_ms"]
    assert series[GI].runs["median"][2] == pytest.approx(gather.median(), rel=1e-9)
    assert list(series[GI].runs["revision"]) == [f"{n:040x}" for n in range(4)]


@KINDS
def test_histories_merge(tmp_path: Path, runs: list[Path], name: str) -> None:
    one, other = tmp_path / f"other-{name}", tmp_path / name
    history_add(runs[:4], one)
    history_add(runs[2:6], other)
    assert history_add([one], other).new == 2
    assert {len(found.runs) for found in read_series(History(other))} == {6}


def test_a_step_is_told_with_its_revisions(
    tmp_path: Path, runs: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "kept.duckdb"
    assert call(["history", "add", *map(str, runs[:12]), "--history", str(kept)]) == 0
    assert call(["history", "check", "--history", str(kept)]) == 0
    assert call(["history", "add", *map(str, runs[12:]), "--history", str(kept)]) == 0
    capsys.readouterr()
    assert call(["history", "check", "--history", str(kept)]) == 1
    shown = capsys.readouterr()
    assert f"after revision {11:012x}"[:20] in shown.err
    checked = history_check(kept)
    assert len(checked.found) == 4
    for one in checked.found:
        assert one.between == (f"{11:040x}", f"{12:040x}")
        assert one.step.ratio == pytest.approx(1.3, rel=0.25)
        assert one.age == 8
    assert history_check(kept, last=7).error is None


def test_other_machines_are_other_series(tmp_path: Path, rng: np.random.Generator) -> None:
    made = []
    for number in range(16):
        run = made_run(tmp_path, number, 2.0 if number < 8 else 4.0, rng)
        content = json.loads((run / "run.json").read_text())
        content["environment"]["cpu"] = "first" if number < 8 else "second"
        (run / "run.json").write_text(json.dumps(content))
        made.append(run)
    kept = tmp_path / "kept"
    history_add(made, kept)
    checked = history_check(kept)
    assert checked.series == 8
    assert checked.found == ()


def test_pytest_benchmark_and_ab_are_read(tmp_path: Path) -> None:
    stats = {"median": 0.002, "data": [0.001, 0.002, 0.003]}
    content = {
        "machine_info": {"cpu": {"brand_raw": "some", "count": 2}, "python_version": "3.11"},
        "commit_info": {"id": "abc", "dirty": True},
        "datetime": "2026-01-01T00:00:00+00:00",
        "version": "5",
        "benchmarks": [{"fullname": "bench.py::one", "stats": stats}],
    }
    benchmark = tmp_path / "bench.json"
    benchmark.write_text(json.dumps(content))
    made = read_entry(benchmark)
    assert list(made.tables["samples"]["value"]) == pytest.approx([1.0, 2.0, 3.0])
    measured = {
        "started_utc": "2026-01-01 00:00:00",
        "environment": {"cpu": "some", "threads": 2},
        "versions": {"gibench": "0.1.0", "git": {"revision": "abc", "dirty": False}},
        "device": "PoCL",
    }
    sides = {"old": {"name": "main", "kernels": "1" * 64}, "new": {"name": ".", "kernels": "2"}}
    ratios = {"frame": [0.1, 0.2], "shade": [0.0, 0.0]}
    text = {"kind": "ab", "title": "gibench ab: srp", "log_ratios": ratios, "measured": measured}
    compared = tmp_path / "ab.json"
    compared.write_text(json.dumps(text | sides))
    history_add([benchmark, compared], tmp_path / "kept")
    series = {one.unit: one for one in read_series(History(tmp_path / "kept"))}
    assert set(series) == {"ms", "ratio"}
    assert series["ms"].runs["median"][0] == pytest.approx(2.0)


def test_recorded_runs_of_older_gibench_are_read() -> None:
    found = sorted(Path("results/reference").glob("*/*/samples.csv"))
    assert found
    for file in found:
        made = read_entry(file.parent)
        passes = set(made.tables["samples"]["pass"])
        assert FRAME in passes
        samples = made.tables["samples"]
        assert (samples["value"] >= 0).all()  # a pass may have nothing to do in a frame
        assert (samples["value"][samples["pass"] == FRAME] > 0).all()


@KINDS
def test_writers_at_once_lose_nothing(tmp_path: Path, runs: list[Path], name: str) -> None:
    path = tmp_path / name
    spawn = multiprocessing.get_context("spawn")
    parts = [runs[:12], runs[8:]]
    writers = [spawn.Process(target=history_add, args=(part, path)) for part in parts]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert {len(one.runs) for one in read_series(History(path))} == {20}


def test_a_million_samples(tmp_path: Path, runs: list[Path]) -> None:
    """Here a fiftieth of them; the million is timed in docs/history.md."""
    base = read_entry(runs[0])
    count = 20_000
    samples = pd.DataFrame(
        {
            "run": base.run,
            "configuration": 1,
            "pass": np.repeat(["shade", "gather"], count // 2),
            "frame": np.tile(np.arange(count // 2), 2),
            "value": np.linspace(1, 2, count),
        }
    )[list(SAMPLE_COLUMNS)]
    kept = History(tmp_path / "kept.duckdb")
    start = time.perf_counter()
    kept.add([Entry(base.run, base.tables | {"samples": samples})])
    took = time.perf_counter() - start
    counted = kept.ask("SELECT count(*) AS n, median(value) AS middle FROM samples")
    assert counted["n"][0] == count
    assert counted["middle"][0] == pytest.approx(1.5)
    assert took < 60


def test_wrong_input_is_one_line(
    tmp_path: Path, runs: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    text, broken = tmp_path / "a.json", tmp_path / "b.duckdb"
    text.write_text("{}")
    broken.write_bytes(b"no database" * 1000)
    kept = tmp_path / "kept"
    cases = [
        ["add", str(tmp_path / "nowhere"), "--history", str(kept)],
        ["add", str(text), "--history", str(kept)],
        ["add", str(runs[0]), str(text), "--history", str(kept)],
        ["add", str(runs[0]), "--history", str(broken)],
        ["check", "--history", str(tmp_path / "none")],
        ["check", "--history", str(broken)],
        ["check", "--history", str(kept), "--last", "0"],
        ["check", "--history", str(kept), "--threshold", "x"],
        ["show", "--history", str(tmp_path / "none.duckdb")],
    ]
    for case in cases:
        assert call(["history", *case]) == 2, case
        error = capsys.readouterr().err.strip()
        assert len(error.splitlines()) == 1, error
    assert not kept.exists()
    history_add([runs[0]], kept)
    with pytest.raises(BadInput, match="itself"):
        history_add([kept], kept)


def test_a_history_that_cannot_be_written_is_told(tmp_path: Path, runs: list[Path]) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(GibenchError, match="cannot be written"):
        history_add([runs[0]], tmp_path / "file" / "kept")


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")
def test_the_page_in_a_browser(tmp_path: Path, runs: list[Path]) -> None:
    pytest.importorskip("websocket")
    changed = json.loads((runs[5] / "run.json").read_text())
    changed["versions"]["numpy"] = "3"
    (runs[5] / "run.json").write_text(json.dumps(changed))
    kept = tmp_path / "kept.duckdb"
    history_add(runs, kept)
    page = history_page(kept)
    with browser() as shown:
        shown.open(page.as_uri())
        assert shown.complaints == []
        assert [one for one in shown.requests if not one.startswith("file:")] == []
        assert shown.ask("document.querySelectorAll('#steps tbody tr').length") == 4
        assert shown.ask("document.querySelectorAll('.series').length") == 1
        shown.ask(
            "(() => { const s = document.querySelector('#pass'); s.value = ''; "
            "s.dispatchEvent(new Event('change')); })()"
        )
        assert shown.ask("document.querySelectorAll('.series').length") == 4
        assert shown.ask("document.querySelectorAll('.series .step').length") == 4
        assert shown.ask("document.querySelectorAll('#environment tbody tr').length") == 2
        link = shown.ask("document.querySelector('.series a').getAttribute('href')")
    assert (page.parent / link).exists()
    shutil.rmtree(runs[0])
    assert "run-0" not in history_page(kept).read_text()
