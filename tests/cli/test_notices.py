"""Warnings reach the screen: each once, in a line of ours, and none under ``-q``."""

from __future__ import annotations

import logging
import os
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support import fake_technique

from gibench.cli import main
from gibench.cli.main import call
from gibench.report.advice import advice_report
from gibench.report.limits import read_limits
from gibench.scene import builtin
from gibench.scene.model import Scene

ROOM = "mtllib none.mtl\nv 0 0 0\nv 2 0 0\nv 2 0 2\nusemtl a\nf 1 3 2\nl 1 2\n"


@pytest.fixture(autouse=True)
def only_the_fakes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "gibench.techniques.registry.techniques", lambda: {"fake": fake_technique.SPEC}
    )


def _bake(tmp_path: Path, *more: str) -> int:
    (tmp_path / "room.obj").write_text(ROOM)
    scene = str(tmp_path / "room.obj")
    options = ("--receivers", "50", "--cache-dir", str(tmp_path / "cache"))
    return call(["bake", "-t", "fake", "-s", scene, "-s", scene, *options, *more])


def test_each_warning_of_a_scene_once_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _bake(tmp_path) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(set(lines)) >= 3
    assert all(line.startswith("gibench: warning: room: ") for line in lines)
    assert any("'none.mtl' not found" in line for line in lines)


def test_quiet_keeps_errors_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _bake(tmp_path, "-q") == 0
    assert capsys.readouterr().err == ""
    assert call(["bake", "-q", "-t", "fake", "-s", str(tmp_path / "nowhere.obj")]) == 2
    assert capsys.readouterr().err.startswith("gibench: no scene")


def test_a_warning_of_a_library_is_told_in_our_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def names() -> list[str]:
        for _ in range(2):
            warnings.warn("odd\n data", UserWarning, stacklevel=1)
        return []

    monkeypatch.setattr("gibench.commands.listings.names", names)
    assert main.call(["scenes"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "gibench: warning: odd data (UserWarning of a library)"


def test_advice_carries_them() -> None:
    text = advice_report(
        *(pd.DataFrame(), pd.DataFrame(), "p", read_limits(3.0, None, ()), "cpu"),
        ["3 textures missing"],
    )
    assert "\n> 3 textures missing" in text


def test_a_scene_whose_name_is_no_utf_8(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / os.fsdecode(b"b\xfcro.obj")
    path.write_text(ROOM)
    options = ("--receivers", "50", "--cache-dir", str(tmp_path / "cache"))
    assert call(["bake", "-t", "fake", "-s", str(path), *options]) == 0
    out = capsys.readouterr()
    assert "b\\xfcro" in out.out
    out.err.encode()
    path.unlink()
    assert call(["bake", "-t", "fake", "-s", str(path), *options]) == 2
    assert "b\\xfcro.obj" in capsys.readouterr().err


@pytest.mark.parametrize("quiet", [(), ("-q",)])
def test_what_a_library_logs_is_told_in_a_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    quiet: tuple[str, ...],
) -> None:
    build = builtin.build

    def logging_build(name: str) -> Scene:
        for _ in range(2):
            logging.getLogger("trimesh.visual").warning("odd\n texture")
            np.float64(1) / np.float64(0)
        return build(name)

    monkeypatch.setattr(builtin, "build", logging_build)
    options = ("--receivers", "50", "--cache-dir", str(tmp_path))
    assert call(["bake", "-t", "fake", "-s", "cornell-box", *options, *quiet]) == 0
    lines = capsys.readouterr().err.splitlines()
    if quiet:
        assert lines == []
    else:
        assert lines[0] == "gibench: warning: odd texture (told by trimesh)"
        assert len(lines) == 2
        assert lines[1].endswith("(RuntimeWarning of a library)")
