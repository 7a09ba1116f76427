"""What was measured here beside its projection: orders by hand, and the command."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from gibench.cli.main import call
from gibench.study.validation import orders


@pytest.fixture
def passes() -> pd.DataFrame:
    """Two variants of a technique and one of another: passes ``a`` and ``b`` of GI, a camera."""
    rows = [
        *((1, "a", "gi", 1.0), (1, "b", "gi", 3.0), (1, "c", "camera", 100.0)),
        *((2, "a", "gi", 2.0), (2, "b", "gi", 3.1), (2, "c", "camera", 50.0)),
        *((3, "d", "gi", 40.0), (3, "e", "gi", float("nan"))),
    ]
    return pd.DataFrame(rows, columns=["configuration", "pass", "stage", "median_ms"])


@pytest.fixture
def projected() -> pd.DataFrame:
    names = {1: ("x", "published", None), 2: ("x", "tuned", "wide"), 3: ("y", "tuned", "wide")}
    rows = [
        *((1, "a", 0.5, 2.0, "range"), (1, "b", 4.0, 16.0, "range")),
        *((1, "c", 0.5, 2.0, "cannot tell"), (1, "(GI)", 2.0, 8.0, "range")),
        *((2, "a", 0.25, 1.0, "range"), (2, "b", 1.0, 9.0, "range")),
        *((2, "c", 10.0, 10.0, "range"), (2, "(GI)", 1.0, 4.0, "range")),
        *((3, "d", 5.0, 20.0, "range"), (3, "(GI)", 5.0, 20.0, "range")),
        *((3, "e", None, None, "cannot tell"), (3, "(frame)", 5.0, 20.0, "range")),
    ]
    columns = ["configuration", "pass", "projected_low_ms", "projected_high_ms", "verdict"]
    table = pd.DataFrame(rows, columns=columns)
    for place, column in enumerate(("technique", "variant", "layout")):
        table[column] = [names[number][place] for number in table["configuration"]]
    return table.assign(scene="box", device="this one", bound_by="DRAM")


def test_orders_by_hand(passes: pd.DataFrame, projected: pd.DataFrame) -> None:
    rows = orders.held_against(passes, projected, "PoCL")
    assert list(rows.columns) == list(orders.ROWS)
    assert len(rows) == 7 + 3  # neither whole frames nor what has no range or no time
    gi = rows[rows["pass"] == "(GI)"]
    assert gi["median_ms"].tolist() == [4.0, 5.1, 40.0]
    assert gi["inside"].tolist() == [True, False, False]
    found = orders.summary(rows).iloc[0]
    assert found["passes"] == 7 and found["orders"] == pytest.approx(2.0)
    assert found["told"] == pytest.approx(6 / 7)
    # a and b of the tuned one are 1.0 .. 9.0 and 0.25 .. 1.0: b alone is inside; a of the other.
    assert found["inside"] == pytest.approx(2 / 7)
    assert found["within_10"] == pytest.approx(6 / 7)  # a camera is 100 times off
    # Variants: a comes out the wrong way round, c too; b is measured alike.
    assert (found["variant_pairs"], found["variants_right"]) == (2, 0.0)
    # Techniques: of the tuned ones in one layout.
    assert (found["technique_pairs"], found["techniques_right"]) == (1, 1.0)


def test_the_command_reads_runs_that_were_projected(
    passes: pd.DataFrame, projected: pd.DataFrame, tmp_path: Path, capsys
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    needed = ("arguments", "seed", "environment", "profiles", "roofs", "configurations")
    record = {name: {} for name in needed} | {"device": {"platform": "Some runtime"}}
    (run / "run.json").write_text(json.dumps({"schema_version": 1, **record}))
    passes.to_csv(run / "passes.csv", index=False)
    assert call(["validate-projection", "--here", str(run)]) == 2
    told = capsys.readouterr().err
    assert "has no projected.csv" in told and "gibench project" in told
    projected.to_csv(run / "projected.csv", index=False)
    out = tmp_path / "out"
    assert call(["validate-projection", "--here", str(run), "--out", str(out)]) == 0
    assert "Some runtime" in capsys.readouterr().out
    assert len(pd.read_csv(out / "passes.csv")) == 10
    assert pd.read_csv(out / "orders.csv")["technique_pairs"].tolist() == [1]
