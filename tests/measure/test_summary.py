"""Summaries of times, and what roofs make of work."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gibench.measure.statistics.summary import (
    Roofs,
    best_of,
    least_ms,
    moved,
    per_second,
    summarize,
)
from gibench.profiles import load_profile
from gibench.techniques.technique import Work

IPHONE, RADEON = load_profile("iphone7"), load_profile("radeon560")


@given(st.lists(st.floats(1e-3, 1e4), min_size=1, max_size=60))
def test_the_summary_is_in_order(times: list[float]) -> None:
    s = summarize(times)
    assert s.count == len(times)
    assert s.min_ms <= s.median_ms <= s.p95_ms <= s.p99_ms <= s.max_ms
    assert s.min_ms <= s.mean_ms * (1 + 1e-12) and s.mean_ms <= s.max_ms * (1 + 1e-12)


def test_the_summary_by_hand() -> None:
    s = summarize([4.0, 1.0, 2.0, 3.0, 10.0])
    assert (s.mean_ms, s.median_ms, s.min_ms, s.max_ms) == (4.0, 3.0, 1.0, 10.0)
    assert s.stdev_ms == pytest.approx(math.sqrt((0 + 9 + 4 + 1 + 36) / 4))
    assert s.p95_ms == pytest.approx(4.0 + 0.8 * 6.0)
    assert math.isnan(summarize([1.0]).stdev_ms)
    assert math.isnan(summarize([]).median_ms)


def test_the_roof_is_the_slowest_of_bytes_flops_and_rays() -> None:
    roofs = Roofs(
        read_gb_per_s=20, triad_gb_per_s=10, fma_gflop_per_s=100, launch_us=1, mrays_per_s=5
    )
    assert least_ms(Work(bytes_read=15e6, bytes_written=5e6), roofs) == pytest.approx(1.0)
    assert least_ms(Work(flops=2e8, bytes_read=2e7), roofs) == pytest.approx(2.0)
    assert least_ms(Work(flops=2e8, rays=2e4), roofs) == pytest.approx(4.0)
    assert math.isnan(least_ms(Work(), roofs))
    unmeasured = replace(roofs, mrays_per_s=math.nan)
    assert least_ms(Work(flops=2e8, rays=2e4), unmeasured) == pytest.approx(2.0)


def test_rates_and_moving_roofs() -> None:
    assert per_second(5e9, 500.0, 1e9) == pytest.approx(10.0)
    assert math.isnan(per_second(0, 1.0, 1e9))
    start = Roofs(20, 10, 100, 1.0, math.nan)
    end = Roofs(17, 10.5, 111, 5.0, math.nan)
    assert set(moved(start, end)) == {"read_gb_per_s", "fma_gflop_per_s"}
    assert moved(start, end)["read_gb_per_s"] == pytest.approx(-0.15)
    assert moved(start, start) == {}
    best = best_of(start, replace(end, mrays_per_s=3.0))
    assert (best.read_gb_per_s, best.fma_gflop_per_s, best.launch_us) == (20, 111, 1.0)
    assert best.mrays_per_s == 3.0
