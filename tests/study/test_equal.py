"""Equal cost, equal error: the search, the knobs that techniques declare, what is chosen."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest

from gibench.cli.main import call
from gibench.profiles import load_profile
from gibench.scene.load import load_scene
from gibench.study.experiments import equal
from gibench.study.experiments.common import Context, Measuring
from gibench.study.ladder import nearest, off, search
from gibench.study.site import Site
from gibench.techniques.registry import find_technique, steps, techniques
from gibench.work import Worker


@pytest.mark.parametrize("rising", [True, False])
def test_the_search_finds_the_nearest_rung_of_a_ladder(rng, rising):
    """Of figures that only rise or only fall, by bisection, whatever the ladder and the target."""
    for _ in range(300):
        rungs = int(rng.integers(1, 40))
        figures = np.cumsum(rng.uniform(0.05, 1.0, rungs)) + 0.1
        figures = figures if rising else figures[::-1]
        target = float(np.exp(rng.uniform(np.log(0.05), np.log(50))))
        asked = []

        def measure(rung, figures=figures, asked=asked):
            asked.append(rung)
            return float(figures[rung])

        found = search(rungs, measure, target, rising=rising, most=99)
        assert len(asked) == len(set(asked)) <= math.floor(math.log2(rungs)) + 1
        best = min(off(float(value), target) for value in figures)
        got = off(found[nearest(found, target)], target)
        # The nearest of all, but where a search ended early: it was within 5 % then.
        assert got == pytest.approx(best) or got <= math.log(1.05)


def test_a_rung_that_cannot_run_is_too_dear():
    """Times double; from the fifth rung on memory does not suffice. The target lies beyond them."""
    for rising, figure in ((True, lambda n: 2.0**n), (False, lambda n: 2.0**-n)):
        found = search(
            16, lambda n, f=figure: f(n) if n < 5 else math.inf, figure(9), rising=rising
        )
        assert nearest(found, figure(9)) == 4


def test_steps_are_even_in_ratio():
    found = steps(0.25, 16.0, 13)
    np.testing.assert_allclose(np.diff(np.log(found)), np.log(64) / 12, rtol=2e-3)
    assert found[0] == 0.25 and found[-1] == 16.0
    whole = steps(2, 128, 13, whole=True)
    assert all(isinstance(value, int) for value in whole) and list(whole) == sorted(set(whole))


@pytest.mark.parametrize("name", ["cornell-box", "hall"])
def test_every_rung_of_every_technique_is_accepted(name):
    scene, turned = load_scene(name), 0
    for spec in techniques().values():
        knobs = spec.knobs(scene)
        for knob in knobs:
            assert len(set(knob.rungs)) == len(knob.rungs) > 1
        for values in product(*(knob.rungs for knob in knobs)):
            own = dict(zip((knob.setting for knob in knobs), values, strict=True))
            spec.check(scene, spec.settings(own))
        turned += bool(knobs)
    assert turned >= 6  # all but direct


@pytest.fixture
def point(tmp_path):
    context = Context((load_profile("vega56"),), Site(tmp_path), scenes=("cornell-box",))
    (found,) = [p for p in equal._points(context) if p.job.technique == "ddgi"]
    return context, Measuring(found)


def time_of(context, job, worker):
    return 1e-4 * job.settings.rays * job.settings.probes


def error_of(context, job, worker):
    """More rays help less than more probes do, up to a point."""
    return 4.0 / job.settings.rays**0.3 / job.settings.probes**0.35


def figures_of(context, job, worker):
    row = dict.fromkeys(("rel_l2_noise", "bias", "flip", "memory_bytes"), 0.0)
    error = error_of(context, job, worker)
    return {**row, "rel_l2": error, "reason": ""}, np.ones((3, 3))


@pytest.mark.parametrize(("target", "met"), [(3.0, True), (40.0, True), (1e-3, False)])
def test_of_settings_at_the_same_cost_the_truest_is_taken(point, monkeypatch, target, met):
    context, unit = point
    monkeypatch.setattr(equal, "_time_ms", time_of)
    monkeypatch.setattr(equal, "_error_of", error_of)
    monkeypatch.setattr(equal, "_judged", figures_of)
    context = replace(context, target=target)
    (row,) = equal._equal_time(context, unit, Worker()).rows
    assert row["met"] == met
    rays, probes = (knob.rungs for knob in find_technique("ddgi").knobs(load_scene("cornell-box")))
    if met:
        assert off(row["gi_ms"], target) <= math.log(1.1)
        # No other number of probes, at the rays that come nearest, is truer.
        for count in probes:
            ms, few = min(
                ((1e-4 * n * count, n) for n in rays), key=lambda one: off(one[0], target)
            )
            if off(ms, target) <= math.log(1.05):
                assert row["rel_l2"] <= 4.0 / few**0.3 / count**0.35 + 1e-12
    else:
        assert row["gi_ms"] == pytest.approx(1e-4 * rays[0] * probes[0])
    assert row["tried"] <= 3 * 5


def test_a_time_that_is_another_when_it_is_measured_again_is_told(point, monkeypatch):
    context, unit = point
    measured = []

    def drifting(context, job, worker):
        measured.append(job)
        return time_of(context, job, worker) * measured.count(job)

    monkeypatch.setattr(equal, "_time_ms", drifting)
    monkeypatch.setattr(equal, "_error_of", error_of)
    monkeypatch.setattr(equal, "_judged", figures_of)
    (row,) = equal._equal_time(replace(context, target=3.0), unit, Worker()).rows
    assert row["gi_ms"] > 5.0 and not row["met"]


def test_of_settings_equally_far_off_the_cheapest_is_taken(point, monkeypatch):
    context, unit = point
    monkeypatch.setattr(equal, "_time_ms", time_of)
    monkeypatch.setattr(equal, "_error_of", error_of)
    monkeypatch.setattr(equal, "_judged", figures_of)
    (row,) = equal._equal_error(replace(context, target=0.12), unit, Worker()).rows
    assert row["met"] and off(row["rel_l2"], 0.12) <= math.log(1.1)
    # Probes help more for their cost: the most of them, at the fewest rays.
    assert "probes=432" in row["settings"]


@pytest.mark.slow
@pytest.mark.drawn
def test_the_whole_of_it(tmp_path, monkeypatch, capsys):
    """One technique at small sizes: table, pictures, FLIP; and targets that are refused."""
    monkeypatch.setattr(equal, "techniques", lambda: {"ddgi": find_technique("ddgi")})
    quick = ["--quick", "--target-error", "1", "--cache-dir", str(tmp_path / "cache")]
    command = ["experiment", "equal-error", *quick, "--target", "0.5", "--out", str(tmp_path / "o")]
    assert call(command) == 0
    (row,) = pd.read_csv(tmp_path / "o" / "equal-error.csv").to_dict("records")
    assert row["status"] == "ok" and row["gi_ms"] > 0 and 0 < row["rel_l2"] < 2
    assert row["tried"] <= 2 and "rays=" in row["settings"]
    text = (tmp_path / "o" / "equal-error.md").read_text()
    assert "## cornell-box, profile vega56: 50.0 % off the truth" in text
    assert "| ddgi |" in text and "![cornell-box-vega56](cornell-box-vega56.png)" in text
    assert (tmp_path / "o" / "cornell-box-vega56.png").stat().st_size > 10_000
    capsys.readouterr()
    for name, target, what in (
        ("equal-time", "0", "met by nothing"),
        ("equal-time", "nan", "is not a number"),
        ("sh-order", "3", "has no target"),
    ):
        assert call(["experiment", name, *quick, "--target", target]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and what in told
