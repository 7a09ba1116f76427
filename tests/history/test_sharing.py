"""Runs in one file: nothing personal is in them, and the gallery's tables say who wins."""

from __future__ import annotations

import getpass
import json
import platform
import zipfile
from pathlib import Path

import numpy as np
import pytest
from support.browser import CHROMIUM, browser
from support.run_folders import entry, record, write_run

from gibench.cli.main import call
from gibench.commands.share import make_gallery, submit
from gibench.errors import BadInput, GibenchError
from gibench.history.gallery import gallery_table, winners
from gibench.history.submission import read_submission
from gibench.report.loaded import load_run


def made_run(folder: Path, ms: dict[str, float], rng: np.random.Generator, **changes) -> Path:
    """A run of techniques with a GI pass each, of about so many ms."""
    entries, times = [], {}
    for number, (technique, middle) in enumerate(ms.items(), 1):
        one = entry(number, ["gather"], technique=technique)
        one["passes"][0]["stage"] = "gi"
        entries.append(one)
        times[number] = {"gather": middle * rng.normal(1, 0.01, 9)}
    return write_run(folder, record(*entries, **changes), times)


def test_nothing_personal_is_in_it(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(getpass, "getuser", lambda: "alexandra")
    monkeypatch.setattr(platform, "node", lambda: "moria.example.org")
    asked = {"out": "/home/alexandra/out", "cache_dir": "/home/alexandra/c", "frames": 3}
    asked["scene"] = ["/home/alexandra/scenes/house.glb"]
    run = made_run(tmp_path / "run", {"srp": 2.0}, rng, arguments=asked)
    target = submit(run)
    with zipfile.ZipFile(target) as archive:
        whole = b"".join(archive.read(name) for name in archive.namelist()).decode()
        packed = json.loads(archive.read("run.json"))
    assert packed["arguments"] == {"frames": 3, "scene": ["house.glb"]}
    for word in ("alexandra", "moria", str(tmp_path)):
        assert word not in whole
    assert submit(run, tmp_path / "again.gibench").read_bytes() == target.read_bytes()


@pytest.mark.parametrize("word", ["alexandra", "moria.example.org"])
def test_what_names_a_person_is_refused(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, word: str
) -> None:
    monkeypatch.setattr(getpass, "getuser", lambda: "alexandra")
    monkeypatch.setattr(platform, "node", lambda: "moria.example.org")
    run = made_run(tmp_path / "run", {"srp": 2.0}, rng)
    content = json.loads((run / "run.json").read_text())
    content["configurations"][0]["notes"] = [f"seen by {word}"]
    (run / "run.json").write_text(json.dumps(content))
    with pytest.raises(GibenchError, match="name stands in its"):
        submit(run)
    assert not (tmp_path / "run.gibench").exists()


def test_a_run_comes_back_whole(tmp_path: Path, rng: np.random.Generator) -> None:
    run = made_run(tmp_path / "run", {"srp": 2.0, "ddgi": 5.0}, rng)
    (run / "conform.json").write_text(json.dumps({"wrong": 0}))
    found = read_submission(submit(run))
    before = load_run(run)
    np.testing.assert_array_equal(found.run.frames["gi_ms"], before.frames["gi_ms"])
    assert len(found.run.samples) == len(before.samples)
    assert found.conform == {"wrong": 0}


def test_who_wins_where(tmp_path: Path, rng: np.random.Generator) -> None:
    submissions = []
    for number, times in enumerate(({"srp": 2.0, "ddgi": 6.0}, {"srp": 8.0, "ddgi": 4.0})):
        run = made_run(tmp_path / f"run-{number}", times, rng)
        content = json.loads((run / "run.json").read_text())
        content["environment"]["cpu"] = f"machine {number}"
        (run / "run.json").write_text(json.dumps(content))
        submissions.append(read_submission(submit(run)))
    table = gallery_table(submissions)
    assert len(table) == 4
    won = winners(table)
    assert list(won["technique"]) == ["srp", "ddgi"]
    np.testing.assert_allclose(won["lead"], [3.0, 2.0], rtol=0.05)


def test_wrong_files_are_one_line(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    text, empty, torn = (tmp_path / name for name in ("a.gibench", "b.gibench", "c.gibench"))
    text.write_text("no zip")
    with zipfile.ZipFile(empty, "w") as archive:
        archive.writestr("other", "")
    with zipfile.ZipFile(torn, "w") as archive:
        archive.writestr("run.json", "{}")
        archive.writestr("samples.csv", "")
    run = made_run(tmp_path / "run", {"srp": 2.0}, rng)
    cases = [
        ["gallery", str(text)],
        ["gallery", str(empty)],
        ["gallery", str(torn)],
        ["gallery", str(tmp_path / "nowhere.gibench")],
        ["submit", str(tmp_path)],
        ["submit", str(run), "--out", str(tmp_path)],
        ["submit", str(run), "--conform", str(tmp_path / "nowhere.json")],
    ]
    for case in cases:
        assert call(case) == 2, case
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
    with pytest.raises(BadInput, match="folder"):
        make_gallery([submit(run)], tmp_path)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")
def test_the_gallery_in_a_browser(tmp_path: Path, rng: np.random.Generator) -> None:
    pytest.importorskip("websocket")
    packed = [
        submit(made_run(tmp_path / name, {"srp": 2.0, "gibs": 9.0}, rng)) for name in ("a", "b")
    ]
    page = make_gallery(packed, tmp_path / "gallery.html")
    with browser() as shown:
        shown.open(page.as_uri())
        assert shown.complaints == []
        assert [one for one in shown.requests if not one.startswith("file:")] == []
        assert shown.ask("document.querySelectorAll('#all tbody tr').length") == 4
        assert shown.ask("document.querySelectorAll('#scaling circle').length") == 8
