"""Which one: the cheapest and the truest within the budgets, and what does not compete."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest

from gibench.report.projected import WHOLE_FRAME, WHOLE_GI
from gibench.report.which_one import PROJECTED_GI, Answer, Budgets, answers, cells, headings, shown

NAN = float("nan")


def frame(number: int, technique: str, gi: float, ms: float, **changes: Any) -> dict[str, Any]:
    base = {
        "configuration": number,
        "technique": technique,
        "variant": "tuned",
        "scene": "box",
        "profile": "phone",
        "receivers": 100,
        "layout": "wide",
        "workgroup_size": 64,
        "gi_ms": gi,
        "median_ms": ms,
        "p99_ms": 1.5 * ms,
        "longest_ms": 2.0 * ms,
        "frames": 100,
        "memory_bytes": 3 << 20,
        "rest": "",
        "status": "ok",
        "reason": "",
    }
    return base | changes


def asked(
    rows: list[dict[str, Any]],
    errors: dict[int, float] | None = None,
    unsettled: dict[int, str] | None = None,
    axes: tuple[str, ...] = (),
    leaks: dict[int, tuple[float, float]] | None = None,
    projected: pd.DataFrame | None = None,
) -> Answer:
    record = {
        "profiles": [{"name": "phone", "title": "A phone"}],
        "environment": {"cpu": "A CPU"},
        "axes": axes,
        "configurations": [
            {"configuration": row["configuration"], "bake_seconds": 7.4} for row in rows
        ],
    }
    told = unsettled or {}
    table = pd.DataFrame(
        [
            {"configuration": number, "rel_l2": error, "bias": -error, "uncovered": 0.0}
            | {"unsettled": told.get(number, NAN)}
            | dict(zip(("leak", "dark_area"), (leaks or {}).get(number, (NAN, NAN)), strict=True))
            for number, error in (errors or {}).items()
        ]
    )
    measured, budgets = table if errors else None, Budgets(33.0, 3.0)
    (found,) = answers(pd.DataFrame(rows), record, measured, budgets, projected)
    return found


def test_cheapest_and_truest_are_named() -> None:
    rows = [frame(1, "one", 1.0, 9.0), frame(2, "two", 2.0, 9.0), frame(3, "three", 9.0, 9.0)]
    found = asked(rows, {1: 0.2, 2: 0.1, 3: 0.01})
    assert "the cheapest within 3 ms of global illumination and 33 ms a frame" in found.sentence
    assert "is one (1.0 ms of 9.0, 20 % off the truth), the truest two (2.0 ms" in found.sentence
    assert "three (" not in found.sentence
    assert found.sentence.startswith("On this machine (A CPU), at the limits of A phone, ")


def test_one_may_be_both() -> None:
    rows = [frame(1, "one", 1.0, 9.0), frame(2, "two", 2.0, 9.0)]
    assert "the cheapest and the truest" in asked(rows, {1: 0.1, 2: 0.2}).sentence
    assert "errors were not measured" in asked(rows).sentence


@pytest.mark.parametrize(
    ("rows", "over"),
    [
        ([frame(1, "one", 6.0, 9.0), frame(2, "two", 9.0, 9.0)], "one (6.0 ms of 9.0), 2.00"),
        ([frame(1, "one", 1.0, 99.0), frame(2, "two", 7.5, 9.0)], "two (7.5 ms of 9.0), 2.50"),
    ],
)
def test_where_none_fits_the_nearest_is_told(rows: list[dict[str, Any]], over: str) -> None:
    assert f"none fits within 3 ms of global illumination and 33 ms a frame; nearest comes {over} "\
        "times over." in asked(rows).sentence  # fmt: skip


def test_what_has_not_settled_does_not_compete() -> None:
    rows = [frame(1, "one", 1.0, 9.0), frame(2, "two", 2.0, 9.0)]
    found = asked(rows, {1: 0.01, 2: 0.3}, unsettled={1: "not settled after 512 frames"})
    assert "one (" not in found.sentence
    first = found.table.iloc[0]
    assert pd.isna(first["rel_l2"])
    assert cells(first)[headings(found.table).index("error")] == "not settled after 512 frames"
    timed = [frame(1, "one", 1.0, 9.0, rest="not at rest after 80 frames"), rows[1]]
    assert asked(timed).table["status"][0] == "not settled after 80 frames"
    moving = [frame(1, "one", 1.0, 9.0, rest="never at rest: lights move"), rows[1]]
    assert asked(moving).table["status"][0] == ""


def test_what_did_not_run_or_has_no_gi_does_not_compete() -> None:
    rows = [
        frame(1, "direct", 0.0, 3.0),
        frame(2, "two", NAN, NAN, status="skipped", reason="too big"),
    ]
    found = asked(rows)
    assert list(found.table["status"]) == ["no global illumination", "too big"]
    assert "nothing can be said" in found.sentence


def test_names_say_what_differs() -> None:
    rows = [frame(1, "one", 1.0, 9.0, order=2), frame(2, "one", 2.0, 9.0, order=7)]
    names = list(asked(rows, axes=("order",)).table["name"])
    assert names[0] != names[1]
    assert "7" in names[1]


def test_a_row_has_its_figures() -> None:
    found = asked([frame(1, "one", 1.234, 9.0)], {1: 0.2})
    told = dict(zip(headings(found.table), cells(found.table.iloc[0]), strict=True))
    assert told["GI ms"] == "1.23"
    assert told["worst 1 % of frames ms"] == "13.50"
    assert told["MiB"] == "3.0"
    assert told["bake s"] == "7"
    assert told["error"] == "20.0 %"
    assert told["bias"] == "-20.0 %"


def test_of_few_frames_the_longest_is_told_and_called_so():
    few = asked([frame(1, "one", 1.0, 9.0, frames=30), frame(2, "two", 1.0, 9.0, frames=7)])
    told = dict(zip(headings(few.table), cells(few.table.iloc[0]), strict=True))
    assert told["longest of 7, 30 frames ms"] == "18.00"
    mixed = asked([frame(1, "one", 1.0, 9.0, frames=30), frame(2, "two", 1.0, 9.0)])
    at = headings(mixed.table).index("worst 1 % of frames ms (longest of fewer than 100)")
    assert [cells(row)[at] for _, row in mixed.table.iterrows()] == ["18.00", "13.50"]


def test_leak_is_told_where_there_is_anywhere_to_leak_to() -> None:
    rows = [frame(n, f"t{n}", 1.0, 9.0) for n in (1, 2, 3)]
    leaks = {1: (0.034, 0.2), 2: (NAN, 0.0)}
    unsettled = {3: "not settled after 512 frames"}
    found = asked(rows, {1: 0.1, 2: 0.1, 3: 0.1}, unsettled, leaks=leaks | {3: (0.5, 0.2)})
    at = headings(found.table).index("leak")
    assert [cells(row)[at] for _, row in found.table.iterrows()] == ["3.4 %", "-", ""]
    assert cells(asked(rows[:1]).table.iloc[0])[at] == ""


def test_projected_ranges_have_a_column_and_a_sentence_of_their_own() -> None:
    rows = [frame(n, f"t{n}", 1.0, 9.0) for n in (1, 2, 3, 4, 5)]
    rows.append(frame(6, "direct", 0.0, 9.0))
    ranges = [(1.0, 2.9, "range"), (3.1, 9.0, "range"), (2.0, 4.0, "range"),
              (0.1, 2.0, "cannot tell"), (NAN, NAN, "cannot tell"),
              (1.0, 2.0, "range")]  # fmt: skip
    table = pd.DataFrame(
        {
            "configuration": number,
            "device": "a-phone",
            "pass": name,
            "projected_low_ms": low,
            "projected_nominal_ms": NAN,
            "projected_high_ms": high,
            "verdict": verdict,
        }
        for name, factor in ((WHOLE_GI, 1), (WHOLE_FRAME, 50))
        for number, (low, high, verdict) in enumerate(ranges, 1)
        for low, high in [(factor * low, factor * high)]
    )
    found = asked(rows, projected=table)
    assert found.projected == (
        "Projected, not measured: within 3 ms of global illumination on a-phone, fits: t1; does "
        "not fit: t2; cannot tell: t3, t4, t5."
    )
    assert "a-phone" not in found.sentence and found.sentence == asked(rows).sentence
    titles, lines = shown(found)
    at = titles.index(PROJECTED_GI)
    assert [line[at] for line in lines][:2] == ["1.000 to 2.900 ms", "3.100 to 9.000 ms"]
    assert lines[4][at] == "cannot tell" and lines[5][at] == ""
    assert PROJECTED_GI not in shown(asked(rows))[0]
    assert len(shown(asked(rows))[1][0]) == len(titles) - 1
    two = pd.concat([table, table.assign(device="a-card")])
    assert lines[0][at] in shown(asked(rows, projected=two))[1][0][at]
    assert "a-card: 1.000" in shown(asked(rows, projected=two))[1][0][at]
    assert asked(rows, projected=two).projected.count("Projected, not measured") == 2
