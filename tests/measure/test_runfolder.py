"""The run's folder: whose it is, and that its files are whole."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from support.run_folders import entry, record, write_run

from gibench.errors import BadInput, GibenchError
from gibench.measure.compare.timings import configuration_label
from gibench.measure.runfolder.folder import (
    RunFolder,
    default_folder,
    write_atomically,
)
from gibench.measure.runfolder.stored_run import read_run
from gibench.profiles import load_profile
from gibench.report.tables import frames_table, passes_table

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


def test_a_run_from_before_there_were_layouts_reads_as_one_that_was_wide(tmp_path: Path) -> None:
    content = record(entry(1, ["projection"]))
    path = write_run(tmp_path / "now", content, {1: {"projection": np.ones(3)}})
    now = read_run(path)
    assert set(now.samples["layout"]) == {"wide"}
    lines = [line.split(",") for line in (path / "samples.csv").read_text().splitlines()]
    at = lines[0].index("layout")
    (path / "samples.csv").write_text(
        "".join(",".join(line[:at] + line[at + 1 :]) + "\n" for line in lines)
    )
    kept = json.loads((path / "run.json").read_text())
    del kept["configurations"][0]["layout"]
    (path / "run.json").write_text(json.dumps(kept))
    before = read_run(path)
    assert "layout" not in before.samples
    for make in (passes_table, frames_table):
        (row,) = make(before.samples, before.record).to_dict("records")
        assert row["layout"] is None and row["status"] == "ok"
    labels = [
        configuration_label(run.record["configurations"][0], run.record) for run in (now, before)
    ]
    assert labels[0] == labels[1]
    simt = {**now.record["configurations"][0], "layout": "simt"}
    assert configuration_label(simt, now.record) != labels[0]


def test_a_folder_by_default_lies_in_results_whatever_a_profile_is_called() -> None:
    for name in ("a/../../esc", "..", "a b\n", "/etc", "telefon-7+x.y_z"):
        folder = default_folder([name, "iphone7"])
        assert folder.parent == Path("results/runs") and "\n" not in folder.name
        assert folder.resolve().parent == Path("results/runs").resolve()
    assert default_folder(["a.b", "c_d"]).name.endswith("Z-a.b+c_d")
