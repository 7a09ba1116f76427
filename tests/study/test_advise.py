"""What fits a budget, and what nothing else beats."""

from __future__ import annotations

import json
import re

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from gibench.cli.main import call
from gibench.profiles import load_profile
from gibench.scene.load import load_scene
from gibench.study import quality
from gibench.study.advise import advice, misfit, sweep
from gibench.study.pareto import pareto_front
from gibench.techniques.job import Shot
from gibench.techniques.registry import find_technique, techniques

COSTS = st.lists(st.tuples(*[st.integers(0, 4).map(float)] * 3), min_size=1, max_size=12)


@given(COSTS)
def test_the_front_is_what_nothing_beats(costs):
    front = pareto_front(np.array(costs))
    for i, mine in enumerate(costs):
        beaten = any(
            all(o <= m for o, m in zip(other, mine, strict=True)) and other != mine
            for other in costs
        )
        assert front[i] == (not beaten)


def test_what_has_no_figure_is_not_on_the_front():
    costs = np.array([[1.0, np.nan, 0.0], [2.0, 2.0, 2.0], [np.inf, 1.0, 1.0]])
    assert pareto_front(costs).tolist() == [False, True, False]


def row(technique, time, memory, error, **more):
    given = {"technique": technique, "settings": "default", "receivers": 1000, "region": "whole"}
    given |= {"time_ms": time, "memory_bytes": memory, "rel_l2": error, "status": "ok"}
    return {**given, "reason": "", "bias": 0.0, **more}


ROWS = pd.DataFrame(
    [
        row("a", 10.0, 5, 0.3),
        row("b", 30.0, 9, 0.1),
        row("c", 40.0, 9, 0.05),
        row("d", 31.0, 9, 0.2),
        row("b", 30.0, 9, 0.9, region="corner"),
        row("e", None, None, None, status="skipped", reason="too large"),
    ]
)


def test_the_best_that_fits_comes_first():
    table = advice(ROWS, 33.3)
    assert table["technique"].tolist() == ["b", "d", "a", "c", "e"]
    assert table["fits"].tolist() == [True, True, True, False, False]
    assert table["pareto"].tolist() == [True, False, True, True, False]
    assert misfit(table, 33.3) is None


def test_a_budget_that_nothing_meets_names_what_comes_nearest():
    told = misfit(advice(ROWS, 5.0), 5.0)
    assert re.search(r"meets 5 ms.*nearest is a \(default\).*10\.0 ms", str(told))
    assert told is not None and told.exit_code == 3
    assert "nothing could run: too large" in str(misfit(advice(ROWS[-1:], 5.0), 5.0))


def test_what_techniques_declare_is_tried_and_the_options_narrow_it():
    scene, specs = load_scene("cornell-box"), list(techniques().values())
    tried = sweep(
        *(load_profile("iphone7"), specs, "cornell-box", scene, ["tuned"], [1000, 500]),
        *({"sh_order": (), "probes": ()}, {}, Shot(), 0),
    )
    assert {c.technique for c in tried} == set(techniques())
    srp = [c for c in tried if c.technique == "srp"]
    assert {(c.settings.sh_order, c.receivers) for c in srp} == {
        (order, receivers) for order in (2, 4, 7) for receivers in (1000, 500)
    }
    # Receivers cost a technique without lightmap nothing: it is not tried with each number.
    assert {c.receivers for c in tried if c.technique == "direct"} == {1000}
    narrow = sweep(
        *(load_profile("iphone7"), [find_technique("srp")], "cornell-box", scene, ["tuned"], [500]),
        *({"sh_order": (3,), "probes": (9,)}, {"srp": {"storage": ("fp32",)}}, Shot(), 0),
    )
    assert [(c.settings.sh_order, c.settings.probes, c.settings.storage) for c in narrow] == [
        (3, 9, "fp32")
    ]


# As test_quality.py has it, so that what is built for one serves the other.
SMALL = (
    *("--receivers", "400", "--resolution", "48x32", "--target-error", "0.5", "--frames", "32"),
    *("-t", "srp", "-t", "direct", "--sh-order", "1", "--set", "srp.transport_rays=64"),
    *("--set", "srp.relight_samples=64", "--reference-paths", "16"),
)


def test_advise_on_the_command_line(tmp_path, monkeypatch, capsys):
    cache = ["--cache-dir", str(tmp_path / "cache")]
    fits = ["advise", *SMALL, *cache, "--budget-ms", "10000", "--out", str(tmp_path / "a")]
    assert call(fits) == 0
    told = capsys.readouterr().out
    assert "has the least error within 10000 ms" in " ".join(told.split())
    assert "none is a time of the modelled device" in " ".join(told.split())
    table = pd.read_csv(tmp_path / "a/advice.csv")
    assert table["fits"].all() and table["rel_l2"].is_monotonic_increasing
    for name in ("advice.md", "pareto.png", "pareto.svg"):
        assert (tmp_path / "a" / name).stat().st_size > 500
    monkeypatch.setattr(quality, "settle", None)  # another budget measures nothing again
    nothing = ["advise", *SMALL, *cache, "--budget-ms", "1e-6", "--out", str(tmp_path / "a"), "-q"]
    assert call(nothing) == 3
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "nearest is" in told
    assert not pd.read_csv(tmp_path / "a/advice.csv")["fits"].any()
    record = json.loads((tmp_path / "a/run.json").read_text())
    assert record["arguments"]["scene"] == "cornell-box" and record["environment"]["cpu"]
    assert call([*fits, "--seed", "5"]) == 2  # another run's folder
    assert "already holds another run" in capsys.readouterr().err
    for budget in ("0", "-3", "nan"):
        assert call(["advise", *SMALL, *cache, "--budget-ms", budget]) == 2
        assert "is no time" in capsys.readouterr().err


def test_an_interrupted_advice_goes_on(tmp_path, monkeypatch, capsys):
    """Ctrl-C while the second setting runs; the same command tries only that one again."""
    tried, settle = [], quality.settle

    def once_interrupted(job, *how):
        tried.append(job.variant)
        if tried == ["published", "tuned"]:
            raise KeyboardInterrupt
        return settle(job, *how)

    monkeypatch.setattr(quality, "settle", once_interrupted)
    command = [
        "advise",
        *SMALL[:8],
        *SMALL[-2:],
        "-t",
        "direct",
        "--variant",
        "published",
        "--variant",
        "tuned",
    ]
    command += ["--budget-ms", "10000", "--cache-dir", str(tmp_path / "cache")]
    command += ["--out", str(tmp_path / "a"), "-q"]
    assert call(command) == 130
    assert "1 of 2 settings were tried" in capsys.readouterr().err
    assert pd.read_csv(tmp_path / "a/advice.csv")["variant"].tolist() == ["published"]
    assert call(command) == 0
    assert tried == ["published", "tuned", "tuned"]
    table = pd.read_csv(tmp_path / "a/advice.csv")
    assert sorted(table["variant"]) == ["published", "tuned"] and table["fits"].all()
