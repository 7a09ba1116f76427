"""`gibench run` from option to folder, with a tiny technique in place of the real ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from support import fake_technique

from gibench.cli.main import call
from gibench.measure.runfolder.folder import sample_columns
from gibench.measure.statistics.summary import Roofs
from gibench.profiles import built_in_profiles

CONTRACT_SAMPLES = (
    "technique variant layout scene profile workgroup_size sh_order pass frame time_ms"
)
CONTRACT_PASSES = (
    "technique variant layout scene profile workgroup_size sh_order pass probes receivers frames "
    "mean_ms median_ms stdev_ms p95_ms p99_ms min_ms max_ms bytes flops rays gb_per_s gflop_per_s "
    "mrays_per_s roofline_fraction status reason"
)
CONTRACT_FRAMES = (
    "technique variant layout scene profile workgroup_size sh_order probes receivers frames "
    "gi_ms mean_ms median_ms p95_ms p99_ms min_ms fps real_time memory_bytes memory_budget_bytes "
    "status reason"
)
ROOFS = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)


@pytest.fixture(autouse=True)
def only_the_fakes(monkeypatch: pytest.MonkeyPatch) -> None:
    specs = {spec.name: spec for spec in (fake_technique.SPEC, fake_technique.PLAIN)}
    monkeypatch.setattr("gibench.techniques.registry.techniques", lambda: specs)
    monkeypatch.setattr("gibench.measure.machine.roofs.measure_roofs", lambda *_: ROOFS)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def small(tmp_path: Path) -> tuple[str, str]:
    """The option of a device with 1 MiB of memory, 256 KiB of it in one buffer."""
    text = built_in_profiles()["iphone7"].replace('name = "iphone7"', 'name = "small"')
    text = text.replace("value = 1073741824", f"value = {1 << 20}")
    text = text.replace("value = 268435456", f"value = {1 << 18}")
    (tmp_path / "small.toml").write_text(text)
    return "--device-profile", str(tmp_path / "small.toml")


@pytest.fixture
def run(tmp_path: Path, cache: Path):
    def start(*arguments: str, out: str = "out", technique: str = "fake") -> int:
        return call(
            [
                *(
                    "run",
                    "--technique",
                    technique,
                    "--receivers",
                    "500",
                    "--no-quality",
                    "--frames",
                    "4",
                ),
                *("--resolution", "16x8", "--no-quality", "--cache-dir", str(cache)),
                *("--out", str(tmp_path / out), *arguments),
            ]
        )

    return start


def tables(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    return tuple(pd.read_csv(folder / f"{n}.csv") for n in ("samples", "passes", "frames"))


@pytest.mark.drawn
def test_the_folder_keeps_the_contract(run, tmp_path: Path, capsys) -> None:
    assert run("--sh-order", "1", "--sh-order", "2", "--save-images", "--seed", "3") == 0
    folder = tmp_path / "out"
    samples, passes, frames = tables(folder)
    assert list(samples.columns)[: len(CONTRACT_SAMPLES.split())] == CONTRACT_SAMPLES.split()
    assert list(passes.columns)[: len(CONTRACT_PASSES.split())] == CONTRACT_PASSES.split()
    assert list(frames.columns)[: len(CONTRACT_FRAMES.split())] == CONTRACT_FRAMES.split()
    assert len(samples) == 2 * 2 * 4  # configurations, passes, frames
    assert len(passes) == 4
    assert len(frames) == 2
    assert set(passes["status"]) == {"ok"}
    assert sorted(frames["sh_order"]) == [1, 2]

    record = json.loads((folder / "run.json").read_text())
    assert record["schema_version"] == 1
    assert record["seed"] == 3
    assert record["finished"]
    assert record["arguments"]["sh_order"] == [1, 2]
    assert record["roofs"]["start"]["read_gb_per_s"] == 20.0
    assert record["environment"]["cpu"]
    assert record["profiles"][0]["content_hash"]

    text = (folder / "report.md").read_text()
    assert "none of the modelled device" in text
    assert "![roofline](roofline.png)" in text
    plotted = (folder / "roofline.svg").read_text()
    assert plotted.count(">fake triad<") == 1  # in the legend, for both configurations
    assert "Numbers: the configuration in run.json." in plotted
    with Image.open(folder / "roofline.png") as plot:
        assert plot.size[0] > 600
    assert record["environment"]["cpu"] in text
    out = capsys.readouterr().out
    assert f"measured on {record['environment']['cpu']} under the limits of profile iphone7" in out

    pictures = sorted((folder / "images").glob("*/frame.png"))
    assert len(pictures) == 2
    with Image.open(pictures[0]) as image:
        assert image.size == (4, 3)


def test_tables_are_what_the_samples_say(run, tmp_path: Path) -> None:
    assert run("--frames", "7") == 0
    samples, passes, frames = tables(tmp_path / "out")
    for _, row in passes.iterrows():
        times = samples[samples["pass"] == row["pass"]]["time_ms"]
        assert row["frames"] == 7
        assert row["mean_ms"] == pytest.approx(times.mean(), rel=1e-4)
        assert row["median_ms"] == pytest.approx(times.median(), rel=1e-4)
        assert row["stdev_ms"] == pytest.approx(times.std(), rel=1e-4)
        assert row["p95_ms"] == pytest.approx(np.percentile(times, 95), rel=1e-4)
        assert row["max_ms"] == pytest.approx(times.max(), rel=1e-4)
    triad = passes[passes["pass"] == "triad"].iloc[0]
    assert triad["bytes"] == 12 * fake_technique.FLOATS
    seconds = triad["median_ms"] * 1e-3
    assert triad["gb_per_s"] == pytest.approx(triad["bytes"] / seconds * 1e-9, rel=1e-4)
    # 49 152 bytes at 20 GB/s take longer than 8192 flops at 200 GFLOP/s.
    assert triad["roofline_fraction"] == pytest.approx(triad["bytes"] / 20e9 / seconds, rel=1e-4)
    walls = samples.groupby("frame")["frame_wall_ms"].first()
    frame = frames.iloc[0]
    assert frame["median_ms"] == pytest.approx(walls.median(), rel=1e-4)
    assert frame["fps"] == pytest.approx(1e3 / walls.median(), rel=1e-4)
    assert frame["device_ms"] <= frame["median_ms"]


def test_memory_is_what_was_allocated(run, tmp_path: Path) -> None:
    assert run("--set", "fake.bytes_per_receiver=100") == 0
    _, _, frames = tables(tmp_path / "out")
    expected = 2 * 4 * fake_technique.FLOATS + 100 * int(frames["receivers"][0])
    assert frames["memory_bytes"][0] == expected
    assert frames["memory_budget_bytes"][0] == 2**30


def test_nothing_personal_is_written(run, tmp_path: Path) -> None:
    assert run("--set", "fake.fault=create") == 1
    assert run("--save-images", out="fine") == 0
    for name in ("out", "fine"):
        for file in (tmp_path / name).glob("*.*"):
            text = file.read_bytes().decode(errors="replace")
            assert str(tmp_path) not in text, file
            assert "/home/" not in text, file
            assert "/root" not in text, file


def test_options_a_technique_lacks_run_it_once(run, tmp_path: Path) -> None:
    assert (
        run(
            *("--technique", "fake", "--sh-order", "0", "--sh-order", "1", "--probes", "5"),
            *("--variant", "published", "--variant", "tuned"),
            technique="plain",
        )
        == 0
    )
    _, _, frames = tables(tmp_path / "out")
    assert len(frames[frames["technique"] == "plain"]) == 1
    fakes = frames[frames["technique"] == "fake"]
    assert len(fakes) == 4
    assert set(fakes["probes"]) == {5}


def test_a_size_over_the_profile_is_skipped_and_the_rest_go_on(run, tmp_path: Path) -> None:
    assert run("-w", "64", "-w", "3000", "-w", "1024") == 0
    samples, passes, frames = tables(tmp_path / "out")
    assert set(samples["workgroup_size"]) == {64, 3000, 1024}  # 'read' fixes its own size
    big = passes[passes["workgroup_size"] == 3000].set_index("pass")
    assert big.loc["triad", "status"] == "skipped"
    assert "512" in big.loc["triad", "reason"]
    assert np.isnan(big.loc["triad", "median_ms"])
    assert big.loc["read", "status"] == "ok"
    by_size = frames.set_index("workgroup_size")
    assert by_size.loc[64, "status"] == "ok"
    assert by_size.loc[3000, "status"] == "skipped"
    assert np.isnan(by_size.loc[3000, "median_ms"])  # half a frame is no frame


def test_a_pass_that_does_not_build_fails_alone(run, tmp_path: Path, capsys) -> None:
    assert run("--set", "fake.fault=build") == 1
    assert len(capsys.readouterr().err.splitlines()) == 1
    samples, passes, frames = tables(tmp_path / "out")
    assert set(samples["pass"]) == {"triad"}
    assert dict(zip(passes["pass"], passes["status"], strict=True)) == {
        "triad": "ok",
        "read": "failed",
    }
    assert frames["status"][0] == "failed"
    assert "no/such.cl" in frames["reason"][0]


@pytest.mark.parametrize(
    ("fault", "frames", "told"),
    (("frame", 1, "told to fall over in a frame"), ("nan", 4, "not finite")),
)
def test_a_fault_in_a_frame_keeps_what_was_measured(
    run, tmp_path: Path, capsys, fault: str, frames: int, told: str
) -> None:
    # Warm-up is one frame, so frame 2 is the second that is measured.
    assert run("--warmup", "1", "--set", f"fake.fault={fault}") == 1
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    assert told in err
    samples, _, table = tables(tmp_path / "out")
    assert samples["frame"].nunique() == frames
    assert table["status"][0] == "failed"
    assert told in table["reason"][0]


def test_nothing_ran_is_the_first_reason_and_its_code(run, tmp_path: Path, capsys) -> None:
    assert run("--set", "fake.fault=bake") == 2
    assert capsys.readouterr().err == "gibench: the bake refuses\n"
    _, passes, frames = tables(tmp_path / "out")
    assert frames["status"][0] == "failed"
    assert passes["reason"][0] == "the bake refuses"


def test_ctrl_c_keeps_what_was_measured(run, tmp_path: Path, capsys) -> None:
    fault = ("--set", "fake.fault=interrupt", "--set", "fake.fault_frame=5")
    assert run(*fault, "--warmup", "2", "-w", "64", "-w", "128") == 130
    (line,) = capsys.readouterr().err.splitlines()
    samples, passes, frames = tables(tmp_path / "out")
    # One of the two, by lot, came to frame 5: three of two passes were measured before it.
    stopped, other = frames["frames"].max(), frames["frames"].min()
    assert stopped == 3
    assert len(samples) == 2 * (stopped + other)
    assert f"{len(samples)} samples are kept" in line
    for _, frame in frames.iterrows():
        assert f"interrupted after {frame['frames']} of 4 frames" in frame["reason"]
        assert frame["status"] == ("ok" if frame["frames"] else "skipped")
    assert set(passes["frames"]) == {stopped, other}
    assert json.loads((tmp_path / "out" / "run.json").read_text())["interrupted"]
    assert "Interrupted" in (tmp_path / "out" / "report.md").read_text()


def test_too_much_is_refused_before_it_is_baked(run, small, capsys) -> None:
    # 500 receivers of 4 KiB are twice the memory there is; the bake would raise something else.
    assert run(*small, "--set", "fake.floor_per_receiver=4096", "--set", "fake.fault=bake") == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{500 * 4096:,} bytes" in line
    assert f"{1 << 20:,}" in line
    assert "--receivers 256" in line


def test_a_refused_allocation_says_what_would_fit_and_fits(run, small, capsys) -> None:
    big = (*small, "--set", "fake.bytes_per_receiver=1024")  # half a MB in one buffer
    assert run(*big) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert f"allows {1 << 18:,} in one" in line
    suggestion = line.split("--receivers ")[1].split()[0]
    assert run(*big, "--receivers", suggestion, out="smaller") == 0


def test_fit_lowers_the_receivers_and_says_so(run, small, tmp_path: Path) -> None:
    assert run(*small, "--set", "fake.bytes_per_receiver=1024", "--fit") == 0
    _, passes, frames = tables(tmp_path / "out")
    assert 64 < frames["receivers"][0] <= 256
    for table in (passes, frames):
        assert table["reason"].str.contains("instead of 500").all()
        assert set(table["status"]) == {"ok"}
    assert "instead of 500" in (tmp_path / "out" / "report.md").read_text()


def test_the_same_run_may_be_repeated_and_no_other_replaces_it(run, tmp_path: Path, capsys) -> None:
    assert run() == 0
    first = (tmp_path / "out" / "samples.csv").read_text()
    assert run() == 0
    again = (tmp_path / "out" / "samples.csv").read_text()
    assert len(again.splitlines()) == len(first.splitlines())  # replaced, not appended to
    capsys.readouterr()
    assert run("--seed", "9") == 2
    assert "already holds another run" in capsys.readouterr().err
    assert (tmp_path / "out" / "samples.csv").read_text() == again


def test_settings_are_typed(run, tmp_path: Path, capsys) -> None:
    assert (
        run("--set", "fake.flag=yes", "--set", "fake.scale=0.25", "--set", "fake.fault=none") == 0
    )
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    settings = record["configurations"][0]["settings"]
    assert (settings["flag"], settings["scale"], settings["fault"]) == (True, 0.25, None)
    for bad, told in (
        ("fake.flag=maybe", "true or false"),
        ("fake.fault_frame=1.5", "a whole number"),
        ("fake.scale=-1", "scale is -1.0"),
        ("fake.sh_order=2", "--sh-order"),
        ("fake.nothing=1", "no setting 'nothing'"),
    ):
        capsys.readouterr()
        assert run("--set", bad, out="bad") == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert told in line


def test_quiet_prints_nothing(run, capsys) -> None:
    assert run("--quiet") == 0
    assert capsys.readouterr() == ("", "")


def test_sample_columns_begin_with_the_contract() -> None:
    assert list(sample_columns(("sh_order",), ("probes",))[:10]) == CONTRACT_SAMPLES.split()
