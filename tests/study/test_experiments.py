"""The papers' experiments: their machinery, their analysis, and that they run."""

from __future__ import annotations

import json
import pickle
from itertools import product

import numpy as np
import pandas as pd
import pytest

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.profiles import load_profile
from gibench.study.experiments import EXPERIMENTS, common, scaling
from gibench.study.rows import Rows
from gibench.study.site import Site
from gibench.study.slope import fit_line
from gibench.techniques.registry import job_of


def test_rows_go_on_where_they_stopped(tmp_path):
    path = tmp_path / "x.csv"
    rows = Rows.at(path, ("name", "size"), ("value",))
    rows.add([{"name": "a", "size": 1, "value": 0.125}, {"name": "a", "size": 1, "value": None}])
    again = Rows.at(path, ("name", "size"), ("value",))
    assert again.done({"name": "a", "size": 1}) and not again.done({"name": "a", "size": 2})
    again.add([{"name": "a", "size": 2, "value": 3.0}])
    table = again.table()
    assert table["size"].tolist() == [1, 1, 2]
    assert table["value"][0] == 0.125 and np.isnan(table["value"][1])
    with pytest.raises(BadInput, match="other columns"):
        Rows.at(path, ("name",), ("value",))


def test_the_slopes_interval_holds_the_true_slope_as_often_as_it_says():
    rng = np.random.default_rng(11)
    x = np.arange(10.0)
    held = 0
    for _ in range(400):
        line = fit_line(x.tolist(), (2.0 * x + 5.0 + rng.normal(size=10)).tolist())
        held += line.low <= 2.0 <= line.high
    assert 0.91 < held / 400 < 0.985
    exact = fit_line([0.0, 1.0, 4.0], [1.0, 3.0, 9.0])
    assert exact.slope == pytest.approx(2) and exact.intercept == pytest.approx(1)
    assert fit_line([1.0, 2.0], [1.0, 2.0]) is None
    assert fit_line([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]) is None


def test_experiments_are_listed_and_unknown_ones_refused(capsys):
    assert call(["experiment"]) == 0
    told = capsys.readouterr().out
    assert all(name in told for name in EXPERIMENTS)
    assert call(["experiment", "speed-of-light"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "the experiments are frame-times, sh-order" in told


def test_paths_bound_an_experiments_reference(tmp_path, capsys):
    context = common.Context((), Site(tmp_path), target_error=0.01, reference_paths=24)
    asked = context.quality()
    assert (asked.target_error, asked.reference_paths) == (0.01, 24)
    assert call(["experiment", "sh-order", "--reference-paths", "7"]) == 2
    assert "7 paths give no standard error" in capsys.readouterr().err


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return ["--cache-dir", str(tmp_path_factory.mktemp("cache")), "--quick", "--target-error", "1"]


FILES = {
    "frame-times": ("frame-times.png", "frame-times.svg"),
    "sh-order": ("sh-order.png", "sh-order-pictures.png"),
    "probe-update": ("probe-update.png", "probe-update.svg"),
    "probe-density": ("probe-density.svg", "probe-density-pictures.png"),
    "receiver-reduction": ("receiver-reduction.png", "receiver-reduction-pictures.png"),
    "interpolation": ("interpolation-5.png",),
    "ray-budget": ("ray-budget.png", "ray-budget.svg", "ray-budget-samples.csv"),
    "light-field": ("light-field.png", "light-field.svg"),
    "convergence": ("convergence.png", "convergence-ms.png", "convergence-samples.csv"),
    "equal-time": ("cornell-box-vega56.png",),
    "equal-error": ("cornell-box-vega56.png",),
    "order-density": ("order-density.png", "order-density.svg"),
    "srp-error": ("srp-error.png", "srp-error.svg"),
    "surfel-links": ("surfel-links.png", "surfel-links.svg"),
    "surfel-bands": (),
    "surfel-frame": (),
    "surfel-memory": (),
    "surfel-density": ("surfel-density.png", "surfel-density.svg"),
    "surfel-spacing": ("surfel-spacing.png",),
    "surfel-gloss": ("surfel-gloss.png",),
    "surfel-failures": ("surfel-failures-spot.png", "surfel-failures-corridors.png"),
}


@pytest.mark.slow
@pytest.mark.drawn
@pytest.mark.parametrize("name", FILES)
def test_an_experiment_leaves_its_files_and_measures_nothing_twice(name, cache, tmp_path):
    command = ["experiment", name, *cache, "--out", str(tmp_path)]
    assert call([*command, "-q"]) == 0
    table = pd.read_csv(tmp_path / f"{name}.csv")
    waits = table[table["status"] == "skipped"]
    assert (table["status"].drop(waits.index) == "ok").all() and len(table) > len(waits)
    for one in waits.to_dict("records"):  # of experiments on all techniques, that of a long bake
        assert one["technique"] == "surfel-cache" and "takes minutes; bake it" in one["reason"]
    for file in FILES[name]:
        assert (tmp_path / file).stat().st_size > 1000
    text = (tmp_path / f"{name}.md").read_text()
    assert "No time below is one of a modelled device" in text and "> **Quick:**" in text
    written = (tmp_path / f"{name}.csv").stat().st_mtime_ns
    assert call([*command, "-q"]) == 0
    assert (tmp_path / f"{name}.csv").stat().st_mtime_ns == written
    assert call([*command, "-q", "--seed", "9"]) == 2  # another run's folder


def test_an_interrupted_experiment_goes_on(cache, tmp_path, monkeypatch, capsys):
    """Ctrl-C after five points; the same command measures the other four, and slopes come out."""
    monkeypatch.setattr(scaling, "_values", lambda context: {"probes": (1, 2, 4)})
    calls = []

    def fake(context, configuration, worker, own):
        if len(calls) == 5:
            calls.append("interrupted")
            raise KeyboardInterrupt
        calls.append(configuration)
        time = 1.0 + 0.5 * configuration.settings.probes
        return {"time_ms": time, "p95_ms": time, "frames": 3, "memory_bytes": 7}

    monkeypatch.setattr(scaling, "timed", fake)
    command = ["experiment", "scaling", *cache, "--out", str(tmp_path)]
    assert call(command) == 130
    assert "goes on from there" in capsys.readouterr().err
    assert len(pd.read_csv(tmp_path / "scaling.csv")) == 5
    assert "> **Interrupted:**" in (tmp_path / "scaling.md").read_text()
    assert call(command) == 0
    table = pd.read_csv(tmp_path / "scaling.csv")
    assert len(table) == 9 == len(calls) - 1
    assert set(table["profile"]) == {"iphone7", "radeon560", "vega56"}
    text = (tmp_path / "scaling.md").read_text()
    assert "| probes | iphone7 | 0.5 |" in text
    assert "Theirs, on their devices" in text and "49.3" in text and "[withheld]" not in text
    assert "Interrupted" not in text


def test_a_point_that_cannot_run_is_told_and_the_others_go_on(cache, tmp_path, monkeypatch):
    from gibench.errors import CannotRun

    monkeypatch.setattr(scaling, "_values", lambda context: {"probes": (1, 2)})

    def fake(context, configuration, worker, own):
        if configuration.settings.probes == 2:
            raise CannotRun("too large | for it")
        return {"time_ms": 1.0, "p95_ms": 1.0, "frames": 3, "memory_bytes": 7}

    monkeypatch.setattr(scaling, "timed", fake)
    assert call(["experiment", "scaling", *cache, "--out", str(tmp_path), "-q"]) == 0
    table = pd.read_csv(tmp_path / "scaling.csv")
    assert table["status"].tolist() == ["ok"] * 3 + ["skipped"] * 3
    text = (tmp_path / "scaling.md").read_text()
    assert "## Not measured" in text and "too large \\| for it" in text


def test_published_figures_hold_no_withheld_rows():
    for name, column in product(("frame_times", "srp_scaling"), ("source", "where")):
        table = common.published(name)
        assert table[column].notna().all()
        assert not table.astype(str).apply(lambda c: c.str.contains("withheld")).any().any()


def test_every_experiment_s_points_are_plain_data(tmp_path):
    profiles = (load_profile("vega56"),)
    context = common.Context(profiles, Site(tmp_path), scenes=("cornell-box",), quick=True)
    assert pickle.loads(pickle.dumps(context)) == context
    for experiment in EXPERIMENTS.values():
        points = list(experiment.points(context))
        assert points and pickle.loads(pickle.dumps(points)) == points
        for point in points:
            assert job_of(json.loads(json.dumps(point.job.record()))) == point.job
