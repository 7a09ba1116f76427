"""Comparing with the truth: what is seen, what counts, what is settled, what is refused."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from support.tiny_scenes import quad_scene

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.measure.plan.grid import grid
from gibench.measure.runfolder.axes import Axis
from gibench.measure.statistics.faults import FAULTS
from gibench.profiles import load_profile
from gibench.report.quality import error_text, open_text
from gibench.scene.load import load_scene
from gibench.scene.model import Camera, DirectionalLight, PointLight, Region, Scene
from gibench.study.errors import Truth, errors, errors_among
from gibench.study.frozen import frozen
from gibench.study.quality_rows import columns, result_names
from gibench.study.receivers_file import read_reference, write_receivers
from gibench.study.regions import read_regions
from gibench.study.settle import SettleOptions, _Watch
from gibench.study.through_camera import view
from gibench.techniques.registry import find_technique

WALL = ((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))  # faces +z
CAMERA = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_degrees=50.0, name="front")


@pytest.fixture(scope="module")
def wall():
    scene, lightmap = quad_scene([WALL], 16)
    return scene, lightmap, view(scene, lightmap, CAMERA, 60, 40)


def test_frozen_lights_are_those_of_one_frame_for_ever():
    lights = (
        DirectionalLight((0.0, -0.6, -0.8), (1.0, 1.0, 1.0), 40.0, 100),
        PointLight((1.0, 2.0, 3.0), (1.0, 1.0, 1.0), 0.5, 100),
    )
    scene, _ = quad_scene([WALL], 2, lights=lights)
    still = frozen(scene, 17)
    assert still.lights_at(0)[0].direction == lights[0].at(17).direction
    assert still.lights_at(0)[1].position == lights[1].at(17).position
    assert still.lights_at(0) == still.lights_at(33) == still.lights_at(74)
    assert scene.lights_at(33) != scene.lights_at(74)


def test_a_camera_sees_the_receivers_of_the_points_its_pixels_show(wall):
    """Receivers that hold their own place give an image of the wall's points."""
    _, lightmap, seen = wall
    image = seen.of(lightmap.receivers.position.astype(np.float64))
    y, x = np.mgrid[0:40, 0:60]
    reach = 3.0 * np.tan(np.radians(25.0))
    across = (2 * (x + 0.5) / 60 - 1) * reach * 1.5
    up = (1 - 2 * (y + 0.5) / 40) * reach
    on_wall = (np.abs(across) < 1) & (np.abs(up) < 1)
    assert np.array_equal(seen.seen, on_wall)
    # Between the outermost texels' centres bilinear lookup is exact for what is linear.
    inner = (np.abs(across) < 1 - 1 / 16) & (np.abs(up) < 1 - 1 / 16)
    np.testing.assert_allclose(image[inner][:, 0], across[inner], atol=1e-5)
    np.testing.assert_allclose(image[inner][:, 1], up[inner], atol=1e-5)
    assert not image[~on_wall].any()


def test_backs_show_nothing():
    scene, lightmap = quad_scene([WALL], 4)
    behind = Camera((0.0, 0.0, -3.0), (0.0, 0.0, 0.0))
    assert not view(scene, lightmap, behind, 20, 20).seen.any()


def test_an_images_error_is_that_of_what_it_blends(wall):
    _, lightmap, seen = wall
    rng = np.random.default_rng(3)
    stderr = rng.random((len(lightmap.receivers), 3))
    draws = rng.normal(size=(4000, len(lightmap.receivers), 1)) * stderr[None, :, :1]
    pixel = np.flatnonzero(seen.seen.ravel())[123]
    row = seen.seen.ravel()[:pixel].sum()
    blended = (draws[:, seen.receivers[row], 0] * seen.weights[row]).sum(axis=1)
    assert seen.error_of(stderr).reshape(-1, 3)[pixel, 0] == pytest.approx(blended.std(), rel=0.06)


def truth_of(wall, value, noise):
    _, lightmap, seen = wall
    stderr = np.full_like(value, noise)
    return Truth.of(value, stderr, lightmap.receivers.area, seen)


def test_errors_of_a_result_that_is_a_tenth_too_bright(wall):
    rng = np.random.default_rng(5)
    value = 1.0 + rng.random((256, 3))
    left = np.zeros((40, 60), bool)
    left[:, :30] = True
    found = errors(truth_of(wall, value, 1e-6), 1.1 * value, {"left": left})
    for region in ("whole", "left"):
        assert found[region]["bias"].value == pytest.approx(0.1)
        assert found[region]["rel_l2"].value == pytest.approx(0.1, rel=1e-4)
        assert not found[region]["bias"].is_none
        assert 0 < found[region]["flip"].value < 1
        assert found[region]["ssim"].value < 1


def test_a_region_knows_only_its_own_pixels(wall):
    value = np.ones((256, 3))
    image_left = wall[1].receivers.position[:, 0] < 0
    result = np.where(image_left[:, None], 1.5, np.ones(3))
    right = np.zeros((40, 60), bool)
    right[:, 36:] = True
    found = errors(truth_of(wall, value, 1e-6), result, {"right": right, "sky": ~wall[2].seen})
    assert found["right"]["rel_l2"].is_none
    assert found["whole"]["bias"].value == pytest.approx(0.25)
    assert np.isnan(found["sky"]["bias"].value)


def test_a_difference_below_the_references_noise_is_none(wall):
    rng = np.random.default_rng(7)
    exact = 1.0 + rng.random((256, 3))
    noisy = exact + rng.normal(size=exact.shape) * 0.05
    found = errors(truth_of(wall, noisy, 0.05), exact, {})["whole"]
    assert found["bias"].is_none and found["rel_l2"].is_none and found["lab_l_mse"].is_none
    row = {"rel_l2": found["rel_l2"].value, "rel_l2_noise": found["rel_l2"].noise}
    assert error_text(row, "rel_l2") == "none"
    found = errors(truth_of(wall, noisy, 0.05), 1.3 * exact, {})["whole"]
    assert not found["bias"].is_none


def scene_with(*regions: Region) -> Scene:
    return quad_scene([WALL], 2, regions=regions)[0]


def test_regions_of_the_scene_the_command_line_and_masks(tmp_path):
    scene = scene_with(
        Region("a", "front", (0.0, 0.0, 0.5, 1.0)), Region("b", "other", (0, 0, 1, 1))
    )
    mask = np.zeros((40, 60), np.uint8)
    mask[3, 4] = 255
    Image.fromarray(mask).save(tmp_path / "dot.png")
    given = ["c=0.5,0.25,1,0.75", f"dot={tmp_path / 'dot.png'}"]
    found = read_regions(scene, CAMERA, given, 60, 40)
    assert list(found) == ["a", "c", "dot"]
    assert found["a"].sum() == 30 * 40 and found["a"][:, :30].all()
    assert found["c"].sum() == 30 * 20 and found["c"][10:30, 30:].all()
    assert found["dot"].sum() == 1 and found["dot"][3, 4]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("r=0.5,0.5,1.2,0.9", "leaves the image"),
        ("r=-0.1,0,0.5,0.5", "leaves the image"),
        ("r=0.5,0.5,0.5,0.9", "holds no pixel"),
        ("r=0.9,0.1,0.2,0.4", "holds no pixel"),
        ("r=nan,0,1,1", "leaves the image"),
        ("r=1,2,3", "neither four numbers nor an image"),
        ("r", "is no region"),
        ("=0,0,1,1", "is no region"),
    ],
)
def test_regions_that_are_none(text, what):
    with pytest.raises(BadInput, match=what):
        read_regions(scene_with(), CAMERA, [text], 60, 40)


def test_a_mask_of_another_size_is_refused(tmp_path):
    Image.fromarray(np.full((10, 10), 255, np.uint8)).save(tmp_path / "m.png")
    with pytest.raises(BadInput, match="10 x 10 pixels, not 60 x 40"):
        read_regions(scene_with(), CAMERA, [f"m={tmp_path / 'm.png'}"], 60, 40)


def test_built_in_regions_lie_on_what_they_are_named_after():
    scene = load_scene("blue-orange-box")
    assert {region.name for region in scene.regions} == {"edge", "corner", "wall", "floor"}
    names = {camera.name for camera in scene.cameras}
    assert all(region.camera in names for region in scene.regions)


def test_a_receivers_file_is_of_its_scene_light_and_receivers(wall, tmp_path):
    _, lightmap, _ = wall
    path = tmp_path / "receivers.npz"
    value = np.random.default_rng(1).random((256, 3))
    about = {"scene": "s", "light": "l", "bounces": None, "paths": 99}
    write_receivers(path, lightmap, value, value / 10, {"srp": 2 * value}, about)
    held = np.load(path)
    assert held["srp"].dtype == np.float32 and held["srp"].shape == (256, 3)
    back = read_reference(path, lightmap, about)
    np.testing.assert_allclose(back.value, value, rtol=1e-6)
    assert back.paths == 99
    for name in ("scene", "light", "bounces"):
        with pytest.raises(BadInput, match=f"of another {name}"):
            read_reference(path, lightmap, about | {name: "x"})
    _, other = quad_scene([WALL], 8)
    with pytest.raises(BadInput, match="256 other receivers than the scene's 64"):
        read_reference(path, other, about)
    (tmp_path / "broken.npz").write_bytes(path.read_bytes()[:700])
    with pytest.raises(BadInput, match="not a receivers file"):
        read_reference(tmp_path / "broken.npz", lightmap, about)
    with pytest.raises(BadInput, match="no such file"):
        read_reference(tmp_path / "none.npz", lightmap, about)


def frames_until_settled(values, options):
    watch = _Watch(options)
    for frame in range(1, options.frames + 1):
        if watch.asks(frame) and watch.stands_still(values(frame)):
            return frame, watch
    return options.frames, watch


def test_what_converges_settles_and_what_grows_does_not():
    target = np.random.default_rng(2).random((50, 3))
    options = SettleOptions(frames=512)
    frame, watch = frames_until_settled(lambda f: target * (1 - 0.9**f), options)
    assert watch.settled and frame == 128  # 0.9^64 is 0.1 %, 0.9^32 is 3 %
    frame, watch = frames_until_settled(lambda f: target * f, options)
    assert not watch.settled and frame == 512 and watch.change == pytest.approx(0.5)
    frame, watch = frames_until_settled(lambda f: 0 * target, options)
    assert watch.settled and frame == 32
    frame, watch = frames_until_settled(lambda f: target * (f > 100), options)
    assert watch.settled and frame in (32, 256)


def test_results_have_names_of_their_own():
    specs = [find_technique("srp"), find_technique("direct")]
    profiles, variants = [load_profile("iphone7")], ("published", "tuned")
    jobs = grid(profiles, specs, variants=variants, common={"sh_order": (2, 7)})
    names = result_names(jobs)
    assert len(set(names)) == len(jobs) >= 5
    assert result_names(grid(profiles, specs[:1])) == ["srp"]
    both = grid(profiles, specs[:1], layouts=("wide", "simt"))
    assert result_names(both) == ["srp, tuned", "srp, tuned simt"]


SRP = ("-t", "srp", "--set", "srp.transport_rays=64", "--set", "srp.relight_samples=64")
SMALL = (
    *("--scene", "cornell-box", "--receivers", "400", "--sh-order", "1"),
    *("--resolution", "48x32", "--target-error", "0.5", "--frames", "40", "--quiet"),
    "--no-faults",
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out, cache = tmp_path_factory.mktemp("quality"), tmp_path_factory.mktemp("cache")
    code = call(
        [
            *("quality", *SMALL, *SRP, "-t", "direct", "--region", "left=0,0,0.5,1"),
            *("--out", str(out), "--cache-dir", str(cache)),
        ]
    )
    assert code == 0
    return out, cache


def test_quality_leaves_what_it_promises(run):
    out, _ = run
    table = pd.read_csv(out / "quality.csv")
    promised = ["technique", "scene", "settings", "bias", "rel_mse", "lab_l_mse", "flip"]
    assert list(table.columns[:9]) == [*promised, "time_ms", "memory_bytes"]
    assert list(table.columns) == list(columns((Axis("sh_order", "sh_order"),)))
    assert list(table["region"]) == ["whole", "left"] * 2
    assert (table["layout"] == "wide").all()  # as PoCL prefers
    direct = table[table["technique"] == "direct"].iloc[0]
    assert direct["bias"] == pytest.approx(-1) and direct["rel_l2"] == pytest.approx(1, rel=1e-3)
    srp = table[table["technique"] == "srp"].iloc[0]
    assert abs(srp["bias"]) < 0.3 and srp["rel_l2"] < 0.6
    assert (table.loc[table["region"] == "whole", "uncovered"] == 0).all()
    assert direct["bias_covered"] == direct["bias"]
    assert (table.loc[table["region"] == "whole", "hidden"] == 0).all()
    assert direct["bias_open"] == direct["bias"] and direct["rel_l2_open"] == direct["rel_l2"]
    assert (table["time_ms"] > 0).all() and (table["memory_bytes"] > 0).all()
    assert direct["missing"] == 1 and srp["missing"] < 0.05
    assert (table["gi_ms"] < table["time_ms"]).all() and direct["gi_ms"] == 0
    # None was asked for; flicker and lag need further frames.
    watched = [fault.name for fault in FAULTS if fault.name.startswith(("flicker", "lag"))]
    assert table[watched].isna().all(axis=None)
    report = (out / "quality.md").read_text()
    assert "### Faults" in report and "| **100.00 %** |" in report
    assert (out / "faults.png").stat().st_size > 1000
    with np.load(out / "receivers.npz") as held:
        n = len(held["position"])
        shapes = {name: held[name].shape for name in held.files if name != "about"}
        assert shapes == {"area": (n,)} | dict.fromkeys(
            ("position", "normal", "albedo", "reference", "reference_stderr", "srp", "direct"),
            (n, 3),
        )
        area, x, y = held["area"][:, None], held["srp"], held["reference"]
        assert srp["bias"] == pytest.approx((area * (x - y)).sum() / (area * y).sum(), rel=1e-3)
    for name in ("reference.png", "srp/result.png", "srp/difference.png", "srp/error.png"):
        with Image.open(out / "images" / name) as image:
            assert image.size == (48, 32)
    assert "none is a time of the modelled device" in (out / "quality.md").read_text().lower()


def test_paths_bound_the_reference_whatever_its_target(run, tmp_path):
    _, cache = run
    bound = ("--target-error", "1e-6", "--reference-paths", "24")
    options = ("-t", "direct", *bound, "--cache-dir", str(cache), "--out", str(tmp_path))
    assert call(["quality", *SMALL, *options]) == 0
    row = pd.read_csv(tmp_path / "quality.csv").iloc[0]
    assert row["reference_paths"] == 24
    assert row["reference_error"] > 1e-3


def test_what_a_technique_does_not_cover_is_told_apart(run, tmp_path, capsys):
    """A camera at rest: GIBS has no surfels on the backs of the boxes, which count as black."""
    out, cache = run
    wide = ("surfels=3000", "placement_chance=1", "radius_share=0.2", "grid_cells=4")
    wide = (*wide, "placement=camera")
    settings = [word for one in wide for word in ("--set", f"gibs.{one}")]
    options = ("-t", "gibs", *settings, "--reference", str(out / "receivers.npz"))
    code = call(["quality", *SMALL, *options, "--cache-dir", str(cache), "--out", str(tmp_path)])
    assert code == 0
    row = pd.read_csv(tmp_path / "quality.csv").iloc[0]
    with np.load(tmp_path / "receivers.npz") as held:
        area, x, y = held["area"][:, None], held["gibs"], held["reference"]
    lit = x.any(axis=1)
    assert 10 < row["uncovered"] <= np.count_nonzero(~lit) < len(x) / 2
    assert row["bias"] == pytest.approx((area * (x - y)).sum() / (area * y).sum(), rel=1e-3)
    others = (area * (x - y))[lit].sum() / (area * y)[lit].sum()
    assert row["bias_covered"] == pytest.approx(others, abs=0.01)
    assert row["bias_covered"] > row["bias"] + 0.02
    said = f"{row['uncovered']} of {len(x)} receivers uncovered and counted as black; bias over"
    assert said in (tmp_path / "quality.md").read_text()


def test_a_stored_reference_serves_again_and_for_nothing_else(run, tmp_path, capsys):
    out, cache = run
    again = ["quality", *SMALL, "-t", "direct", "--cache-dir", str(cache)]
    file = ["--reference", str(out / "receivers.npz")]
    assert call([*again, *file, "--out", str(tmp_path / "a")]) == 0
    with np.load(out / "receivers.npz") as one, np.load(tmp_path / "a/receivers.npz") as two:
        assert np.array_equal(one["reference"], two["reference"])
    capsys.readouterr()
    for change, what in (
        (["--receivers", "200"], "several"),
        (["--light-frame", "30"], "another scene"),
        (["--bounces", "1"], "another bounces"),
    ):
        code = call([*again, *file, *change, "--out", str(tmp_path / what)])
        told = capsys.readouterr().err
        assert code == 2 and told.count("\n") == 1 and what in told
    elsewhere = [a if a != "cornell-box" else "blue-orange-box" for a in again]
    assert call([*elsewhere, *file, "--out", str(tmp_path / "c")]) == 2
    assert "another scene" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        (["--target-error", "0"], "never reached"),
        (["--target-error", "-1"], "never reached"),
        (["--target-error", "nan"], "is not a number"),
        (["--reference-paths", "7"], "give no standard error"),
        (["--region", "r=0.5,0.5,1.5,0.9"], "leaves the image"),
        (["--reference", "no-such.npz"], "no such file"),
        (["--camera", "nowhere"], "has no camera"),
        (["--camera-path", "flight"], "end before the camera is back"),
    ],
)
def test_wrong_input_is_told_in_one_line(run, tmp_path, capsys, wrong, what):
    _, cache = run
    small = [*SMALL, "-t", "direct", "--cache-dir", str(cache), "--out", str(tmp_path / "o")]
    code = call(["quality", *small, *wrong])
    told = capsys.readouterr().err
    assert code == 2 and told.count("\n") == 1 and what in told
    assert not (tmp_path / "o").exists()


def test_hidden_receivers_are_told_apart_in_words_and_figures(wall):
    """What is wrong in hidden receivers alone is no error of the others, and said to be so."""
    value = np.ones((256, 3))
    hidden = np.zeros(256, bool)
    hidden[:64] = True
    result = np.where(hidden[:, None], 3.0, value)
    truth = truth_of(wall, value, 1e-6)
    assert errors(truth, result, {})["whole"]["bias"].value == pytest.approx(0.5)
    others = errors_among(truth, result, ~hidden)
    assert others["bias"].is_none and others["rel_l2"].is_none
    assert np.isnan(errors_among(truth, result, np.zeros(256, bool))["bias"].value)
    row = {"hidden": 64, "receivers": 256, "rel_l2_open": 0.25, "rel_l2_open_noise": 0.01}
    row |= {"bias_open": 0.001, "bias_open_noise": 0.01}
    said = open_text(row)
    assert said.startswith("64 of 256 receivers lie in part inside of geometry")
    assert said.endswith("over the others: bias none, rel. L2 25.00 %")
    assert open_text({**row, "hidden": 0}) == ""
