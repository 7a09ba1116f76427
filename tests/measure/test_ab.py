"""`gibench ab` from trees to verdict: real processes once, made-up times for the rest."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.measure.compare import ab as ab_module
from gibench.measure.compare.kernel_trees import kernel_tree
from gibench.measure.compare.lockstep import FRAME, PairTimes, SideFailed
from gibench.profiles import load_profile
from gibench.techniques.job import Job
from gibench.techniques.registry import find_technique

TREE = Path(__file__).parents[2] / "kernels_cl"
SMALL = ("--technique", "direct", "--receivers", "200", "--resolution", "32x24")


def told(capsys: pytest.CaptureFixture[str]) -> str:
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.fixture
def timed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Runs ab with made-up times of ``ratio`` in place of processes; counts the pairs."""

    def run(ratio: float, *arguments: str, noise: float = 0.01) -> tuple[int, int]:
        pairs = []
        draws = np.random.default_rng(9)

        def pair(job, old, new, *, frames, warmup, rng, keep, patience):
            pairs.append(1)
            if keep is not None:
                for name in ("OLD", "NEW"):
                    np.savez(keep / f"{name}.npz", **{"indirect irradiance": np.ones((4, 3))})
            base = {name: draws.lognormal(0, 0.05, frames) for name in (FRAME, "camera")}
            scale = {name: ratio * np.exp(draws.normal(0, noise)) for name in base}
            return PairTimes(base, {name: base[name] * scale[name] for name in base})

        monkeypatch.setattr(ab_module, "time_pair", pair)
        monkeypatch.setattr(ab_module, "bake_once", lambda job, cache: None)
        code = call(["ab", str(TREE), str(TREE), *SMALL, *arguments])
        return code, len(pairs)

    return run


def test_the_same_kernels_pass_after_the_fewest_pairs(timed, capsys) -> None:
    assert timed(1.0) == (0, 9)
    out = capsys.readouterr().out
    assert out.count("same") >= 2
    assert "Old and new are the same kernels." in out


def test_slower_kernels_fail_by_name(timed, tmp_path: Path, capsys) -> None:
    files = "--json", str(tmp_path / "a.json"), "--markdown", str(tmp_path / "a.md")
    assert timed(1.12, *files) == (1, 9)
    assert "slower by more than 5%: frame, camera" in told(capsys)
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["slower"] == [FRAME, "camera"]
    assert len(content["log_ratios"][FRAME]) == 9
    assert "| 🔴 | camera |" in (tmp_path / "a.md").read_text()
    assert timed(1.12, "--threshold", "20%")[0] == 0


def test_what_cannot_be_told_asks_for_more_and_does_not_fail(timed, capsys) -> None:
    assert timed(1.05, noise=0.05) == (0, 24)
    assert "Ambiguous: frame, camera. More replicates may tell" in capsys.readouterr().out
    assert timed(1.2, "--replicates", "3") == (0, 3)
    assert "too few replicates" in capsys.readouterr().out


def test_real_processes_take_turns(tmp_path: Path, capsys) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(TREE, broken)
    for file in broken.rglob("camera*.cl"):
        file.write_text(file.read_text().replace("__kernel", "__kernel nonsense"))
    common = (*SMALL, "--cache-dir", str(tmp_path / "cache"), "--replicates", "1")
    report = ("--json", "-", "--frames", "3")
    assert call(["ab", str(TREE), str(TREE), *common, *report]) == 0
    content = json.loads(capsys.readouterr().out)
    assert [row["row"] for row in content["rows"]] == [FRAME, "camera"]
    assert content["output_difference"]["image frame"] == 0.0
    assert content["rows"][0]["old_ms"] > content["rows"][1]["old_ms"] > 0
    assert call(["ab", str(broken), str(TREE), *common]) == 2
    assert "the baseline does not run: OLD: camera" in told(capsys)
    assert call(["ab", str(TREE), str(broken), *common]) == 1
    assert "NEW: camera" in told(capsys)


def test_trees_are_folders_or_revisions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def git(*arguments: str) -> None:
        who = ("-c", "user.name=n", "-c", "user.email=e@example.org")
        subprocess.run(["git", *who, *arguments], check=True, capture_output=True)

    git("init", "-q")
    kernel = tmp_path / "kernels_cl" / "a.cl"
    kernel.parent.mkdir()
    kernel.write_text("one")
    git("add", ".")
    git("commit", "-qm", "one")
    kernel.write_text("two")
    old, new = (kernel_tree(name, tmp_path / "unpacked") for name in ("HEAD", "."))
    assert (old.root / "a.cl").read_text() == "one"
    assert (new.root / "a.cl").read_text() == "two"
    assert old.content_hash != new.content_hash
    assert kernel_tree("kernels_cl", tmp_path).content_hash == new.content_hash
    (tmp_path / "empty").mkdir()
    for bad in ("nosuch", "--upload-pack=x", "empty"):
        with pytest.raises(BadInput):
            kernel_tree(bad, tmp_path)


def test_a_side_that_dies_is_named() -> None:
    from gibench.measure.compare.lockstep import replicates
    from gibench.measure.compare.replicate import Place

    profile, settings = load_profile("iphone7"), find_technique("direct").settings({})
    bad = Job("nosuch", settings, "tuned", "cornell-box", profile, 64)
    told_so = pytest.raises(SideFailed, match="NEW: no technique called 'nosuch'")
    with told_so as failed, replicates(bad, ("NEW", Place("/nowhere"))):
        pass
    assert failed.value.exit_code == 2
