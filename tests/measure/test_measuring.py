"""The stopping rule, what is told of samples, cold caches, turns, and the harness's own cost."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support import fake_technique

from gibench.cli.main import call
from gibench.measure.plan.stopping import Plan, median_interval
from gibench.measure.session.cold import MOST_BYTES, CacheFlush
from gibench.measure.session.loop import BLOCK
from gibench.measure.statistics.diagnostics import health, outliers
from gibench.measure.statistics.summary import Roofs
from gibench.profiles import load_profile

SEED = 11


def frames_until(plan: Plan, times: list[float]) -> tuple[int, str]:
    for count in range(1, len(times) + 1):
        if why := plan.enough(times[:count]):
            return count, why
    raise AssertionError("never enough")


def test_steady_times_end_at_the_fewest_frames() -> None:
    times = list(10 + np.random.default_rng(SEED).normal(0, 0.05, 600))
    assert frames_until(Plan(), times) == (30, "the median is known to 5 %")


def test_noisier_times_take_more_frames_and_the_width_is_kept() -> None:
    times = list(np.random.default_rng(SEED).lognormal(2, 0.15, 600))
    count, why = frames_until(Plan(), times)
    assert 60 < count < 500
    assert "known" in why
    low, high = median_interval(times[:count])
    assert high - low <= 0.05 * np.median(times[:count])


def test_the_caps() -> None:
    wild = list(np.random.default_rng(SEED).lognormal(0, 2, 600))
    assert frames_until(Plan(seconds=1e9), wild) == (500, "the cap of 500 frames")
    slow = [4000.0, 9000.0] * 20
    assert frames_until(Plan(), slow) == (6, "the cap of 30 s")
    assert frames_until(Plan(frames=7), wild) == (7, "the frames asked for")


def test_warm_up_ends_when_times_have_settled() -> None:
    falling = [100 * 0.8**k + 10 for k in range(60)]
    ends = next(k for k in range(60) if Plan().warm(falling[:k]))
    assert 15 < ends < 40
    assert falling[ends] < 11
    flat = [10.0] * 20
    assert next(k for k in range(20) if Plan().warm(flat[:k])) == 10
    assert not Plan(warmup=12).warm(flat[:11])
    assert Plan(warmup=12).warm(flat[:12])
    assert Plan(warmup=0).warm([])
    never = [2.0**k for k in range(100)]
    assert next(k for k in range(100) if Plan(warmup_seconds=1e9).warm([1, *never][:k])) <= 60


def test_the_medians_interval_covers_it() -> None:
    rng = np.random.default_rng(SEED)
    ends = np.array([median_interval(rng.exponential(size=37)) for _ in range(2000)])
    missed = np.mean((ends[:, 0] > math.log(2)) | (ends[:, 1] < math.log(2)))
    assert missed <= 0.05 + 3 * math.sqrt(0.05 / 2000)
    assert math.isnan(median_interval([1.0] * 5)[0])
    assert median_interval([3.0, 1.0, 2.0, 6.0, 5.0, 4.0]) == (1.0, 6.0)  # 2 / 2^6 = 3 %


def test_noise_alone_is_not_told() -> None:
    rng = np.random.default_rng(SEED)
    told = [health(rng.lognormal(1, 0.1, 60)) for _ in range(300)]
    assert sum(h.drift is not None for h in told) <= 3
    assert sum(h.two_speeds is not None for h in told) == 0


def test_drift_two_speeds_and_outliers_are_told() -> None:
    rng = np.random.default_rng(SEED)
    noise = rng.normal(0, 0.1, 90)
    rising = health(10 * np.linspace(1, 1.2, 90) + noise)
    assert rising.drift == pytest.approx(0.13, abs=0.03)
    assert rising.two_speeds is None
    two = health(np.where(rng.random(90) < 0.4, 10.0, 13.0) + noise)
    assert two.two_speeds == pytest.approx((10, 13), abs=0.1)
    assert two.drift is None
    times = 10 + noise
    times[[5, 50]] = 30.0, 2.0
    assert list(np.flatnonzero(outliers(times))) == [5, 50]
    spiky = health(times)
    assert (spiky.outliers, spiky.drift, spiky.two_speeds) == (2, None, None)
    assert "two speeds" in " ".join(two.in_words())


def test_flushing_streams_past_the_cache_or_says_that_it_does_not() -> None:
    flush = CacheFlush(load_profile("iphone7"))
    flush()
    facts = flush.facts
    assert 32 << 20 <= facts.streamed_bytes <= MOST_BYTES
    assert facts.covered == (2 * facts.cache_bytes <= MOST_BYTES)


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    specs = {spec.name: spec for spec in (fake_technique.SPEC, fake_technique.PLAIN)}
    monkeypatch.setattr("gibench.techniques.registry.techniques", lambda: specs)
    roofs = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)
    monkeypatch.setattr("gibench.measure.machine.roofs.measure_roofs", lambda *_: roofs)

    def run(*arguments: str) -> Path:
        out = tmp_path / f"run{len(list(tmp_path.iterdir()))}"
        code = call(
            [
                *("run", "--no-quality", "--technique", "fake", "--receivers", "400", "--quiet"),
                *("--cache-dir", str(tmp_path / "cache"), "--out", str(out), *arguments),
            ]
        )
        assert code == 0
        return out

    return run


def test_work_is_told_by_the_last_frame_where_only_a_frame_can_tell(fakes) -> None:
    frames = ("-w", "64", "--frames", "6", "--warmup", "3")
    passes = pd.read_csv(fakes(*frames, "--set", "fake.counted=true") / "passes.csv")
    passes = passes.set_index("pass")
    assert passes["rays"].to_dict() == {"triad": 0, "read": 1000 * 8 + 64}
    read = passes.loc["read"]
    assert read["mrays_per_s"] == pytest.approx(8064 / read["median_ms"] * 1e-3, rel=1e-3)
    plain = pd.read_csv(fakes(*frames) / "passes.csv")
    assert plain["rays"].tolist() == [0, 0]


def order_of(folder: Path) -> list[int]:
    """Configurations in the order their blocks were stored."""
    numbers = pd.read_csv(folder / "samples.csv")["configuration"].tolist()
    return [a for a, b in zip(numbers, [None, *numbers], strict=False) if a != b]


def test_configurations_take_turns_in_an_order_the_seed_draws(fakes) -> None:
    grid = ("-w", "64", "-w", "128", "-w", "256", "--frames", "20", "--warmup", "5")
    first, again, other = fakes(*grid), fakes(*grid), fakes(*grid, "--seed", "1")
    order = order_of(first)
    assert set(order) == {1, 2, 3}
    assert len(order) > 6  # blocks of all three are mixed
    assert order == order_of(again)
    assert order != order_of(other)
    frames = pd.read_csv(first / "samples.csv").groupby("configuration")["frame"].unique()
    for one in frames:  # a configuration's own frames are whole and in order
        assert list(one) == list(range(5, 25))
    text = (first / "report.md").read_text()
    assert "took turns in blocks of frames, in random order: 1 2 3." in text
    assert BLOCK == 5


def test_groups_when_memory_is_short(fakes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gibench.measure.session.loop.MOST_ALIVE", 2)
    folder = fakes("-w", "64", "-w", "128", "-w", "256", "--frames", "10")
    order = order_of(folder)
    assert order.index(3) == len(order) - 1
    assert "one after the other" in (folder / "report.md").read_text()


def test_the_rule_decides_when_no_frames_are_asked_for(fakes) -> None:
    folder = fakes("--resolution", "16x8")
    frames = pd.read_csv(folder / "frames.csv").iloc[0]
    assert 30 <= frames["frames"] <= 500
    assert frames["warmup"] >= 10
    assert frames["ci_low_ms"] <= frames["median_ms"] <= frames["ci_high_ms"]
    assert frames["stopped"]
    if "known" in frames["stopped"]:
        assert frames["ci_high_ms"] - frames["ci_low_ms"] <= 0.05 * frames["median_ms"] * 1.0001


def test_cold_frames_say_so(fakes) -> None:
    folder = fakes("--frames", "3", "--warmup", "1", "--cold")
    assert "Caches were emptied before every frame" in (folder / "report.md").read_text()


HARNESS = """
import sys, time
from gibench.cli.main import call
from gibench.measure.session.session import Session

frame, spent = Session.frame, []

def timed(self, number):
    # Kernels run on PoCL's own threads: what this one computes is what it costs to have them.
    begin = time.thread_time()
    times = frame(self, number)
    spent.append(1e3 * (time.thread_time() - begin))
    return times

Session.frame = timed
assert call(sys.argv[1:]) == 0
print(*spent)
"""


@pytest.mark.parametrize("technique", ["srp", pytest.param("direct", marks=pytest.mark.slow)])
def test_the_harness_costs_little_of_a_frame(technique: str, tmp_path: Path) -> None:
    """What Python computes for a frame is under 5 % of its kernels' time, at full size.

    In a process of its own: one that ran many tests has much to look through and tidy up.
    """
    small = ("--set", "srp.transport_rays=32", "--set", "srp.relight_samples=128")
    asked = [
        *("run", "--no-quality", "--technique", technique, "--receivers", "2000", "--quiet"),
        *(small if technique == "srp" else ()),
        *("--frames", "12", "--warmup", "3", "--out", str(tmp_path / "out")),
        *("--cache-dir", str(tmp_path / "cache")),
    ]
    ran = subprocess.run(
        [sys.executable, "-c", HARNESS, *asked], capture_output=True, text=True, check=True
    )
    spent = [float(word) for word in ran.stdout.split()]
    samples = pd.read_csv(tmp_path / "out" / "samples.csv")
    kernels = samples.groupby("frame")["time_ms"].sum()
    assert len(spent) >= 12
    assert 0 < np.median(spent[-12:]) < 0.05 * kernels.median()
