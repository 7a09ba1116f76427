"""The error of SRP taken apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gibench.bake.run import run_bake
from gibench.cli.main import call
from gibench.rays.embree import scene_tracer
from gibench.resources import data
from gibench.scene.load import load_scene
from gibench.study import srp_parts
from gibench.study.experiments import srp_error
from gibench.study.site import Site
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.stages import Given, srp_stages
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


def test_light_of_the_point_is_that_of_the_map_where_light_is_even(tmp_path, monkeypatch, rng):
    """Under direct light that is the same everywhere, it does not matter which point is asked; and
    the points that are asked lie in the planes of receivers, whose normals they have.
    """
    scene, shared = load_scene("cornell-box"), Site(tmp_path).standing()
    lightmap = shared.lightmap("cornell-box", 300)
    own = lightmap.receivers
    settings = SrpBakeSettings(sh_order=2, transport_rays=32, relight_samples=64)
    bake = run_bake(srp_stages(Given(scene, lightmap, settings, 0)), Path(tmp_path))
    even = rng.uniform(1, 4, 3)
    asked = []

    def direct(scene, lights, tracer, at):
        asked.append(at)
        return np.tile(even, (len(at.position), 1))

    monkeypatch.setattr(srp_parts, "direct_irradiance", direct)
    sent = own.emission + own.albedo.astype(np.float64) / np.pi * even
    nothing = np.zeros_like(sent)
    parts = srp_parts.Parts(scene, lightmap, settings, bake, sent, nothing, 0, tmp_path)
    found, plain = srp_parts.with_light_of_the_point(parts), parts.light()
    assert plain.mean() > 0.1
    np.testing.assert_allclose(found, plain, rtol=1e-9, atol=1e-9)
    at = np.concatenate([points.position for points in asked])
    normal = np.concatenate([points.normal for points in asked])
    assert len(at) > 0.8 * 64 * len(bake.probes)
    off = np.einsum("nrx,rx->nr", at[:, None] - own.position, own.normal.astype(np.float64))
    along = normal @ own.normal.T.astype(np.float64)
    assert ((np.abs(off) < 1e-3) & (along > 0.999)).any(axis=1).mean() > 0.95
