"""The run's folder: whose it is, and that its files are whole."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from gibench.errors import BadInput, GibenchError
from gibench.measure.runfolder.folder import (
    RunFolder,
    default_folder,
    write_atomically,
)
from gibench.profiles import load_profile

IPHONE, RADEON = load_profile("iphone7"), load_profile("radeon560")


def test_the_folder_belongs_to_one_run(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b"
    folder = RunFolder.create(path, {"seed": 1})
    assert list(path.iterdir()) == []
    folder.write_record({"arguments": {"seed": 1}, "figure": math.nan})
    assert json.loads((path / "run.json").read_text())["figure"] is None
    RunFolder.create(path, {"seed": 1})
    with pytest.raises(BadInput, match="already holds another run"):
        RunFolder.create(path, {"seed": 2})
    (path / "run.json").write_text("{")
    with pytest.raises(BadInput, match="already holds"):
        RunFolder.create(path, {"seed": 1})


def test_samples_are_on_the_disk_as_they_come(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", {})
    folder.start_samples((), ())
    folder.append_samples([("a,b", 1)])
    folder.append_samples([("c", 2)])
    assert (tmp_path / "run" / "samples.csv").read_text().splitlines()[1:] == ['"a,b",1', "c,2"]


def test_a_write_that_fails_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "table.csv"
    write_atomically(path, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(GibenchError, match="No space left on device") as refused:
        write_atomically(path, b"new")
    assert refused.value.exit_code == 1
    assert path.read_bytes() == b"old"
    assert [f.name for f in tmp_path.iterdir()] == ["table.csv"]


def test_default_folders_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    first = default_folder(["iphone7", "vega56"])
    assert first.name.endswith("-iphone7+vega56")
    first.mkdir(parents=True)
    assert default_folder(["iphone7", "vega56"]) != first
    assert default_folder(["vega56"], "quality").parent == Path("results", "quality")
