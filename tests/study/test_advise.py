"""What fits a budget, and what nothing else beats."""

from __future__ import annotations

import json
import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gibench.cli.main import call
from gibench.profiles import load_profile
from gibench.report.limits import METRICS, in_limits, lifted, lifted_in_words, read_limits
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


def test_what_has_no_light_or_has_not_settled_is_passed_over():
    rows = pd.DataFrame(
        [
            row("direct", 1.0, 5, 1.0, gi_ms=0.0, settled=True, frames=8),
            row("early", 2.0, 5, 0.01, gi_ms=1.0, settled=False, frames=16),
            row("slow", 50.0, 5, 0.1, gi_ms=20.0, settled=True, frames=64),
        ]
    )
    table = advice(rows, within(33.3))
    assert not table["fits"].any()
    told = dict(zip(table["technique"], table["passed_over"], strict=True))
    assert told == {
        "direct": "no global illumination",
        "early": "not settled after 16 frames",
        "slow": "",
    }
    assert "nearest is slow" in str(misfit(table, within(33.3)))
    assert fits(advice(rows, within(60.0))) == {"slow"}
    few = advice(rows[:2], within(33.3))
    assert "nothing with global illumination ran and settled" in str(misfit(few, within(33.3)))


def within(ms):
    return read_limits(ms, None, ())


def test_the_best_that_fits_comes_first():
    table = advice(ROWS, within(33.3))
    assert table["technique"].tolist() == ["b", "d", "a", "c", "e"]
    assert table["fits"].tolist() == [True, True, True, False, False]
    assert table["pareto"].tolist() == [True, False, True, True, False]
    assert misfit(table, within(33.3)) is None


def test_a_budget_that_nothing_meets_names_what_comes_nearest():
    told = misfit(advice(ROWS, within(5.0)), within(5.0))
    assert re.search(r"meets 5 ms.*nearest is a \(default\).*10\.0 ms", str(told))
    assert told is not None and told.exit_code == 3
    assert "nothing could run: too large" in str(
        misfit(advice(ROWS[-1:], within(5.0)), within(5.0))
    )


MANY = pd.DataFrame(
    [
        row("a", 10.0, 8 * 2**20, 0.30, gi_ms=1.0, bake_seconds=0.0, leak=0.00),
        row("b", 30.0, 16 * 2**20, 0.10, gi_ms=4.0, bake_seconds=0.0, leak=0.01),
        row("c", 20.0, 40 * 2**20, 0.05, gi_ms=2.0, bake_seconds=60.0, leak=0.05),
        row("d", 25.0, 80 * 2**20, 0.20, gi_ms=2.5, bake_seconds=10.0, leak=0.00),
    ]
)


def fits(table):
    return set(table.loc[table["fits"], "technique"])


def test_limits_in_any_combination():
    for asked, wanted in (
        (["gi_ms=3"], {"a", "c", "d"}),
        (["gi_ms=3", "memory_mib=50"], {"a", "c"}),
        (["gi_ms=3", "memory_mib=50", "bake_s=30"], {"a"}),
        (["error=0.2"], {"b", "c", "d"}),
        (["error=0.2", "leak=0.02", "frame_ms=26"], {"d"}),
        (["leak=0.02", "memory_mib=7"], set()),
    ):
        limits = read_limits(None, None, asked)
        assert fits(advice(MANY, limits)) == wanted, asked
    assert [one.metric.name for one in read_limits(None, None, ())] == ["frame_ms"]
    assert in_limits(read_limits(None, 3.0, ["memory_mib=32", "error=0.15"])) == (
        "3 ms of global illumination, 32 MiB and 15 % off the truth"
    )


def test_the_front_is_of_what_is_limited_and_of_time_memory_and_error():
    """d is beaten by c in time, GI, memory and error; where bakes or leaks count, it is not."""
    front = advice(MANY, read_limits(None, None, ["gi_ms=3"]))
    assert set(front.loc[front["pareto"], "technique"]) == {"a", "b", "c"}
    front = advice(MANY, read_limits(None, None, ["gi_ms=3", "bake_s=100"]))
    assert set(front.loc[front["pareto"], "technique"]) == {"a", "b", "c", "d"}


def test_what_one_limit_lifted_would_let_in():
    limits = read_limits(None, None, ["gi_ms=3", "memory_mib=32"])
    more = lifted(advice(MANY, limits), limits)
    assert more["limit"].tolist() == ["gi_ms", "memory_mib"]
    assert more["technique"].tolist() == ["b", "c"]
    assert more["needed"].tolist() == [4.0, 40.0]
    np.testing.assert_allclose(more["by"], [1 / 3, 0.25])
    said = lifted_in_words(more.iloc[0])
    assert said.startswith("with 4.00 ms of global illumination instead of 3 ms of global")
    assert "(+33 %) b (default) at 1,000 receivers would fit, 10.0 % off the truth" in said
    # As told, the raised limit lets it in.
    close = dict(more.iloc[0], limit="frame_ms", most=33.3, needed=33.349, by=33.349 / 33.3 - 1)
    assert lifted_in_words(close).startswith(
        "with 33.4 ms a frame instead of 33.3 ms a frame (+1 %)"
    )
    # What fits is the truest already: nothing to gain.
    limits = read_limits(None, None, ["gi_ms=3", "memory_mib=50"])
    assert lifted(advice(MANY, limits), limits).empty
    # Two limits stand in the way of everything: no single one helps.
    limits = read_limits(None, None, ["memory_mib=4", "gi_ms=0.5"])
    assert lifted(advice(MANY, limits), limits).empty


def test_wrong_budgets_are_told_in_one_line(tmp_path, capsys):
    cache = ["--cache-dir", str(tmp_path / "cache"), "--out", str(tmp_path / "a")]
    wrong = {
        "speed=3": "no metric called 'speed'",
        "leak": "is no budget",
        "leak=much": "is not a number",
        **{
            f"{name}={value}": f"{value} is no budget"
            for name in METRICS
            for value in ("0", "-1", "nan")
        },
    }
    for budget, what in wrong.items():
        assert call(["advise", *SMALL, *cache, "--budget", budget]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and what in told, budget
    assert call(["advise", *SMALL, *cache, "--gi-budget-ms", "0"]) == 2
    assert "--gi-budget-ms 0 is no time" in capsys.readouterr().err
    assert call(["advise", *SMALL, *cache, "--budget", "leak=0.02"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "'cornell-box' has no dark region" in told
    assert not (tmp_path / "a").exists()


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


@pytest.mark.drawn
def test_advise_on_the_command_line(tmp_path, monkeypatch, capsys):
    cache = ["--cache-dir", str(tmp_path / "cache")]
    fits = ["advise", *SMALL, *cache, "--budget-ms", "10000", "--out", str(tmp_path / "a")]
    assert call(fits) == 0
    told = capsys.readouterr().out
    assert "has the least error within 10000 ms a frame" in " ".join(told.split())
    assert "none is a time of the modelled device" in " ".join(told.split())
    table = pd.read_csv(tmp_path / "a/advice.csv")
    assert dict(zip(table["technique"], table["fits"], strict=True)) == {
        "srp": True,
        "direct": False,
    }
    assert "no global illumination" in (tmp_path / "a/advice.md").read_text()
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
    for budget, wrong in (("0", "is no time"), ("-3", "is no time"), ("nan", "is not a number")):
        assert call(["advise", *SMALL, *cache, "--budget-ms", budget]) == 2
        assert wrong in capsys.readouterr().err


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
        *SMALL[:10],
        *SMALL[12:],
        "--probes",
        "6",
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
