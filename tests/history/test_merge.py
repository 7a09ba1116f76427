"""Shards: every configuration in one of them, and joined to what one run would have left."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.run_folders import entry, record, write_run

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.history.merge import merge_shards
from gibench.measure.plan.shard import Shard


@given(st.integers(1, 40), st.integers(1, 40))
def test_shards_are_the_whole_each_thing_once(of, more):
    whole = list(range(of + more))
    shares = [Shard(index, of).share(whole) for index in range(1, of + 1)]
    assert [one for share in shares for one in share] == whole
    sizes = {len(share) for share in shares}
    assert min(sizes) >= 1 and max(sizes) - min(sizes) <= 1


@pytest.mark.parametrize("text", ["0/4", "5/4", "1", "a/b", "1/0", "-1/3", ""])
def test_what_is_no_shard_is_refused(text):
    with pytest.raises(BadInput, match="no shard"):
        Shard.parse(text)
    assert Shard.parse(" 2/16 ") == Shard(2, 16) and Shard.parse(None) is None
    with pytest.raises(BadInput, match="divide by 3 at most"):
        Shard(1, 4).positions(3)


def shards_by_hand(folder: Path, rng: np.random.Generator, total: int = 5, of: int = 3):
    """Folders of shards of a run, and of that run whole, with the same random samples."""
    times = {n: {"gather": rng.uniform(1, 9, 4)} for n in range(1, total + 1)}
    entries = [entry(n, ["gather"]) for n in times]
    labels = [str(n) for n in times]
    paths = []
    for index in range(1, of + 1):
        shard = Shard(index, of)
        mine = [one | {"group": 1} for one in shard.share(entries)]
        about = {"arguments": {"frames": 4, "shard": shard.record(labels)}}
        paths.append(write_run(folder / f"shard-{index}", record(*mine, **about), times))
    return paths, write_run(folder / "whole", record(*entries, arguments={"frames": 4}), times)


def test_joined_they_are_the_whole(tmp_path: Path, rng: np.random.Generator) -> None:
    paths, whole = shards_by_hand(tmp_path, rng)
    merged = merge_shards([paths[2], paths[0], paths[1]], tmp_path / "out")
    assert (tmp_path / "out" / "samples.csv").read_text() == (whole / "samples.csv").read_text()
    found = [one["configuration"] for one in merged.record["configurations"]]
    assert found == [1, 2, 3, 4, 5] and merged.total == 5 and merged.shards == 3
    assert [one["group"] for one in merged.record["configurations"]] == [1, 2, 2, 3, 3]
    assert "shard" not in merged.record["arguments"]
    assert [one["shard"] for one in merged.record["shards"]] == ["1/3", "2/3", "3/3"]


def changed(path: Path, change) -> Path:
    content = json.loads((path / "run.json").read_text())
    change(content)
    (path / "run.json").write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("what", "told"),
    [
        (lambda r: r.update(seed=7), "the seed of shard 2/3 is 7, that of shard 1/3 0"),
        (lambda r: r["environment"].update(cpu="Another"), "the machine of shard 2/3 is Another"),
        (lambda r: r["device"].update(driver="9"), "the OpenCL device of shard 2/3 is PoCL 9"),
        (
            lambda r: r["versions"].update(git={"revision": "abc"}),
            "the revision of shard 2/3 is abc, that of shard 1/3 gibench 0.1.0",
        ),
        (lambda r: r["arguments"].update(frames=9), "shard 2/3 was asked for frames 9, shard 1/3"),
        (lambda r: r["arguments"]["shard"].update(whole="x"), "share of other things"),
        (lambda r: r["scenes"][0].update(content_hash="x"), "the scene box of shard 2/3"),
        (lambda r: r.update(finished=False), "shard 2/3 was not finished"),
        (lambda r: r.update(interrupted=True), "shard 2/3 was not finished"),
        (lambda r: r["arguments"].pop("shard"), "it is no shard"),
        (lambda r: r["arguments"]["shard"].update(of=4), "it is shard 2/4"),
    ],
)
def test_what_does_not_belong_together_is_named(tmp_path, rng, what, told):
    paths, _ = shards_by_hand(tmp_path, rng)
    changed(paths[1], what)
    with pytest.raises(BadInput, match=re.escape(told)):
        merge_shards(paths, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_missing_and_repeated_shards_are_named(tmp_path, rng, capsys):
    paths, whole = shards_by_hand(tmp_path, rng)
    out = ["--out", str(tmp_path / "out")]
    assert call(["merge", str(paths[1]), *out]) == 2
    assert "shards 1/3, 3/3 are missing" in capsys.readouterr().err
    shutil.copytree(paths[0], tmp_path / "again")
    assert call(["merge", *map(str, paths), str(tmp_path / "again"), *out]) == 2
    assert "shard 1/3 is there twice" in capsys.readouterr().err
    assert call(["merge", str(whole), *out]) == 2
    assert "no shard" in capsys.readouterr().err


def test_a_run_in_shards_is_the_run(tmp_path: Path) -> None:
    """The same configurations, numbers and columns; only times differ."""
    asked = ["-t", "direct", "--receivers", "200", "--receivers", "250", "--receivers", "300"]
    asked += ["--frames", "2", "--warmup", "0", "--resolution", "32x24"]
    asked += ["--no-quality", "-q", "--save-images", "--cache-dir", str(tmp_path / "cache")]
    folders = {}
    for shard in ("", "1/2", "2/2"):
        folders[shard] = tmp_path / f"run-{shard.replace('/', '-')}"
        more = ["--shard", shard] if shard else []
        assert call(["run", *asked, *more, "--out", str(folders[shard])]) == 0
    merged = tmp_path / "merged"
    assert call(["merge", str(folders["2/2"]), str(folders["1/2"]), "--out", str(merged)]) == 0
    whole, joined = (pd.read_csv(path / "samples.csv") for path in (folders[""], merged))
    key = ["configuration", "frame", "pass"]
    whole, joined = (t.sort_values(key, ignore_index=True) for t in (whole, joined))
    drop = ["time_ms", "frame_wall_ms"]
    pd.testing.assert_frame_equal(whole.drop(columns=drop), joined.drop(columns=drop))
    frames = [pd.read_csv(path / "frames.csv") for path in (folders[""], merged)]
    assert frames[0]["configuration"].tolist() == frames[1]["configuration"].tolist() == [1, 2, 3]
    named = [sorted(p.name for p in (path / "images").iterdir()) for path in (folders[""], merged)]
    assert named[0] == named[1] and len(named[0]) == 3
    assert "direct" in (merged / "report.md").read_text()


def test_advice_in_shards(tmp_path: Path, capsys) -> None:
    """What is not finished is refused; judging what is joined measures nothing again."""
    asked = ["advise", "-t", "direct", "--variant", "tuned", "--variant", "published", "-q"]
    asked += ["--receivers", "200", "--frames", "2", "--target-error", "1", "--budget-ms", "1e6"]
    asked += ["--reference-paths", "16", "--resolution", "32x24", "--cache-dir", str(tmp_path)]
    for index in ("1", "2"):
        shard = ["--shard", f"{index}/2", "--out", str(tmp_path / index)]
        assert call([*asked, *shard]) == 0
        assert not (tmp_path / index / "advice.csv").exists()
    both = ["merge", str(tmp_path / "1"), str(tmp_path / "2"), "--out", str(tmp_path / "merged")]
    table = tmp_path / "2" / "settings.csv"
    whole = table.read_text()
    table.write_text(whole.partition("\n")[0] + "\n")
    assert call(both) == 2
    assert "shard 2/2 was not finished: 1 of 1 are missing" in capsys.readouterr().err
    table.write_text(whole)
    assert call(both) == 0
    assert "--out" in capsys.readouterr().out
    before = (tmp_path / "merged" / "settings.csv").read_text()
    nothing = 3  # direct light answers nothing, but the report is written
    assert call([*asked, "--out", str(tmp_path / "merged")]) == nothing
    assert (tmp_path / "merged" / "settings.csv").read_text() == before
    assert len(pd.read_csv(tmp_path / "merged" / "advice.csv")) == 2
    # Judged on another machine the report names the one that was timed; nothing is added to it.
    changed(tmp_path / "merged", lambda r: r["environment"].update(cpu="Another CPU"))
    assert call([*asked, "--out", str(tmp_path / "merged")]) == nothing
    assert "Another CPU" in (tmp_path / "merged" / "advice.md").read_text()
    (tmp_path / "merged" / "settings.csv").write_text(whole)
    assert call([*asked, "--out", str(tmp_path / "merged")]) == 2
    assert "was measured on Another CPU" in capsys.readouterr().err


@pytest.mark.slow
def test_studies_in_shards_are_the_studies(tmp_path: Path) -> None:
    """An experiment whose points need its first, and advice; the report measures nothing again."""
    cache = ["--cache-dir", str(tmp_path / "cache"), "-q"]
    one = ["experiment", "sh-order", "--quick", "--target-error", "1", "--reference-paths", "16"]
    two = ["advise", "-t", "direct", "-t", "srp", "--sh-order", "0", "--receivers", "200"]
    two += ["--sh-order", "1", "--set", "srp.transport_rays=32", "--set", "srp.relight_samples=32"]
    two += ["--frames", "64", "--target-error", "0.5", "--reference-paths", "16"]
    two += ["--resolution", "32x24", "--budget-ms", "1000000"]
    for asked, table in ((one, "sh-order.csv"), (two, "settings.csv")):
        base = tmp_path / asked[0]
        for index in ("1", "2"):
            shard = ["--shard", f"{index}/2", "--out", str(base / index)]
            assert call([*asked, *cache, *shard]) == 0
        both = [str(base / "1"), str(base / "2"), "--out", str(base / "merged")]
        assert call(["merge", *both]) == 0
        before = (base / "merged" / table).read_text()
        assert call([*asked, *cache, "--out", str(base / "merged")]) == 0
        assert (base / "merged" / table).read_text() == before
    found = pd.read_csv(tmp_path / "experiment" / "merged" / "sh-order.csv")
    assert list(dict.fromkeys(found["sh_order"])) == [7, 2, 0]
    assert set(found["against"]) == {"reference", "order 7"}
    assert (tmp_path / "experiment" / "merged" / "sh-order.md").exists()
    assert len(pd.read_csv(tmp_path / "advise" / "merged" / "advice.csv")) == 5
