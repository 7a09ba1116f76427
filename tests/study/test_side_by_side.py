"""The experiments that set the techniques side by side: their analysis, and that they run."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from support.gibs_scenes import scene_of
from support.tiny_scenes import empty_room

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.measure.compare.timings import configuration_label
from gibench.scene.load import load_scene
from gibench.scene.model import DirectionalLight, PointLight
from gibench.study.experiments import convergence, ray_budget
from gibench.study.experiments.convergence import arrival, distances, row_of
from gibench.study.experiments.ray_budget import AT_REST, MOVED, rows_of, theirs
from gibench.study.switched import LightSwitch, switched

KEY = {"scene": "s", "technique": "ddgi", "budget": 50, "profile": "p"}
PASSES = {
    "ddgi": (
        "probe_trace",
        "probe_shade",
        "blend_irradiance",
        "border_copy",
        "camera",
        "application",
    ),
    "gibs": ("irradiance", "prefix_sum", "placement", "camera", "application"),
}


def samples_of(technique, rng, frames=7):
    """Samples with random times, of two keys, in random order; and the times by (when, frame)."""
    names = (*PASSES[technique], "(frame)")
    rows, times = [], {}
    for budget in (50, 100):
        for when in (AT_REST, MOVED):
            for frame in range(frames):
                drawn = {name: float(rng.uniform(1, 9)) for name in names}
                drawn["application"] += 10
                if budget == 50:
                    times[when, frame] = drawn
                rows += [
                    {
                        **KEY, "technique": technique, "budget": budget, "when": when,
                        "frame": frame, "pass": name, "time_ms": ms, "surfels": 40 + frame,
                        "covered": 0.5,
                        "probes": np.nan, "rays": 100 + frame, "memory_bytes": 7,
                    }
                    for name, ms in drawn.items()
                ]  # fmt: skip
    return pd.DataFrame(rows), times


@pytest.mark.parametrize("technique", ["ddgi", "gibs"])
def test_ekbergs_columns_are_medians_of_the_samples(rng, technique):
    samples, times = samples_of(technique, rng)
    rows = rows_of(samples, {**KEY, "technique": technique})
    assert [row["when"] for row in rows] == [AT_REST, MOVED]
    for row in rows:
        mine = [drawn for (when, _), drawn in times.items() if when == row["when"]]
        if technique == "ddgi":
            rays = np.array([t["probe_trace"] + t["probe_shade"] for t in mine])
            rest = np.array([t["blend_irradiance"] + t["border_copy"] for t in mine])
        else:
            rays = np.array([t["irradiance"] for t in mine])
            rest = np.array([t["prefix_sum"] + t["placement"] for t in mine])
        camera = np.array([t["camera"] for t in mine])
        application = np.array([t["application"] for t in mine])
        for name, values in (
            ("ray_casting_ms", rays),
            ("application_ms", application),
            ("rest_ms", rest),
            ("total_ms", rays + application + rest),
            ("camera_ms", camera),
            ("frame_ms", np.array([t["(frame)"] for t in mine])),
        ):
            assert row[name] == pytest.approx(np.median(values), rel=1e-12)
        assert row["frames"] == 7 and row["surfels"] == 46 and row["rays"] == 103


def test_their_table_has_their_columns_and_blanks_where_a_figure_is_missing():
    table = theirs().set_index("technique")
    assert list(table.columns[-4:]) == ["ray casting", "application", "rest", "total"]
    assert table.loc["ddgi 50 rays/probe", "total"] == 4.4
    assert table.loc["gibs 2 rays/surfel", "ray casting"] == 0.32
    moved = table.loc["gibs 4 rays/surfel, moved camera"]
    assert moved["rest"] == 0.25 and pd.isna(moved["application"]) and pd.isna(moved["total"])
    assert (table["source"] == "Ekberg 2022").all()


def test_arrival_counts_from_one_and_wants_it_to_stay():
    assert arrival([0.01, 0.02, 0.0]) == 1
    assert arrival([0.9, 0.05, 0.01]) == 2
    assert arrival([0.9, 0.01, 0.06, 0.01]) == 4  # it left again
    assert arrival([0.9, 0.01, 0.06]) is None
    assert arrival([np.nan, np.nan]) is None


def exponential(rate, frames=80, noise=0.0, seed=0):
    """Images (frames, 50, 3) that go from 0 towards a pattern by ``rate`` a frame."""
    rng = np.random.default_rng(seed)
    pattern = rng.uniform(0.5, 2.0, (50, 3))
    steps = 1 - rate ** np.arange(1, frames + 1)
    return steps[:, None, None] * pattern + noise * rng.normal(size=(frames, 50, 3))


def samples_from(images, ms=2.0):
    distance, mean = distances(images)
    return pd.DataFrame(
        {
            "frame": np.arange(1, len(images) + 1),
            "time_ms": ms,
            "distance": distance,
            "mean_distance": mean,
        }
    )


@pytest.mark.parametrize("rate", [0.0, 0.5, 0.8])
def test_an_exponential_arrives_when_its_formula_says(rate):
    row = row_of(samples_from(exponential(rate)).sample(frac=1.0, random_state=1))
    expected = 1 if rate == 0 else int(np.ceil(np.log(0.05) / np.log(rate)))
    assert row["frames"] == row["mean_frames"] == expected
    assert row["ms"] == row["mean_ms"] == pytest.approx(2.0 * expected)
    assert row["settled"] == "yes" and row["noise"] < 1e-3


def test_what_still_moves_has_not_arrived():
    row = row_of(samples_from(exponential(0.99)))
    assert row["frames"] is None and row["mean_frames"] is None
    assert row["settled"].startswith("no: still moving by")


def test_noise_hides_an_arrival_but_not_that_of_the_mean():
    row = row_of(samples_from(exponential(0.5, noise=0.15)))
    assert row["frames"] is None and row["settled"].startswith("but for noise of 1")
    assert row["mean_frames"] == 5
    assert row["noise"] == pytest.approx(0.15 / np.sqrt(1.25**2 + 0.1875), rel=0.15)


def test_a_black_scene_never_settles_on_anything():
    distance, mean = distances(np.zeros((8, 4, 3)))
    assert np.isnan(distance).all() and np.isnan(mean).all()
    assert row_of(samples_from(np.zeros((8, 4, 3))))["frames"] is None


def test_all_lights_are_switched_in_one_frame_and_nothing_else_is():
    base, _ = empty_room(side=2)
    sun = DirectionalLight((0.0, -1.0, 0.0), (4.0, 2.0, 1.0))
    lamp = PointLight((0.0, 1.0, 0.0), (1.0, 2.0, 3.0))
    scene = scene_of([((base.positions, base.normals, base.triangles), 0)], base.materials,
                     lights=(sun, lamp))  # fmt: skip
    both = switched(scene, LightSwitch(5, 1.0, 0.25))
    assert both.lights_at(0) == both.lights_at(4) == scene.lights_at(0)
    assert both.lights_at(5) == both.lights_at(99)
    dim_sun, dim_lamp = both.lights_at(5)
    assert dim_sun.irradiance == (1.0, 0.5, 0.25) and dim_sun.direction == sun.direction
    assert dim_lamp.intensity == (0.25, 0.5, 0.75) and dim_lamp.position == lamp.position
    assert switched(scene, LightSwitch(5, 0.0, 1.0)).lights_at(4)[0].irradiance == (0.0, 0.0, 0.0)
    assert both.content_hash() == scene.content_hash()  # the same bakes serve both
    with pytest.raises(BadInput, match="no light that could be switched"):
        switched(base, LightSwitch(5, 0.0, 1.0))


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    cache = str(tmp_path_factory.mktemp("cache"))
    return ["--quick", "--scene", "cornell-box", "--cache-dir", cache, "-q"]


@pytest.mark.slow
@pytest.mark.drawn
def test_the_ray_budget_experiment(quick, tmp_path, monkeypatch):
    monkeypatch.setattr(ray_budget, "_RAYS_PER_PROBE", (50,))
    command = ["experiment", "ray-budget", *quick, "--out", str(tmp_path)]
    assert call(command) == 0
    table = pd.read_csv(tmp_path / "ray-budget.csv")
    assert (table["status"] == "ok").all()
    assert table["technique"].tolist() == ["ddgi", "ddgi", "gibs", "gibs"]
    assert table["when"].tolist() == [AT_REST, MOVED] * 2
    ddgi, gibs = table[table["technique"] == "ddgi"], table[table["technique"] == "gibs"]
    assert (ddgi["rays"] == 1800).all() and (ddgi["probes"] == 36).all()
    assert (gibs["rays"] < 1800).all() and gibs["surfels"].is_monotonic_increasing
    assert (gibs["rays"] % 2 == 0).all()  # two for each
    assert ((gibs["covered"] > 0) & (gibs["covered"] <= 1)).all() and ddgi["covered"].isna().all()
    samples = pd.read_csv(tmp_path / "ray-budget-samples.csv")
    rest = samples[(samples["technique"] == "gibs") & (samples["when"] == AT_REST)]
    irradiance = rest[rest["pass"] == "irradiance"]["time_ms"]
    assert gibs["ray_casting_ms"].iloc[0] == pytest.approx(irradiance.median(), rel=1e-4)
    for file in ("ray-budget.png", "ray-budget.svg", "images/ddgi-1800-at-rest/frame.png"):
        assert (tmp_path / file).stat().st_size > 1000
    text = (tmp_path / "ray-budget.md").read_text()
    assert "Theirs, on their devices" in text and "[withheld]" not in text and "4.85" in text
    # From the stored samples alone, as after an interruption between the two files.
    head = (tmp_path / "ray-budget.csv").read_text().split("\n", 1)[0]
    (tmp_path / "ray-budget.csv").write_text(head + "\n")
    monkeypatch.setattr(ray_budget, "Session", None)
    assert call(command) == 0
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "ray-budget.csv"), table)


@pytest.mark.drawn
def test_the_convergence_experiment(quick, tmp_path, monkeypatch):
    chosen = tuple(one for one in convergence._SETTINGS if one[0] in ("ddgi", "srp"))[1:3]
    monkeypatch.setattr(convergence, "_SETTINGS", chosen)
    monkeypatch.setattr(convergence, "_SWITCHES", {"off to on": (0.0, 1.0)})
    command = ["experiment", "convergence", *quick, "--out", str(tmp_path)]
    assert call(command) == 0
    table = pd.read_csv(tmp_path / "convergence.csv")
    assert (table["status"] == "ok").all() and table["technique"].tolist() == ["srp", "ddgi"]
    samples = pd.read_csv(tmp_path / "convergence-samples.csv")
    assert samples.groupby("technique")["frame"].max().tolist() == [16, 16]
    for _, one in samples.groupby("technique"):
        first, last = one["mean_distance"].iloc[0], one["mean_distance"].iloc[-1]
        assert first < -0.5 and abs(last) < abs(first)  # it starts dark and grows
    for file in ("convergence.png", "convergence-ms.svg"):
        assert (tmp_path / file).stat().st_size > 1000
    assert "within 5% and stays" in (tmp_path / "convergence.md").read_text()


def test_a_run_counts_surfels_and_their_work_as_they_are_at_its_end(tmp_path):
    """GIBS begins with none: counted as it was set up, it would show no surfel and no ray."""
    command = [
        "run",
        "--no-quality",
        "-t",
        "gibs",
        "--scene",
        "cornell-box",
        "--receivers",
        "200",
        "-n",
        "6",
    ]
    command += ["--warmup", "4", "--resolution", "64x48", "--set", "gibs.placement_chance=1"]
    command += ["--set", "gibs.surfels=500", "--set", "gibs.placement=camera"]
    command += ["--camera-path", "flight", "--rest-frames", "2"]
    assert call([*command, "--flight-frames", "5", "-q", "--out", str(tmp_path / "run")]) == 0
    (frame,) = pd.read_csv(tmp_path / "run" / "frames.csv").to_dict("records")
    assert 12 < frame["surfels"] <= 10 * 12  # twelve tiles place one each in ten frames
    passes = pd.read_csv(tmp_path / "run" / "passes.csv").set_index("pass")
    # A ray for every surfel that was there when the frame began, and at its hit one to every light.
    lights = len(load_scene("cornell-box").lights)
    rays = passes.loc["irradiance", "rays"]
    assert frame["surfels"] - 12 <= rays <= frame["surfels"] * (1 + lights)
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["flight"] == {"path": "flight", "rest_frames": 2, "flight_frames": 5}
    assert configuration_label(record["configurations"][0], record).count("500 surfels") == 1
    assert (
        "The camera flew: 2 frames at rest, 5 along" in (tmp_path / "run" / "report.md").read_text()
    )
