"""Wrong settings of the dynamic techniques, by the command line: one clear line, and no folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gibench.cli.main import call
from gibench.profiles import built_in_profiles

MISSES = ["counts=2x2x2", "origin=100,100,100", "spacing=1,1,1"]


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return str(tmp_path_factory.mktemp("cache"))


@pytest.fixture
def refused(tmp_path, cache, capsys):
    """Runs a command that must be refused with ``code``; the line it says."""

    def run(code: int, *arguments: str, technique: str, made: bool = False) -> str:
        out = tmp_path / str(len(list(tmp_path.iterdir())))  # a folder of its own
        command = [
            "run",
            "--no-quality",
            "--technique",
            technique,
            "--scene",
            "cornell-box",
            "--receivers",
            "200",
        ]
        command += ["--resolution", "16x8", "--frames", "1", "--cache-dir", cache]
        assert call([*command, "--out", str(out), *arguments]) == code
        told = capsys.readouterr()
        assert told.err.count("\n") == 1 and told.err.startswith("gibench: ")
        assert "Traceback" not in told.err + told.out
        assert out.exists() == made
        return told.err

    return run


def test_zero_probes(refused):
    told = refused(2, "--probes", "0", technique="ddgi")
    assert "--probes" in told and "greater than or equal to 1" in told
    told = refused(2, "--set", "ddgi.counts=4x0x4", technique="ddgi")
    assert "counts is '4x0x4'; give three whole numbers of 1 or more" in told


@pytest.mark.parametrize("beside", [[], ["--technique", "direct"]])
def test_a_volume_that_misses_the_scene_is_told_before_anything_runs(refused, beside):
    given = [part for setting in MISSES for part in ("--set", f"ddgi.{setting}")]
    told = refused(2, *given, *beside, technique="ddgi")
    assert "the volume of 2x2x2 probes from 100,100,100 misses the scene 'cornell-box'" in told
    assert "between -1, 0, -1 and 1, 2, 1; change origin, spacing or counts" in told


def test_no_rays(refused):
    told = refused(2, "--set", "gibs.ray_budget=0", technique="gibs")
    assert "setting gibs.ray_budget: ray_budget = 0 must be at least 1" in told
    told = refused(2, "--set", "gibs.rays_per_surfel=0", technique="gibs")
    assert "setting gibs.rays_per_surfel" in told
    told = refused(2, "--set", "ddgi.rays=0", technique="ddgi")
    assert "0 rays per probe; give 1 or more" in told


def test_more_surfels_than_the_budget_holds(refused, tmp_path):
    """By the least it takes, by all it takes, and in one buffer."""
    text = built_in_profiles()["iphone7"].replace('name = "iphone7"', 'name = "small"')
    for bytes_ in (1 << 30, 1 << 28):  # of the budget, of one buffer
        assert f"value = {bytes_}" in text
        text = text.replace(f"value = {bytes_}", f"value = {40 << 20}")
    (tmp_path / "small.toml").write_text(text)
    small = ["--device-profile", str(tmp_path / "small.toml")]
    for surfels in (150_000, 80_000):
        told = refused(3, *small, "--set", f"gibs.surfels={surfels}", technique="gibs", made=True)
        assert f"{40 << 20:,}" in told and "profile small" in told
        assert "lower --set gibs.surfels or --resolution" in told
        assert "--receivers" not in told  # none are on the device, so fewer of them do not help
    told = refused(2, "--set", "gibs.surfels=0", technique="gibs")
    assert "surfels = 0 must be at least 1" in told


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("links=0", "0 links per cache; give 1 or more"),
        ("links=40000", "40000 links per cache; give 4096 or fewer"),
        ("surfels=100", "128 links per cache, but 100 surfels"),
        ("grid=0x4x4", "grid is '0x4x4'; give three whole numbers of 1 or more: 16x8x8"),
        ("sh_bands=5", "sh_bands is 5; use 2, 3 or 4"),
    ],
)
def test_surfel_caches_that_make_no_sense(refused, setting, told):
    assert told in refused(2, "--set", f"surfel-cache.{setting}", technique="surfel-cache")


def test_fewer_surfels_than_objects(refused):
    few = ["--set", "surfel-cache.surfels=4", "--set", "surfel-cache.links=2"]
    told = refused(2, *few, technique="surfel-cache")
    assert "4 surfels for the 7 objects of the scene 'cornell-box'; give 7 or more" in told


def test_more_links_than_the_profile_holds_are_refused_before_anything_is_baked(refused, cache):
    many = ("links=254", "sh_bands=4", "caches=200000")
    given = [part for one in many for part in ("--set", f"surfel-cache.{one}")]
    told = refused(3, *given, technique="surfel-cache", made=True)
    assert "profile iphone7 has 1,073,741,824" in told
    assert "lower --set surfel-cache.links" in told
    fit = {name: int(n) for name, n in re.findall(r"surfel-cache\.(\w+)=(\d+)", told)}
    assert told.rstrip().endswith("would fit, each alone")
    # A buffer holds 2^28 bytes: of up to 230 000 caches, map and grid, 36 links of 32 bytes each,
    # or 32 in whole vectors; of 256 links those of 32 768.
    assert set(fit) == {"links", "caches"} and fit["links"] == 32
    assert 32_768 > fit["caches"] > 0.8 * 32_768
    assert not list(Path(cache).glob("surfel-cache-*"))


@pytest.mark.parametrize("technique", ["ddgi", "gibs", "direct"])
def test_a_camera_path_with_one_point(refused, tmp_path, technique):
    path = tmp_path / "one.toml"
    path.write_text("positions = [[0, 1, 0]]\ntargets = [[1, 1, 0]]")
    told = refused(2, "--camera-path", str(path), technique=technique)
    assert f"{path}: a camera path with 1 point(s); give at least two positions" in told
    told = refused(2, "--camera-path", "flight", "--flight-frames", "0", technique=technique)
    assert "--flight-frames" in told
