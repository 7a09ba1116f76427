"""The worst frames: planted long ones are found; a machine that stalls is not taken for them."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support import fake_technique
from support.fake_technique import Fake
from support.run_folders import entry, record, write_run

import gibench
from gibench.cli.main import call
from gibench.measure.session.beside import LEAST_MS, ConstantWork
from gibench.measure.statistics.summary import Roofs
from gibench.measure.statistics.worst import (
    BESIDE_PER_FRAME,
    CANNOT_TELL,
    HOLDS,
    MISSES,
    STEADY,
    STUTTERS,
    largest_ratio,
    relieved,
    worst_frames,
)

FRAME_MS = 20.0


def machine(
    rng: np.random.Generator,
    work_ms: np.ndarray,
    *,
    jitter: float = 0.03,
    stalls_per_s: float = 0.0,
    stall_ms: float = 15.0,
    known: bool = True,
) -> Any:
    """Frames of this much work and the work beside them, on a machine whose clock wanders by
    ``jitter`` and that holds its processes up now and then, for times of a heavy tail.
    """

    def run(ms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        own = ms * np.exp(rng.normal(0, jitter, len(ms)))
        stalls = rng.poisson(stalls_per_s * 1e-3 * ms)
        held = [stall_ms * (rng.pareto(1.5, n) + 0.2).sum() for n in stalls]
        return own + held, own

    (times, own), (beside, _) = run(work_ms), run(np.full(len(work_ms), FRAME_MS / 4))
    return worst_frames(times, 1.7 * own if known else (), beside, 33.3)


def work(frames: int = 240, **planted: float) -> np.ndarray:
    found = np.full(frames, FRAME_MS)
    for number, ms in planted.items():
        found[int(number.removeprefix("at"))] = ms
    return found


def test_by_hand() -> None:
    times = [10.0, 10.0, 30.0, 12.0, 40.0]
    found = worst_frames(times, (), (), 33.3)
    assert (found.within_budget, found.longest_ms) == (0.8, 40.0)
    assert found.stutter == pytest.approx(40 / 12)
    assert np.isnan(found.machine_longest)
    assert (found.budget, found.pace) == (CANNOT_TELL, CANNOT_TELL)
    assert worst_frames([10.0, 19.9], (), (), 20.0).pace == STEADY  # whatever the machine did
    assert worst_frames([10.0, 19.9], (), (), 20.0).budget == HOLDS
    one = worst_frames([9.0], (), (), 8.0)
    assert (one.stutter, one.within_budget, one.budget) == (1.0, 0.0, CANNOT_TELL)
    assert np.isnan(worst_frames([], (), (), 8.0).longest_ms)
    assert largest_ratio(np.array([4.0, 1.0, 2.0, 8.0]), 2) == 8.0
    lengths = np.r_[np.full(40, 5.0), 15.0, np.full(40, 5.0)]
    told = worst_frames(work(81), work(81), lengths, 33.3)
    assert told.machine_longest == told.machine_stutter == 1.5  # 30 of 20 ms: four pieces in a row
    assert BESIDE_PER_FRAME == 4


def test_what_held_a_frame_up_is_taken_off() -> None:
    own = np.array([10.0] * 9 + [30.0, 10.0])
    times = np.array([20.0] * 3 + [21.0, 24.0, 50.0, 50.0, 50.0, 90.0, 60.0, 50.0])
    np.testing.assert_allclose(relieved(times, own), [20.0] * 9 + [60.0, 20.0])


@pytest.mark.parametrize("jitter", [0.0, 0.03, 0.1])
def test_a_frame_of_three_times_the_length_is_found(rng: np.random.Generator, jitter) -> None:
    found = machine(rng, work(at100=3 * FRAME_MS), jitter=jitter)
    assert found.pace == STUTTERS
    assert found.stutter == pytest.approx(3, rel=5 * jitter + 1e-9)
    assert found.longest_ms == pytest.approx(60, rel=4 * jitter + 1e-9)
    assert found.budget == HOLDS  # one frame of 240
    many = {f"at{k}": 3 * FRAME_MS for k in range(100, 130)}
    slow = machine(rng, work(**many), jitter=min(jitter, 0.03))
    assert (slow.budget, slow.pace) == (MISSES, STUTTERS)
    assert slow.within_budget == pytest.approx(1 - 30 / 240)
    unknown = machine(rng, work(**many), jitter=jitter, known=False)
    assert (unknown.budget, unknown.pace) == (CANNOT_TELL, CANNOT_TELL)


def test_a_machine_that_stalls_is_not_taken_for_frames_that_stutter(rng) -> None:
    paces, budgets = [], []
    for stalls in (0.2, 1.0, 5.0) * 60:
        found = machine(rng, work(), stalls_per_s=stalls)
        paces.append(found.pace)
        budgets.append(found.budget)
    assert STUTTERS not in paces and MISSES not in budgets
    assert paces.count(CANNOT_TELL) > 40 and paces.count(STEADY) > 20


def test_clocks_that_fall_are_seen_beside() -> None:
    """Both take three times as long for a while: nothing tells the frames' work from it."""
    slow = np.r_[np.ones(100), np.full(40, 3.0), np.ones(100)]
    found = worst_frames(FRAME_MS * slow, FRAME_MS * slow, FRAME_MS / 4 * slow, 33.3)
    assert found.machine_longest == found.stutter == 3.0
    assert (found.budget, found.pace) == (CANNOT_TELL, CANNOT_TELL)


def test_constant_work_is_about_as_long_as_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the processor's time, which neighbours do not lengthen."""
    monkeypatch.setattr(time, "perf_counter_ns", time.process_time_ns)
    work_done = ConstantWork(20.0)
    assert 1.0 < np.median([work_done() for _ in range(15)]) < 60.0
    least = ConstantWork(0.0)
    assert np.min([least() for _ in range(15)]) < 10 * LEAST_MS


@pytest.fixture
def fly(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    specs = {"fake": fake_technique.SPEC}
    monkeypatch.setattr("gibench.techniques.registry.techniques", lambda: specs)
    roofs = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)
    monkeypatch.setattr("gibench.measure.machine.roofs.measure_roofs", lambda *_: roofs)
    monkeypatch.setattr(ConstantWork, "__call__", lambda self: 2.0)

    def run(*arguments: str, flight: int = 60) -> tuple[Any, Path]:
        out = tmp_path / f"run{len(list(tmp_path.iterdir()))}"
        command = [
            "run",
            "--no-quality",
            "--technique",
            "fake",
            "--receivers",
            "400",
            "--resolution",
            "16x8",
        ]
        command += ["--cache-dir", str(tmp_path / "cache"), "--out", str(out), "--warmup", "4"]
        if flight:
            command += ["--camera-path", "flight", "--rest-frames", "9"]
            command += ["--flight-frames", str(flight)]
        assert call([*command, *arguments]) == 0
        return gibench.load_run(out), out

    return run


def busy(ms: float) -> None:
    end = time.process_time() + 1e-3 * ms
    while time.process_time() < end:
        pass


def test_a_planted_long_frame_of_a_flight_is_told(fly, monkeypatch, capsys) -> None:
    begin = Fake.begin_frame

    def slow(self: Fake, frame: int) -> None:
        busy(90.0 if frame == 40 else 6.0)
        begin(self, frame)

    monkeypatch.setattr(Fake, "begin_frame", slow)
    run, out = fly()
    (row,) = run.frames.to_dict("records")
    assert row["pace"] == STUTTERS
    assert row["stutter"] > 3 and row["longest_ms"] >= 90
    assert row["machine_longest"] == row["machine_stutter"] == 1.0
    assert 0 < row["within_budget"] < 1
    assert len(run.record["configurations"][0]["beside_ms"]) == row["frames"] == 69
    text = (out / "report.md").read_text()
    assert "## Worst frames" in text and "| stutters |" in text
    assert "times its neighbour at most (stutters; the machine alone 1.0 times)" in (
        capsys.readouterr().out
    )
    assert call(["report", str(out), "--html"]) == 0


def test_a_frame_that_was_held_up_is_not_the_techniques(fly, monkeypatch) -> None:
    begin = Fake.begin_frame

    def held(self: Fake, frame: int) -> None:
        busy(6.0)
        if frame == 40:
            time.sleep(0.4)  # it runs nothing meanwhile
        begin(self, frame)

    monkeypatch.setattr(Fake, "begin_frame", held)
    (row,) = fly()[0].frames.to_dict("records")
    assert row["stutter"] > 3 and row["longest_ms"] >= 400
    assert row["pace"] == CANNOT_TELL


def test_at_rest_nothing_is_timed_beside_and_nothing_judged(fly) -> None:
    run, out = fly("--frames", "6", flight=0)
    (row,) = run.frames.to_dict("records")
    assert pd.isna(row["pace"]) and pd.isna(row["budget"]) and pd.isna(row["machine_stutter"])
    assert row["stutter"] >= 1 and 0 <= row["within_budget"] <= 1
    assert json.loads((out / "run.json").read_text())["configurations"][0]["beside_ms"] == []
    assert "## Worst frames" not in (out / "report.md").read_text()


def test_runs_from_before_have_figures_and_no_verdict(tmp_path: Path) -> None:
    times = {1: {"one": np.full(20, 5.0)}}
    old = write_run(tmp_path / "old", record(entry(1, ["one"])), times)
    row = gibench.load_run(old).frames.iloc[0]
    assert (row["stutter"], row["within_budget"], row["longest_ms"]) == (1.0, 1.0, 5.5)
    assert pd.isna(row["pace"])
