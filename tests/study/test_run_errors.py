"""Errors of a run: a quick truth of some receivers, and a run that ends with its answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.standard_errors import pooled

import gibench
from gibench.bake.lightmap import cached_lightmap
from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.measure.plan.grid import grid
from gibench.profiles import load_profile
from gibench.reference.path_tracer import reference_irradiance
from gibench.report.which_one import cells, headings
from gibench.scene.lightmap import some_receivers
from gibench.scene.load import load_scene
from gibench.study import run_errors
from gibench.study.frozen import frozen
from gibench.study.kept_light import SettledLight
from gibench.study.run_errors import NO_LIGHT, QuickTruth, errors_of
from gibench.study.site import Site
from gibench.techniques.registry import find_technique
from gibench.work import Worker


def test_some_receivers_are_those_receivers(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = load_scene("cornell-box")
    lightmap = cached_lightmap(scene, 300, tmp_path)
    count = len(lightmap.receivers)
    chosen = np.sort(rng.choice(count, 40, replace=False))
    some = some_receivers(lightmap, chosen)
    np.testing.assert_array_equal(some.receivers.position, lightmap.receivers.position[chosen])
    starts = lightmap.fragments.start
    for mine, of in zip(range(len(chosen)), chosen, strict=True):
        own = slice(some.fragments.start[mine], some.fragments.start[mine + 1])
        all_of = slice(starts[of], starts[of + 1])
        np.testing.assert_array_equal(
            some.fragments.corners[own], lightmap.fragments.corners[all_of]
        )
        np.testing.assert_array_equal(
            some.fragments.triangle[own], lightmap.fragments.triangle[all_of]
        )
    still = frozen(scene, 0)
    part = reference_irradiance(still, some, paths=512, seed=3)
    whole = reference_irradiance(still, lightmap, paths=512, seed=4)
    off = part.value - whole.value[chosen]
    # The light's tail is fat, so that one receiver may be off by 5 of its standard errors; all of
    # them by as many as they say, or others than the chosen are compared.
    error = np.sqrt(pooled(part.stderr) ** 2 + pooled(whole.stderr)[chosen] ** 2)
    assert np.abs(off / error).max() < 12
    assert (off**2).mean() < 1.7**2 * (error**2).mean()
    other = part.value - whole.value[np.roll(chosen, 1)]
    assert (other**2).mean() > 4**2 * (error**2).mean()
    assert np.abs(off.mean()) < 5 * np.sqrt((error**2).mean() / len(chosen))


def test_a_run_ends_with_its_answer(tmp_path: Path) -> None:
    made = gibench.run(
        technique=["ddgi", "direct"],
        settings={"ddgi.rays": 64},
        probes=27,
        receivers=300,
        resolution="32x18",
        frames=3,
        warmup=0,
        gi_budget_ms=1e6,
        budget_ms=1e6,
        out=tmp_path / "run",
        cache_dir=tmp_path / "cache",
    )
    (answer,) = made.answers
    ddgi, direct = answer.table.to_dict("records")
    assert direct["status"] == "no global illumination"
    errors = pd.read_csv(tmp_path / "run" / "errors.csv")
    assert list(errors["configuration"]) == [1]
    assert 0 < errors["rel_l2"][0] < 1
    assert errors["dark_area"][0] == 0 and pd.isna(errors["leak"][0])
    assert cells(answer.table.iloc[0])[headings(answer.table).index("leak")] == "-"
    told = errors["unsettled"][0]
    assert ddgi["status"] == (told if isinstance(told, str) else "")
    report = (tmp_path / "run" / "report.md").read_text()
    assert "## Which one: cornell-box, profile iphone7" in report
    assert answer.sentence in report
    again = gibench.make_report(tmp_path / "run").text
    assert answer.sentence in again


def test_a_scene_without_indirect_light_ranks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dark = np.zeros((5, 3))
    light = SettledLight(
        irradiance=dark,
        covered=np.ones(5, np.bool_),
        frames=8,
        settled=True,
        change=0.0,
        unrested="",
        memory_bytes=0,
    )
    truth = QuickTruth(np.arange(5), dark, dark, np.ones(5), np.ones(5, np.bool_))
    monkeypatch.setattr(run_errors, "settled_light", lambda *_: (light, None))
    monkeypatch.setattr(run_errors, "quick_truth", lambda *_: truth)
    profile, spec = load_profile("iphone7"), find_technique("ddgi")
    (job,) = grid([profile], [spec], scenes=("cornell-box",), receivers=(5,))
    (row,) = run_errors.run_errors([(1, job)], Site(tmp_path, 0), Worker())
    assert row == {"configuration": 1, "unsettled": NO_LIGHT}


def test_budgets_are_above_zero(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--budget-ms", "--gi-budget-ms"):
        for value in ("0", "-1", "nan", "inf"):
            out = ["--out", str(tmp_path / "out")]
            assert call(["run", "-t", "direct", option, value, *out]) == 2
            assert option in capsys.readouterr().err
    with pytest.raises(BadInput, match="budget"):
        gibench.run(gi_budget_ms=0.0, out=tmp_path / "out")


def test_a_planted_leak_is_found_among_open_receivers_alone(rng: np.random.Generator) -> None:
    count, chosen = 400, np.arange(0, 800, 2)
    area = rng.uniform(0.5, 1.5, count)
    lit = np.arange(count) < 250
    seen = np.arange(count) < 350
    value = np.where(lit[:, None], 2.0, 0.0) * np.ones(3)
    truth = QuickTruth(chosen, value, np.zeros((count, 3)), area, seen)
    result = np.zeros((800, 3))
    result[chosen] = value
    assert errors_of(result, truth)["leak"] == 0
    result[chosen[~lit & seen]] += 0.1
    result[chosen[~seen]] += 5.0
    found = errors_of(result, truth)
    mean = (area * value[:, 0]).sum() / area.sum()
    assert found["leak"] == pytest.approx(0.1 / mean, rel=1e-12)
    dark = area[~lit & seen].sum() / area.sum()
    assert found["dark_area"] == pytest.approx(dark, rel=1e-12)
    everywhere = QuickTruth(chosen, value + 2.0, np.zeros((count, 3)), area, seen)
    assert np.isnan(errors_of(result, everywhere)["leak"])
    assert errors_of(result, everywhere)["dark_area"] == 0
