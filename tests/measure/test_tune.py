"""`--workgroup-size auto`: what is tried, what is chosen, and that it is remembered."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support import fake_technique

from gibench.cli.main import call
from gibench.device.selection import select_cl_device
from gibench.measure.plan.grid import grid
from gibench.measure.session import tune
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.measure.statistics.summary import Roofs
from gibench.profiles import built_in_profiles, load_profile
from gibench.techniques.job import Shot
from gibench.techniques.registry import find_technique


@pytest.mark.parametrize("name", sorted(built_in_profiles()))
def test_every_size_tried_is_inside_the_profile(name: str) -> None:
    profile = load_profile(name)
    sizes = tune.candidate_sizes(profile)
    assert profile.default_workgroup_size in sizes
    assert len(sizes) >= 3
    assert all(profile.workgroup_size_problem(size) is None for size in sizes)


def test_the_choice_by_hand() -> None:
    times = {
        "free": {32: 5.0, 64: 3.0, 128: 4.0},
        "near": {32: 0.99, 64: 1.0, 128: 0.98},
        "shares": {32: 2.0, 64: 2.2, 128: 1.0},
        "too": {64: 2.0, 128: 2.9},
    }
    sweep = tune.choose(times, ("free", "near"), 64)
    assert sweep.base == 128  # 3.9 ms against 4.2; 'too' cannot run at 32
    assert sweep.chosen == {"free": 64, "near": 128, "shares": 128, "too": 128}
    only_noise = tune.choose({"one": {32: 0.98, 64: 1.0}}, (), 64)
    assert only_noise.base == 64
    assert "32: 0.980, 64: 1.000" in only_noise.notes()[0]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    specs = {spec.name: spec for spec in (fake_technique.SPEC,)}
    monkeypatch.setattr("gibench.techniques.registry.techniques", lambda: specs)
    roofs = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)
    monkeypatch.setattr("gibench.measure.machine.roofs.measure_roofs", lambda *_: roofs)

    def start(out: str, *arguments: str) -> int:
        return call(
            [
                *("run", "--no-quality", "--technique", "fake", "--receivers", "400", "--quiet"),
                *("--resolution", "16x8", "--cache-dir", str(tmp_path / "cache")),
                *("--frames", "3", "--warmup", "1", "--out", str(tmp_path / out), *arguments),
            ]
        )

    return start


def test_it_is_measured_once_and_reported_whole(run, tmp_path: Path, monkeypatch) -> None:
    assert run("first", "-w", "auto", "-w", "64") == 0
    record = json.loads((tmp_path / "first" / "run.json").read_text())
    plain, auto = record["configurations"]
    assert not plain["auto_workgroup"]
    sweep = auto["workgroup_sweep"]
    assert sweep["free"] == ["triad"]  # 'read' fixes its own size
    sizes = [str(size) for size in tune.candidate_sizes(load_profile("iphone7"))]
    assert list(sweep["times_ms"]["triad"]) == sizes
    passes = pd.read_csv(tmp_path / "first" / "passes.csv")
    assert (
        passes[passes["configuration"] == 2].set_index("pass").loc["triad", "workgroup_size"]
        == (sweep["chosen"]["triad"])
    )
    samples = pd.read_csv(tmp_path / "first" / "samples.csv")
    mine = samples[(samples["configuration"] == 2) & (samples["pass"] == "triad")]
    assert set(mine["workgroup_size"]) == {sweep["chosen"]["triad"]}
    assert "median ms by size: 32:" in (tmp_path / "first" / "report.md").read_text()

    def never(*_):
        raise AssertionError("measured again")

    measure = tune.measure_sweep
    monkeypatch.setattr(tune, "measure_sweep", never)
    assert run("second", "-w", "auto") == 0
    again = json.loads((tmp_path / "second" / "run.json").read_text())["configurations"][0]
    assert again["workgroup_sweep"]["remembered"]
    assert again["workgroup_sweep"]["chosen"] == sweep["chosen"]
    assert run("other", "-w", "auto", "-d", "vega56") == 1  # another profile: not remembered
    monkeypatch.setattr(tune, "measure_sweep", measure)
    monkeypatch.setattr(tune, "tree_hash", lambda root: "other kernels")
    assert run("third", "-w", "auto") == 0
    third = json.loads((tmp_path / "third" / "run.json").read_text())["configurations"][0]
    assert not third["workgroup_sweep"]["remembered"]


@pytest.mark.parametrize("bad", ["0", "-4", "big", "1.5"])
def test_sizes_are_whole_numbers_or_auto(run, bad: str, capsys) -> None:
    assert run("out", f"--workgroup-size={bad}") == 2
    assert "--workgroup-size" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["direct", "srp"])
def test_passes_at_sizes_of_their_own_compute_the_same(name: str, tmp_path: Path) -> None:
    spec = find_technique(name)
    settings = {"sh_order": (1,), "transport_rays": (32,), "relight_samples": (64,)}
    (job,) = grid(
        [load_profile("iphone7")],
        [spec],
        receivers=(300,),
        settings={"srp": settings} if name == "srp" else {},
        workgroup_sizes=(256,),
        shot=Shot(48, 32),
    )
    shared = Shared(tmp_path, 0)
    outputs = []
    for own in (256, 32, 512):
        session = Session.open(job, shared, select_cl_device(None))
        free = tuple(
            item.name for item in session.technique.passes() if tune._is_free(session.device, item)
        )
        assert "camera" in free
        session.prepare(dict.fromkeys(free, own))
        for frame in range(2):
            session.frame(frame)
        sizes = {p.name: p.launches[0].local for p in session.prepared if p.name in free}
        assert sizes == dict.fromkeys(free, own)
        outputs.append((session.images()["frame"], session.technique.indirect_irradiance()))
    for image, irradiance in outputs[1:]:
        np.testing.assert_array_equal(image, outputs[0][0])
        np.testing.assert_array_equal(irradiance, outputs[0][1])
