"""Projections held against measured times: the launches, what is frozen, how it is scored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import correlate2d

from gibench.cli.main import call
from gibench.errors import BadInput, CheckFailed
from gibench.profiles import load_profile
from gibench.project.unknowns import POINTS
from gibench.study.validation import convolution, frozen, opendwarfs, published, score
from gibench.trace.analysis import wave_streams
from gibench.trace.request import Sampling
from gibench.trace.trace import trace_launch

WHOLE = Sampling(runs=1, length=1 << 20, whole=True, unroll=True)


@pytest.mark.parametrize(
    "row",
    [  # block, tile, read_only, padding, staged, constant
        (48, 2, 1, 2, 1, 0, 0, 1),
        (16, 4, 3, 2, 0, 1, 1, 1),
        pytest.param((16, 1, 1, 1, 0, 0, 0, 1), marks=pytest.mark.slow),
        pytest.param((16, 2, 2, 1, 0, 0, 1, 1), marks=pytest.mark.slow),
    ],
)
def test_the_convolution_is_one_whatever_its_configuration(
    row: tuple[int, ...], rng: np.random.Generator
) -> None:
    side = 35  # no multiple of any block
    image = rng.random((side + 14, side + 14)).astype(np.float32)
    weights = rng.normal(size=(15, 15)).astype(np.float32)
    values = dict(zip(convolution.KEYS, row, strict=True))
    trace = trace_launch(convolution.request(values, side, (image, weights)), WHOLE)
    expected = correlate2d(image.astype(np.float64), weights.astype(np.float64), "valid")
    found = trace.outputs["output"][:side, :side]
    assert np.abs(found - expected).max() < 1e-3
    assert wave_streams(trace, 32).outside == 0


def test_the_sample_of_configurations_is_the_same_every_time() -> None:
    table = convolution.measured()
    chosen = convolution.sample(table)
    assert len(table) == 4362 and len(chosen) == convolution.SAMPLE
    assert (convolution.sample(table).index == chosen.index).all()


def test_rows_are_predicted_by_the_rule() -> None:
    rows = published.rows()
    assert len(rows) == 9
    assert sum("cluster_projection" in row.name for row in rows) == 2
    assert not any("receivers" in row.name or "frame" in row.name for row in rows)
    growth = next(row for row in rows if "probes" in row.name)
    assert len(growth.added) == len(growth.taken) == 3
    assert all(sizes.probes == 200 for each in growth.added for _, sizes in each)


@pytest.mark.parametrize("name", ("probe_update", "cluster_projection", "irradiance_transport"))
def test_made_up_data_keeps_kernels_inside_their_buffers(name: str) -> None:
    sizes = published.Sizes(6, 9, 40, 700, 5, 31, 2.5, half=name != "probe_update")
    request = published.request(name, sizes, load_profile("iphone7"))
    trace = trace_launch(request, Sampling(runs=1, length=8, unroll=True))
    streams = wave_streams(trace, 32)
    assert streams.outside == 0 and streams.sectors.sum() > 0
    assert streams.total_groups == {"probe_update": 6, "cluster_projection": 1}.get(name, 3)


def test_features_alone_bound_a_kernel() -> None:
    row = opendwarfs.measured().iloc[0]
    machine = load_profile("gtx-1080").machine
    assert machine is not None
    some = opendwarfs.bounded(row, machine)
    more = row.copy()
    more["total_instruction_count"] *= 100
    more["total_memory_footprint"] *= 100
    assert (opendwarfs.bounded(more, machine).times > some.times).all()
    assert (some.times >= machine.launch_us.low * 1e-3).all()


@pytest.fixture
def made(rng: np.random.Generator) -> tuple[pd.DataFrame, np.ndarray]:
    """Three rows of one device: one to ten, two alike and unknown."""
    nominal = np.array([1.0, 10.0, 10.0])
    times = nominal[:, None] * rng.uniform(0.9, 1.1, (3, POINTS))
    table = pd.DataFrame(
        {
            "set": frozen.CONVOLUTION,
            "name": ["a", "b", "c"],
            "profile": "rtx-a6000",
            "low_ms": nominal * 0.9,
            "nominal_ms": nominal,
            "high_ms": nominal * 1.1,
            "bound_by": ["DRAM", "DRAM", "latency"],
            "driven_by": "",
            "verdict": ["range", "range", "cannot tell"],
            "reason": "",
        }
    )
    return table, times


def test_what_was_frozen_is_thawed_and_nothing_else(made, tmp_path: Path) -> None:
    table, times = made
    with pytest.raises(BadInput, match="no frozen predictions"):
        frozen.thaw(tmp_path)
    frozen.freeze(tmp_path, table, times)
    found = frozen.thaw(tmp_path)
    assert found.table["nominal_ms"].tolist() == table["nominal_ms"].tolist()
    assert np.allclose(found.times, times, rtol=1e-6)
    assert found.hashes["profile rtx-a6000"] == load_profile("rtx-a6000").machine_hash
    text = (tmp_path / frozen.TABLE).read_text()
    (tmp_path / frozen.TABLE).write_text(text.replace("10", "11"))
    with pytest.raises(CheckFailed, match="not what was frozen"):
        frozen.thaw(tmp_path)


def test_scores_by_hand(made) -> None:
    table, times = made
    predictions = frozen.Predictions(table, times, {})
    key = (frozen.CONVOLUTION, "rtx-a6000")
    # Inside; outside by a fifth; inside, but it could not be told.
    rows = score.scored(predictions, {(*key, "a"): 1.05, (*key, "b"): 12.5, (*key, "c"): 10.0})
    figures = score.summary(rows, times).iloc[0]
    assert figures["told"] == pytest.approx(2 / 3)
    assert figures["inside_told"] == 0.5 and figures["inside_all"] == pytest.approx(1 / 3)
    assert figures["median_width"] == pytest.approx(1.1 / 0.9)
    assert figures["error"] == pytest.approx((0.05 / 1.05 + 0.2 + 0) / 3)
    assert figures["error_throughput"] == pytest.approx((0.05 / 1.05 + 0.2) / 2)
    assert (figures["sure_pairs"], figures["sure_right"]) == (2, 1.0)
    assert (figures["apart_pairs"], figures["apart_sure"]) == (2, 1.0)
    # The other way round: both verdicts are wrong.
    wrong = score.scored(predictions, {(*key, "a"): 20.0, (*key, "b"): 2.0, (*key, "c"): 2.01})
    figures = score.summary(wrong, times).iloc[0]
    assert figures["sure_right"] == 0.0 and figures["apart_sure"] == 1.0
    # What was not measured is left out; ranks are of what has a nominal time.
    places = range(5)
    table = pd.DataFrame(
        {
            "set": key[0],
            "profile": key[1],
            "name": list("abcde"),
            "low_ms": 1.0,
            "high_ms": 9.0,
            "nominal_ms": [1.0, 2.0, np.nan, 4.0, 5.0],
            "bound_by": "DRAM",
            "driven_by": "",
            "verdict": ["range", "range", "cannot tell", "range", "range"],
            "reason": "",
        }
    )
    five = frozen.Predictions(table, np.tile(np.arange(1.0, 6.0)[:, None], (1, 128)), {})
    measured = {(*key, name): float(place) + 1 for name, place in zip("abcde", places, strict=True)}
    figures = score.summary(score.scored(five, measured), five.times).iloc[0]
    assert figures["rank"] == pytest.approx(1.0)
    assert len(score.scored(predictions, {(*key, "b"): 12.5})) == 1


def test_the_command_scores_a_folder(made, tmp_path: Path, capsys) -> None:
    table, times = made
    named = convolution.sample(convolution.measured()).iloc[:3]
    table = table.assign(name=[frozen.convolution_name(row) for _, row in named.iterrows()])
    frozen.freeze(tmp_path / "p", table, times)
    out = tmp_path / "out"
    given = ["validate-projection", "--predictions", str(tmp_path / "p"), "--out", str(out)]
    assert call(given) == 0
    assert "SHA-256" in capsys.readouterr().out
    assert len(pd.read_csv(out / "rows.csv")) == 3
    assert call(["validate-projection", "--predictions", str(tmp_path)]) == 2
    assert "no frozen predictions" in capsys.readouterr().err


def test_growths_are_differences_at_every_point(tmp_path: Path) -> None:
    row = next(row for row in published.rows() if row.profile == "vega56")
    small = published.Sizes(4, 4, 30, 600, 4, 24, 2, half=False)
    large = replace(small, coefficients=16)
    pick = ("cluster_projection",)
    given = replace(
        row, added=[[(n, large) for n in pick]] * 3, taken=[[(n, small) for n in pick]] * 3
    )
    total = frozen._growth(given, load_profile("vega56"), tmp_path)
    assert total.times.shape == (POINTS,) and (total.times > 0).all()
    assert total.times[0] < 0.1
    assert len(list(tmp_path.glob("trace-*.npz"))) == 2  # each launch is traced once
