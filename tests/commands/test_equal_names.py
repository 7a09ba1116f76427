"""Scene files of one name in two folders, or of one name at two times, are told apart."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import gibench
from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.history.entries import read_entry
from gibench.measure.compare import ab
from gibench.measure.compare.ab import AbResult
from gibench.measure.compare.kernel_trees import KernelTree
from gibench.measure.compare.paired import Judged
from gibench.measure.compare.replicate import Place
from gibench.study.experiments import EXPERIMENTS
from gibench.study.experiments.common import Context, Experiment, Measuring, Point
from gibench.study.experiments.kept import Found
from gibench.techniques.job import Job
from gibench.work import Worker

# Dark walls: light is traced to its end in a few bounces.
DARK = "newmtl dark\nKd 0.1 0.1 0.1\n"
BOX = "mtllib dark.mtl\nusemtl dark\n"
BOX += "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 {0}\nv 1 0 {0}\nv 1 1 {0}\nv 0 1 {0}\n"
INSIDE = "f 1 2 3 4\nf 8 7 6 5\nf 5 6 2 1\nf 6 7 3 2\nf 7 8 4 3\nf 8 5 1 4\n"


@pytest.fixture
def rooms(tmp_path: Path) -> list[str]:
    """A room and a longer one, both called ``room.obj``."""
    for folder, length in (("a", 1), ("b", 3)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "room.obj").write_text(BOX.format(length) + INSIDE)
        (tmp_path / folder / "dark.mtl").write_text(DARK)
    return [str(tmp_path / folder / "room.obj") for folder in ("a", "b")]


def _points(context: Context) -> Iterator[Point]:
    for path in context.scene_or("cornell-box"):
        name = context.site.standing().scene(path).name
        yield Point({"scene": name}, context.direct(path, context.profiles[0], 60))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    scene = context.site.standing().scene(unit.point.job.scene)
    return Found([{"length": float(scene.bounds[1][2] - scene.bounds[0][2])}])


LENGTHS = Experiment(
    name="lengths", title="Lengths", source="nobody", profiles=("iphone7",), keys=("scene",),
    columns=("length",), points=_points, measure=_measure, present=lambda *given: "",
)  # fmt: skip


def test_an_experiment_measures_both(
    rooms: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(EXPERIMENTS, "lengths", LENGTHS)
    cache, out = tmp_path / "cache", tmp_path / "out"
    asked = {"out": out, "cache_dir": cache}
    found = gibench.experiment("lengths", scene=rooms, **asked)
    assert found.table["scene"].tolist() == ["room", "room-2"]
    assert found.table["length"].tolist() == [1.0, 3.0]
    record = json.loads((out / "run.json").read_text())["arguments"]
    assert record["scene"] == ["room.obj", "room.obj"]
    contents = record["scene_contents"]
    assert list(contents) == ["room", "room-2"] and len(set(contents.values())) == 2
    # What is there is not taken for that of other files of the same names.
    with pytest.raises(BadInput, match="already holds another run"):
        gibench.experiment("lengths", scene=rooms[::-1], **asked)
    again = gibench.experiment("lengths", scene=rooms, **asked)
    pd.testing.assert_frame_equal(again.table, found.table)


def test_advice_goes_on_with_the_same_file_only(rooms: list[str], tmp_path: Path) -> None:
    asked = {"technique": "direct", "receivers": 60, "resolution": "32x18", "frames": 16}
    asked |= {"target_error": 0.9, "cache_dir": tmp_path / "cache", "out": tmp_path / "advice"}
    first = gibench.advise(scene=rooms[0], **asked)
    with pytest.raises(BadInput, match="already holds another run"):
        gibench.advise(scene=rooms[1], **asked)
    again = gibench.advise(scene=rooms[0], **asked)
    times = [np.asarray(one.table["time_ms"], float) for one in (first, again)]
    assert np.array_equal(*times)  # nothing was measured again


def test_ab_has_a_series_for_each(
    rooms: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what the file holds, which its title says and a history reads."""

    def checked(job: Job, place: Place, old: KernelTree, new: KernelTree, *rest: Any) -> AbResult:
        times, judged = {"frame": 1.0}, {"frame": Judged(1.0, 0.99, 1.01, "same", 9)}
        return AbResult(old, new, judged, {"frame": [0.0] * 9}, times, times)

    monkeypatch.setattr(ab, "check", checked)
    entries = []
    for number, room in enumerate((*rooms, rooms[0])):
        file = tmp_path / f"{number}.json"
        asked = ["ab", ".", "--scene", room, "--technique", "direct", "--receivers", "60"]
        assert call([*asked, "--json", str(file), "--cache-dir", str(tmp_path / "cache")]) == 0
        entries.append(read_entry(file).tables["configurations"].iloc[0])
    assert entries[0]["series"] != entries[1]["series"]
    assert entries[0]["series"] == entries[2]["series"]
    assert all(" on room.obj (" in entry["label"] for entry in entries)
