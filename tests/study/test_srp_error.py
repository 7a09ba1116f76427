"""The error of SRP taken apart."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from gibench.cli.main import call
from gibench.rays.embree import scene_tracer
from gibench.resources import data
from gibench.scene.load import load_scene
from gibench.study.experiments import srp_error
from gibench.techniques.srp.bake.voxels import view_shares


def test_what_a_replacement_explains_is_what_goes_away_with_it():
    table = pd.DataFrame(
        {
            "scene": ["a", "a", "b", "b"],
            "region": "whole",
            "replaced": ["nothing", "bounces"] * 2,
            "bias": [0.1, 0.04, -0.2, -0.25],
            "rel_l2": [0.3, 0.2, 0.5, 0.6],
        }
    )
    found = srp_error.explained(table)
    np.testing.assert_allclose(found["bias_explained"], [0, 0.06, 0, 0.05])
    np.testing.assert_allclose(found["rel_l2_explained"], [0, 0.1, 0, -0.1])


def test_a_small_box_is_taken_apart(tmp_path, monkeypatch):
    """The steps on the host are those of the device, and replacing one changes the light."""
    few = {name: srp_error.REPLACEMENTS[name] for name in ("nothing", "compression", "band limit")}
    monkeypatch.setattr(srp_error, "REPLACEMENTS", few)
    options = ["--quick", "-s", "cornell-box", "--target-error", "1", "-q"]
    where = ["--out", str(tmp_path / "out"), "--cache-dir", str(tmp_path)]
    assert call(["experiment", "srp-error", *options, *where]) == 0
    rows = pd.read_csv(tmp_path / "out" / "srp-error.csv").set_index("replaced")
    assert set(rows.index) == {"nothing, as it runs", "placement", *few}
    assert (rows["status"] == "ok").all() and (rows["region"] == "whole").all()
    for name in ("bias", "rel_l2"):
        ours = rows[name]
        assert ours["nothing"] == pytest.approx(ours["nothing, as it runs"], abs=2e-3)
        assert abs(ours["compression"] - ours["nothing"]) < 0.03
        assert ours["band limit"] != pytest.approx(ours["nothing"], abs=2e-3)
    assert "*explained*" in (tmp_path / "out" / "srp-error.md").read_text()


@pytest.mark.parametrize("name", ["cornell-box", "blue-orange-box", "hall"])
def test_probes_set_by_hand_are_as_many_and_in_the_open(name):
    scene, own = load_scene(name), srp_error.Own.of(name)
    assert (data("scenes") / "srp-error" / f"{name}.toml").is_file()
    assert len(own.probes) == scene.probes.count
    front, back = view_shares(own.probes, scene, scene_tracer(scene))
    assert (front > 0.2).all() and (back < 0.25).all()
