"""The HTML report: self-contained, complete, and drawn by a real browser without a complaint."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from support.run_folders import entry, record, write_run

import gibench
from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.report.which_one import ERROR_COLUMNS

PASSES = ["one", "two"]
BIG = "too </script> big"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    rng = np.random.default_rng(4)
    made = []
    for name in ("first", "second"):
        skipped = entry(
            2, PASSES, workgroup_size=3000, status="skipped", reason="too </script> big"
        )
        for item in skipped["passes"]:
            item |= {"status": "skipped", "reason": BIG}
        times = {p: rng.lognormal(1, 0.1, 500) for p in PASSES}
        made.append(write_run(tmp_path / name, record(entry(1, PASSES), skipped), {1: times}))
    folder = tmp_path / "first" / "images" / "01-srp"
    folder.mkdir(parents=True)
    for name in ("frame", "direct-only"):
        Image.fromarray(rng.integers(0, 255, (8, 12, 3), np.uint8)).save(folder / f"{name}.png")
    return made


def page_of(runs: list[Path]) -> str:
    assert call(["report", *map(str, runs), "--html"]) == 0
    return (runs[0] / "report.html").read_text()


def errors_of(folder: Path) -> Path:
    """What quality leaves: two results, of one also a region."""
    (folder / "errors").mkdir()
    columns = "technique,scene,settings,region,rel_l2,bias,time_ms,memory_bytes"
    rows = ("srp,box,sh_order=2,whole,0.2,-0.01,5,1048576", "srp,box,sh_order=2,corner,0.9,0,5,1")
    text = "\n".join([columns, *rows, "direct,box,,whole,1,-1,3,1048576"])
    (folder / "errors" / "quality.csv").write_text(text + "\n")
    return folder / "errors"


def test_errors_stand_beside_times(runs: list[Path], capsys) -> None:
    folder = errors_of(runs[0].parent)
    data = json.loads(re.search(r"const DATA = (.*);\n", page_of([*runs, folder]))[1])
    assert [(e["label"], e["time"], e["error"]) for e in data["errors"]] == [
        ("srp on box", 5, 0.2),
        ("direct on box", 3, 1),
    ]
    assert call(["report", str(folder), "--html"]) == 2
    assert "no run to report" in capsys.readouterr().err
    (folder / "quality.csv").write_text("technique,scene\n")
    assert call(["report", str(runs[0]), str(folder), "--html"]) == 2
    assert "it has no column 'settings'" in capsys.readouterr().err


def test_the_page_holds_everything_itself(runs: list[Path]) -> None:
    text = page_of(runs)
    assert not re.search(r"(?:src|href)=[\"']?(?:https?:)?//", text)
    assert "http://www.w3.org/2000/svg" in text  # a name, not an address
    assert text.count("http") == 1
    assert len(text) < 200_000
    data = json.loads(re.search(r"const DATA = (.*);\n", text)[1])
    assert [run["name"] for run in data["runs"]] == ["first", "second"]
    assert len(data["frames"]["rows"]) == 4
    assert len(data["passes"]["rows"]) == 8
    labels = [one["label"] for one in data["configurations"]]
    assert labels == sorted(labels)  # the same configuration of both runs, one after the other
    assert len(data["images"]) == 2
    assert text.count("</script>") == 1  # a reason cannot end it


def test_the_page_says_what_the_samples_say(runs: list[Path]) -> None:
    data = json.loads(re.search(r"const DATA = (.*);\n", page_of(runs))[1])
    loaded = gibench.load_run(runs[0])
    times = loaded.samples[loaded.samples["pass"] == "one"]["time_ms"]
    (one,) = [c for c in data["configurations"] if c["run"] == "first" and c["passes"]]
    assert one["passes"][0]["median"] == pytest.approx(times.median(), rel=1e-5)
    assert one["passes"][0]["times"][0] == pytest.approx(times.min(), rel=1e-4)
    assert one["passes"][0]["times"][-1] == pytest.approx(times.max(), rel=1e-4)
    assert one["passes"][0]["intensity"] == pytest.approx(10.0)


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.slow
def test_a_browser_draws_it_without_a_complaint(runs: list[Path]) -> None:
    projected_beside(runs[0])
    error = {"configuration": 1, "rel_l2": 0.2, "bias": 0.1, "dark_area": 0.0, "uncovered": 0.0}
    table = pd.DataFrame([error], columns=list(ERROR_COLUMNS))
    table.to_csv(runs[0] / "errors.csv", index=False)
    page_of([*runs, errors_of(runs[0].parent)])
    ran = subprocess.run(
        [
            *(CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--dump-dom"),
            *("--enable-logging=stderr", "--virtual-time-budget=3000"),
            (runs[0] / "report.html").as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "CONSOLE" not in ran.stderr
    # Bars, distributions, roofline with a mark for its technique, errors, projected ranges.
    assert ran.stdout.count("<svg") == 5 + 1
    # Frames, passes, Which one of two runs, and projected ranges.
    assert ran.stdout.count("<tr") == 2 + 4 + 8 + 2 * (1 + 2) + (1 + 3)
    assert ran.stdout.count('class="bad"') == 2 + 4
    assert 'aria-label="one: ' in ran.stdout
    # Nowhere dark to leak to is said; that every receiver is covered need not be.
    assert 'data-title="leak"' in ran.stdout and 'data-title="not covered"' not in ran.stdout


def projected_beside(folder: Path) -> Path:
    """``projected.csv`` of the first run's configuration, as ``gibench project`` leaves it."""
    rows = [
        ("one", 1.5, 2.0, 4.0, "range"),
        ("(GI)", 2.5, float("nan"), 9.0, "range"),
        ("(frame)", 0.5, float("nan"), 90.0, "cannot tell"),
    ]
    head = {"configuration": 1, "technique": "srp", "variant": "tuned", "scene": "box"}
    ends = [f"projected_{end}_ms" for end in ("low", "nominal", "high")]
    table = pd.DataFrame(
        head
        | {"profile": "iphone7", "device": "a-phone", "pass": name, "stage": "gi"}
        | dict(zip(ends, told, strict=True))
        | {"bound_by": "DRAM", "driven_by": "bandwidth", "verdict": verdict}
        | {"projection_reason": float("nan")}
        for name, *told, verdict in rows
    )
    table.to_csv(folder / "projected.csv", index=False)
    return folder


def test_projected_ranges_are_a_section_of_their_own(runs: list[Path], capsys) -> None:
    text = page_of([projected_beside(runs[0]), runs[1]])
    data = json.loads(re.search(r"const DATA = (.*);\n", text)[1])
    (one,) = data["projected"]
    assert (one["title"], one["run"]) == ("On a-phone", "first")
    assert [bar["text"] for bar in one["bars"]] == [
        "2.500 to 9.000 ms",
        "cannot tell (0.500 to 90.000 ms)",
    ]
    assert one["rows"][0][3] == {"text": "1.500 to 4.000 ms (about 2.000)", "value": 1.5}
    assert "never measured" in data["projected_warning"]
    # No projected figure is in a table of measured ones, but in the column that says so.
    assert "a-phone" not in json.dumps([data["frames"], data["passes"], data["configurations"]])
    answer = next(each for each in data["answers"] if each["run"] == "first")
    assert "PROJECTED GI" in answer["columns"]
    assert answer["projected"].startswith("Projected, not measured: ")
    assert call(["report", str(runs[0])]) == 0
    assert "## Projected, not measured" in capsys.readouterr().out


def test_markdown_again(runs: list[Path], capsys) -> None:
    assert call(["report", str(runs[0])]) == 0
    assert "# gibench run" in capsys.readouterr().out


def test_load_run_gives_tables(runs: list[Path], tmp_path: Path) -> None:
    run = gibench.load_run(runs[0])
    assert len(run.samples) == 1000
    assert run.frames["median_ms"].notna().tolist() == [True, False]
    with pytest.raises(BadInput, match="no such run folder"):
        gibench.load_run(tmp_path / "nowhere")


def test_samples_cut_short_are_read_up_to_the_cut(runs: list[Path]) -> None:
    file = runs[0] / "samples.csv"
    file.write_text(file.read_text()[:-30])
    run = gibench.load_run(runs[0])
    assert len(run.samples) == 999


def test_importing_gibench_stays_light() -> None:
    code = "import sys, gibench; print([m for m in ('pandas', 'numpy') if m in sys.modules])"
    ran = subprocess.run(["python", "-c", code], capture_output=True, text=True)
    assert ran.stdout.strip() == "[]"
