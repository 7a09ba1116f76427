"""Times are taken once a technique is at rest: how long it is waited for, and what a row says."""

from __future__ import annotations

import io
import json
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support import fake_technique
from support.fake_technique import Resting
from support.run_folders import entry, record, write_run

import gibench
from gibench.cli.main import call
from gibench.device.selection import select_cl_device
from gibench.measure.compare import replicate
from gibench.measure.plan.grid import grid
from gibench.measure.plan.stopping import Patience, Plan
from gibench.measure.session.rest import RestWatch, kept_awake, warm_up
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.measure.statistics.summary import Roofs
from gibench.profiles import load_profile
from gibench.scene.builtin import build
from gibench.scene.model import DirectionalLight, PointLight, SpotLight
from gibench.study.frozen import FrozenShared
from gibench.study.rows import Rows
from gibench.study.settle import SettleOptions, settle
from gibench.techniques.camera_path import FlightOptions
from gibench.techniques.job import Shot, World
from gibench.techniques.parts.steady import Steady
from gibench.techniques.registry import Wakes, find_technique
from gibench.techniques.technique import LOOK_EVERY
from gibench.work import Worker


def test_what_stands_still_is_told_by_windows_of_looks(rng: np.random.Generator) -> None:
    steady = Steady(0.01, window=3)
    assert [steady.takes(value) for value in (5, 5, 5, 5, 5)] == [False] * 5  # too few looks
    assert steady.takes(5)
    assert not Steady(0.01).takes(0)
    rising = Steady(0.01, window=4)
    told = [rising.takes(value) for value in 1 - np.exp(-np.arange(400) / 50)]
    first = told.index(True)
    means = [1 - np.exp(-np.arange(k, k + 4) / 50).mean() for k in (first - 7, first - 3)]
    assert means[1] / means[0] - 1 <= 0.01
    assert all(told[first:])
    # Noise at the threshold tells once; a change tells that it moves again.
    noisy = Steady(0.05, window=4)
    found = [noisy.takes(value) for value in 1 + rng.uniform(-0.024, 0.024, 300)]
    assert found[7:] == [True] * (len(found) - 7)
    assert not any(noisy.takes(value) for value in (1.5, 2.0, 2.5))


def test_warm_up_waits_within_its_limits_and_then_for_times() -> None:
    flat = [10.0] * 4000
    plan = Plan(patience=Patience(frames=200, seconds=1.5))
    assert not plan.warm(flat[:120], None)
    assert not plan.warm(flat[:159], None)
    assert plan.warm(flat[:160], None)  # 1.5 s of frames of 10 ms, and two windows
    assert plan.patience.spent(flat[:149]) is None
    assert plan.patience.spent(flat[:170]) == 150
    assert Patience(frames=0).spent([]) == 0
    unwaited = Plan(patience=Patience(frames=0))
    assert [unwaited.warm(flat[:n], None) for n in (0, 9, 10)] == [False, False, True]
    assert plan.warm(flat[:154], 144) and not plan.warm(flat[:153], 144)
    assert not plan.warm([*flat[:5], 40.0], 6)
    assert Plan(patience=Patience(frames=200)).warm(flat[:210], None)
    assert plan.waited(flat[:149], None) is None
    assert plan.waited(flat[:170], None) == 150
    assert plan.waited(flat[:170], 96) == 96
    assert Plan(warmup=7).waited(flat[:3], None) == 0
    # Caps on warm-up are counted from rest: frames of growing times after 100 until then.
    wild = [1.0] * 100 + [2.0**k for k in range(61)]
    assert not Plan(warmup_seconds=1e30).warm(wild[:155], 100)
    assert Plan(warmup_seconds=1e30).warm(wild[:160], 100)
    assert Plan(warmup=7).warm(flat[:7], None) and not Plan(warmup=7).warm(flat[:6], 0)
    assert Plan().warm(flat[:10]) and not Plan().warm(flat[:9])


def test_images_are_of_a_frame_at_rest_that_is_always_run() -> None:
    assert Plan().image_frame() == 39
    assert Plan(frames=20).image_frame() == 29
    assert Plan(frames=20, warmup=4).image_frame() == 23
    assert Plan().expected(True) - Plan().expected() == Plan().patience.frames
    assert Plan(warmup=3).expected(True) == Plan(warmup=3).expected()


MOVING = (
    (DirectionalLight((0.6, -0.8, 0), (1, 1, 1), swing_degrees=3.0), True),
    (DirectionalLight((0, -1, 0), (1, 1, 1), swing_degrees=3.0), False),  # about itself
    (DirectionalLight((0, -1, 0), (1, 1, 1)), False),
    (PointLight((0, 1, 0), (1, 1, 1), orbit_radius=0.1, period_frames=3), True),
    (PointLight((0, 1, 0), (1, 1, 1)), False),
    (SpotLight((0, 1, 0), (0, -1, 0), (1, 1, 1)), False),
)


@pytest.mark.parametrize(("light", "moves"), MOVING, ids=lambda value: type(value).__name__)
def test_what_moves_keeps_awake_whom_it_concerns(light: Any, moves: bool) -> None:
    scene = replace(build("two-rooms"), lights=(SpotLight((0, 1, 0), (1, 0, 0), (1, 1, 1)), light))
    camera = scene.cameras[0]
    told = {name: find_technique(name) for name in ("direct", "srp", "ddgi", "gibs")}

    def awake(**moving: Any) -> dict[str, str]:
        world = World(scene, None, None, camera, **moving)  # type: ignore[arg-type]
        return {name: kept_awake(spec, world) for name, spec in told.items()}

    lights = "lights move" if moves else ""
    assert awake() == {"direct": "", "gibs": "", "srp": lights, "ddgi": lights}
    flight = FlightOptions("flight", 1, 9).of(scene, camera)
    flown = awake(flight=flight, motion=SimpleNamespace(held=None, moves=True, materials=None))
    assert flown["gibs"] == "the camera flies and objects move"
    assert flown["ddgi"].endswith("lights move") == moves
    assert flown["direct"] == ""


@pytest.fixture
def specs(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    found = {"fake": fake_technique.SPEC}
    monkeypatch.setattr("gibench.techniques.registry.techniques", lambda: found)
    roofs = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)
    monkeypatch.setattr("gibench.measure.machine.roofs.measure_roofs", lambda *_: roofs)
    return found


@pytest.fixture
def run(specs: dict[str, Any], tmp_path: Path):
    def start(*arguments: str, code: int = 0, out: str = "out") -> pd.DataFrame:
        command = ["run", "--no-quality", "--technique", "fake", "--receivers", "400", "--quiet"]
        command += ["--resolution", "16x8", "--cache-dir", str(tmp_path / "cache")]
        assert call([*command, "--out", str(tmp_path / out), *arguments]) == code
        return pd.read_csv(tmp_path / out / "frames.csv")

    return start


def rests(frames: int) -> tuple[str, str]:
    return "--set", f"fake.rests_after={frames}"


def test_frames_are_timed_from_when_it_is_at_rest(run, tmp_path: Path) -> None:
    row = run(*rests(90), "--frames", "6").iloc[0]
    assert (row["rest"], row["frames_to_rest"]) == ("at rest", 96)  # looked at every 8 frames
    assert row["warmup"] >= 96
    assert row["ms_to_rest"] > 0
    assert pd.isna(row["reason"])
    samples = pd.read_csv(tmp_path / "out" / "samples.csv")
    assert samples["frame"].min() == row["warmup"] and samples["frame"].nunique() == 6
    (entry,) = json.loads((tmp_path / "out" / "run.json").read_text())["configurations"]
    assert (entry["rest"], entry["frames_to_rest"]) == ("at rest", 96)
    report = (tmp_path / "out" / "report.md").read_text()
    assert "1 of 1 configurations: at rest when timed." in report
    assert f"| 6 | 96 | {row['ms_to_rest']:,.0f} |" in report
    page = tmp_path / "page.html"
    assert call(["report", str(tmp_path / "out"), "--html", "--out", str(page)]) == 0
    assert '"frames to rest", "ms to rest"' in page.read_text()


def test_the_terminal_says_what_filling_took(run, capsys) -> None:
    run(*rests(20), "--frames", "3")
    assert capsys.readouterr().out == ""
    command = ["--resolution", "16x8", "--receivers", "400", "--frames", "3", *rests(20)]
    assert call(["run", "--no-quality", "--technique", "fake", *command]) == 0
    assert "at rest after 24 frames, " in capsys.readouterr().out


def test_one_that_never_rests_is_waited_for_within_the_limits(run, tmp_path: Path) -> None:
    row = run(*rests(10**6), "--frames", "4", "--warmup-frames", "24").iloc[0]
    assert row["rest"] == row["reason"] == f"not at rest after {row['warmup']} frames"
    assert 24 <= row["warmup"] <= 24 + 60  # and until times have settled
    assert (row["frames"], row["status"]) == (4, "ok")
    assert pd.isna(row["frames_to_rest"]) and pd.isna(row["ms_to_rest"])
    assert row["rest"] in (tmp_path / "out" / "report.md").read_text()
    short = run(*rests(10**6), "--frames", "4", "--warmup-seconds", "0.01", out="short").iloc[0]
    assert 1 <= short["warmup"] < 1000
    unwaited = run(*rests(10**6), "--frames", "4", "--warmup-frames", "0", out="none").iloc[0]
    assert 10 <= unwaited["warmup"] <= 60  # as of one that does not tell


def test_exact_warm_up_is_exact_and_says_so(run) -> None:
    row = run(*rests(40), "--frames", "4", "--warmup", "3").iloc[0]
    assert (row["warmup"], row["rest"]) == (3, "not at rest after 3 frames")
    longer = run(*rests(40), "--frames", "4", "--warmup", "50", out="longer").iloc[0]
    assert (longer["warmup"], longer["rest"], longer["frames_to_rest"]) == (50, "at rest", 40)


def test_one_that_wakes_while_it_is_timed_is_told(run) -> None:
    row = run(*rests(8), "--set", "fake.wakes_after=30", "--frames", "40").iloc[0]
    total = row["warmup"] + 40
    assert row["frames_to_rest"] == 8
    assert row["rest"] == row["reason"] == f"not at rest any more after {total} frames"


def test_one_that_does_not_tell_or_never_rests_is_warmed_up_as_ever(run, specs, tmp_path) -> None:
    plain = run("--frames", "4").iloc[0]
    assert plain[["rest", "frames_to_rest", "ms_to_rest", "reason"]].isna().all()
    assert 10 <= plain["warmup"] <= 60
    specs["fake"] = replace(fake_technique.SPEC, woken_by=frozenset({Wakes.LIGHTS}))
    row = run(*rests(8), "--frames", "4", out="awake").iloc[0]
    assert row["rest"] == "never at rest: lights move"
    assert pd.isna(row["frames_to_rest"]) and pd.isna(row["reason"])
    assert 10 <= row["warmup"] <= 60
    report = (tmp_path / "awake" / "report.md").read_text()
    assert "1 of 1 configurations: never at rest: lights move; timed once times had" in report


def test_looks_are_no_part_of_any_frame(run, monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    asked, look = [], Resting.at_rest

    def slow(self: Resting) -> bool:
        asked.append(self.last_frame + 1)
        time.sleep(0.3)
        return look(self)

    monkeypatch.setattr(Resting, "at_rest", slow)
    row = run(*rests(30), "--frames", "20").iloc[0]
    last = row["warmup"] + 20
    assert asked == [0, 8, 16, 24, 32, last]  # none between timed frames
    walls = pd.read_csv(tmp_path / "out" / "samples.csv")["frame_wall_ms"]
    assert walls.median() < 150
    assert row["ms_to_rest"] < 300 * 4


def test_pictures_are_of_it_at_rest(run, monkeypatch: pytest.MonkeyPatch) -> None:
    taken, images = [], Resting.images

    def seen(self: Resting) -> dict[str, Any]:
        taken.append(self.last_frame)
        return images(self)

    monkeypatch.setattr(Resting, "images", seen)
    run(*rests(50), "--frames", "12", "--save-images")
    assert taken == [56 + 10 + 12 - 1]
    limited = ("--save-images", "--warmup-frames", "20")
    run(*rests(900), "--frames", "12", *limited, out="short")
    assert taken[1:] == [20 + 10 + 12 - 1]


def test_pictures_show_the_same_frame_of_the_scene(
    run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """However long each is waited for, and where caps on seconds end it before that frame."""
    shown, frame, images = {}, Session.frame, Session.images
    scene_frames: dict[int, list[int]] = {}

    def ran(self: Session, number: int) -> Any:
        seen = scene_frames.setdefault(id(self), [])
        assert number == len(seen)
        seen.append(self.world.clock.shows(number))
        return frame(self, number)

    def taken(self: Session) -> dict[str, Any]:
        shown[self.job.settings.rests_after] = scene_frames[id(self)][-1]
        return images(self)

    monkeypatch.setattr(Session, "frame", ran)
    monkeypatch.setattr(Session, "images", taken)
    both = (*rests(0), *rests(100), "--save-images")
    run(*both, "--frames", "5")
    assert shown == {0: 14, 100: 14}
    # While it was waited for, nothing moved; afterwards every frame is the scene's next.
    waited, others = sorted(scene_frames.values(), key=len, reverse=True)
    assert waited[:105] == [0] * 105 and waited[104:] == list(range(len(waited) - 104))
    assert others == list(range(len(others)))
    report = (tmp_path / "out" / "report.md").read_text()
    assert "all of the scene's frame 14" in report
    monkeypatch.setattr(Plan, "enough", lambda self, walls: "a cap" if len(walls) > 2 else None)
    run(*both, out="capped")
    assert shown == {0: 39, 100: 39}


def test_ctrl_c_in_a_long_warm_up_keeps_what_is_there_and_can_be_run_again(
    run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    frame, calls = Session.frame, []

    def interrupted(self: Session, number: int) -> Any:
        calls.append(number)
        if number == 120:  # the first has ended by then, however long its times take to settle
            raise KeyboardInterrupt
        return frame(self, number)

    monkeypatch.setattr(Session, "frame", interrupted)
    both = (*rests(8), *rests(200), "--frames", "20", "--warmup-frames", "300")
    frames = run(*both, code=130)
    assert "samples are kept" in capsys.readouterr().err
    assert list(frames["rests_after"]) == [8, 200]
    first, second = frames.to_dict("records")
    assert (first["frames"], first["status"], first["rest"]) == (20, "ok", "at rest")
    assert (second["frames"], second["status"]) == (0, "skipped")
    assert second["reason"] == "interrupted after 0 of 20 frames, 120 of warm-up"
    assert second["rest"] == "not at rest after 120 frames"
    assert len(gibench.load_run(tmp_path / "out").samples) == 20 * 2
    monkeypatch.setattr(Session, "frame", frame)
    again = run(*both)
    assert list(again["frames"]) == [20, 20] and list(again["frames_to_rest"]) == [8, 200]
    assert len(gibench.load_run(tmp_path / "out").samples) == 40 * 2


def test_tuned_sizes_are_chosen_at_rest(run, tmp_path: Path) -> None:
    def sweep(out: str) -> dict[str, Any]:
        content = json.loads((tmp_path / out / "run.json").read_text())
        return dict(content["configurations"][0]["workgroup_sweep"])

    run(*rests(20), "-w", "auto", "--frames", "3")
    assert sweep("out")["rest"] == ""
    run(*rests(10**6), "-w", "auto", "--frames", "3", "--warmup-frames", "16", out="never")
    assert sweep("never")["rest"] == "not at rest after 16 frames"
    text = (tmp_path / "never" / "report.md").read_text()
    assert "work-group sizes were chosen not at rest after 16 frames." in text


def fake_job(**settings: Any) -> Any:
    given = {"fake": {name: (value,) for name, value in settings.items()}}
    profile, spec = load_profile("iphone7"), fake_technique.SPEC
    (job,) = grid([profile], [spec], settings=given, receivers=(400,), shot=Shot(16, 8))
    return job


def test_quality_settles_what_is_at_rest(specs, tmp_path: Path) -> None:
    shared = FrozenShared(tmp_path, 0)

    def settled(options: SettleOptions, **settings: Any) -> Any:
        device = select_cl_device(None)
        return settle(fake_job(**settings), options, shared, device, Worker())

    plain = settled(SettleOptions())
    assert (plain.frames, plain.rest, plain.frames_to_rest) == (32, "", None)
    late = settled(SettleOptions(), rests_after=100)
    assert (late.frames, late.rest, late.frames_to_rest) == (128, "at rest", 104)
    assert late.settled and late.unrested == "" and late.ms_to_rest > 0
    never = settled(SettleOptions(frames=64), rests_after=100)
    assert (never.frames, never.settled) == (64, True)
    assert never.rest == never.unrested == "not at rest after 64 frames"


def test_experiments_time_what_is_at_rest(specs, tmp_path: Path) -> None:
    for least, after, patience, frames in ((5, 20, 100, 24), (50, 20, 100, 50), (5, 99, 12, 12)):
        with Session.open(
            fake_job(rests_after=after), Shared(tmp_path, 0), select_cl_device(None)
        ) as session:
            session.prepare(whole=True)
            watch = warm_up(session, least, Patience(frames=patience))
            assert watch.frames == frames == session.technique.last_frame + 1  # type: ignore[attr-defined]
            assert watch.waits == (after == 99)
            assert RestWatch(session, "x moves").in_words() == "never at rest: x moves"


def test_frames_that_move_elsewhere_are_set_aside(specs, tmp_path: Path) -> None:
    """Of a flight, the frames after it, in which the camera is back."""
    shot = Shot(16, 8, flight=FlightOptions("flight", 3, 20))
    job, shared = replace(fake_job(rests_after=40), shot=shot), Shared(tmp_path, 0)
    with Session.open(job, shared, select_cl_device(None)) as session:
        session.prepare(whole=True)
        assert RestWatch.over(session).never == "the camera flies"
        aside = frozenset({Wakes.CAMERA})
        watch = warm_up(session, 0, Patience(), number_of=lambda n: 23 + n, aside=aside)
        # The fake counts by the number of its last frame.
        assert (watch.frames_to_rest, session.technique.last_frame) == (24, 46)  # type: ignore[attr-defined]
        assert watch.in_words() == "at rest"


def test_a_process_of_ab_tells_when_it_is_at_rest(specs, tmp_path: Path) -> None:
    job, place = fake_job(rests_after=10), replicate.Place(str(tmp_path))
    commands = "".join(f"warm {frame}\n" for frame in range(16)) + "frame 16\n"
    answers = io.StringIO()
    replicate.serve(job, place, io.StringIO(commands), answers)
    ready, *warm, timed = map(json.loads, answers.getvalue().splitlines())
    assert ready["ready"] == ["triad", "read"]
    assert [one["waits"] for one in warm] == [True] * 15 + [False]
    assert warm[-1]["warning"] == "" and warm[0]["warning"] == "not at rest after 1 frames"
    assert warm[-1]["spent_ms"] > warm[0]["spent_ms"] > 0
    assert timed["wall_ms"] > 0


def test_runs_and_studies_from_before_still_load(tmp_path: Path, rng) -> None:
    times = {1: {"one": rng.lognormal(size=20), "two": rng.lognormal(size=20)}}
    old = write_run(tmp_path / "old", record(entry(1, ["one", "two"])), times)
    frame = gibench.load_run(old).frames.iloc[0]
    assert frame[["rest", "frames_to_rest", "ms_to_rest"]].isna().all()
    assert call(["report", str(old), "--html"]) == 0
    path = tmp_path / "rows.csv"
    path.write_text("name,time_ms,status\na,1,ok\nb,2,ok\n")
    rows = Rows.at(path, ("name",), ("time_ms", "rest", "status"))
    assert rows.done({"name": "a"}) and not rows.done({"name": "c"})
    rows.add([{"name": "c", "time_ms": 3.0, "rest": "at rest", "status": "ok"}])
    assert path.read_text().splitlines() == [
        *("name,time_ms,rest,status", "a,1,,ok", "b,2,,ok", "c,3,at rest,ok")
    ]
    assert LOOK_EVERY == 8
