"""``run --project`` and ``gibench project``: ranges that cannot be taken for measured times."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gibench.cli.main import call
from gibench.commands.project import Projected, ranked
from gibench.commands.projected_ratios import Whole, ratio_table
from gibench.errors import GibenchError
from gibench.profiles import built_in_profiles, load_profile
from gibench.project.ranges import Total
from gibench.project.unknowns import POINTS
from gibench.report.projected import (
    COLUMNS,
    RANKED,
    RATIO_COLUMNS,
    WHOLE_FRAME,
    WHOLE_GI,
    projected_section,
    ranking_section,
    ratios_section,
)
from gibench.trace import extra

SMALL = ("-t", "direct", "--resolution", "48x32", "-n", "2", "-w", "64", "--quiet")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def ran(out: Path, cache: Path, *arguments: str) -> int:
    return call(
        ["run", "--no-quality", *SMALL, "--out", str(out), "--cache-dir", str(cache), *arguments]
    )


def test_a_run_is_projected_only_where_that_is_asked(tmp_path: Path, cache: Path) -> None:
    assert ran(tmp_path / "plain", cache) == 0
    assert not (tmp_path / "plain" / "projected.csv").exists()
    assert "rojected" not in (tmp_path / "plain" / "report.md").read_text()
    assert not (cache / "traces").exists()

    out = tmp_path / "asked"
    two = ("--variant", "tuned", "--variant", "published", "--layout", "wide")
    assert ran(out, cache, *two, "--project", "iphone7", "--project", "titan-x-pascal") == 0
    table = pd.read_csv(out / "projected.csv")
    assert tuple(table.columns) == COLUMNS
    assert set(table["device"]) == {"iphone7", "titan-x-pascal"}
    assert {"camera", "(frame)"} <= set(table["pass"])
    assert (table["projected_low_ms"] < table["projected_high_ms"]).all()
    wide = table["projected_high_ms"] > 3 * table["projected_low_ms"]
    assert table.loc[wide, "projected_nominal_ms"].isna().all()
    assert table.loc[~wide, "projected_nominal_ms"].notna().all()
    assert set(table["layout"][table["variant"] == "tuned"]) == {"wide"}
    frame = table[(table["pass"] == "(frame)") & (table["configuration"] == 1)]
    frame = frame.set_index("device")["projected_low_ms"]
    assert frame["iphone7"] > frame["titan-x-pascal"]
    report = (out / "report.md").read_text()
    assert "## Projected, not measured" in report and "never measured" in report
    ratios = pd.read_csv(out / "ratios.csv")
    assert tuple(ratios.columns) == RATIO_COLUMNS
    assert set(ratios["device"]) == {"iphone7", "titan-x-pascal"}
    assert (ratios["pass"] == "(frame)").all()  # direct light has no GI
    assert (ratios["ratio_low"] <= ratios["ratio_high"]).all()
    assert "## Projected ratios, not measured" in report
    for name in ("passes.csv", "frames.csv", "samples.csv"):
        assert "projected" not in (out / name).read_text()

    # From the traces that are there, onto another device.
    kept = sorted((cache / "traces").iterdir())
    assert call(["project", str(out), "-d", "rtx-2070", "--cache-dir", str(cache), "--quiet"]) == 0
    assert set(pd.read_csv(out / "projected.csv")["device"]) == {"rtx-2070"}
    report = (out / "report.md").read_text()
    assert "| rtx-2070 |" in report and "| titan-x-pascal |" not in report
    assert sorted((cache / "traces").iterdir()) == kept


def test_wrong_input_is_one_line(
    tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch
) -> None:
    bare = tmp_path / "bare.toml"
    bare.write_text(built_in_profiles()["vega56"].partition("\n[machine]\n")[0])
    for arguments, told in (
        (("--project", "nokia3310"), "no device profile called 'nokia3310'"),
        (("--project", str(bare)), "no machine part"),
    ):
        assert ran(tmp_path / "out", cache, *arguments) == 2
        error = capsys.readouterr().err
        assert told in error and error.count("\n") == 1
        assert not (tmp_path / "out").exists()  # refused before anything is measured
    assert call(["project", str(tmp_path), "-d", "vega56"]) == 2
    assert "not a run" in capsys.readouterr().err
    monkeypatch.setattr(extra, "PACKAGES", ("no_such_package",))
    assert ran(tmp_path / "out", cache, "--project", "vega56") == 3
    assert "gibench[project]" in capsys.readouterr().err


def test_a_plain_run_needs_nothing_of_the_extra_and_loads_nothing_slow_early() -> None:
    script = (
        "import sys\n"
        "for name in ('numba', 'llvmlite', 'greenlet'):\n"
        "    sys.modules[name] = None\n"
        "import gibench.commands.run, gibench.cli.run, gibench.cli.main\n"
        "slow = {'scipy.stats', 'scipy.interpolate', 'scipy.optimize', 'trimesh', 'matplotlib'}\n"
        "assert not slow & set(sys.modules), slow & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_a_range_that_is_wide_shows_no_time_in_it() -> None:
    row = dict.fromkeys(COLUMNS, "x") | {
        "projected_low_ms": 1.0,
        "projected_nominal_ms": float("nan"),
        "projected_high_ms": 9.0,
        "verdict": "order of magnitude",
    }
    unknown = row | {"projected_high_ms": 40.0, "verdict": "cannot tell"}
    narrow = row | {"projected_nominal_ms": 1.5, "projected_high_ms": 2.0, "verdict": "range"}
    text = projected_section(pd.DataFrame([row, unknown, narrow]))
    assert "| 1.000 to 9.000 ms |" in text
    assert "| cannot tell (1.000 to 40.000 ms) |" in text
    assert "| 1.000 to 2.000 ms (about 1.500) |" in text


def test_settings_are_ranked_by_their_projected_gi(rng: np.random.Generator) -> None:
    noise = rng.uniform(0.95, 1.05, POINTS)

    def projected(ms: float | None, spread: float = 0.0) -> Projected:
        if ms is None:
            return Projected({}, GibenchError("too large to trace"), GibenchError("too large"))
        own = np.exp(spread * rng.normal(size=POINTS))
        own[0] = noise[0] = 1.0
        total = Total(ms * noise * own, "DRAM", {"noise": noise})
        return Projected({}, total, total)

    found = {3: projected(9.0), 5: projected(None), 7: projected(1.0), 8: projected(1.02, 0.4)}
    columns = {"technique": "srp", "variant": "tuned", "settings": "x", "receivers": 100}
    about = pd.DataFrame(columns, index=[3, 5, 7, 8])
    table = ranked(found, load_profile("vega56"), about)
    assert tuple(table.columns) == RANKED
    assert table["number"].tolist() == [7, 8, 3, 5]
    assert table["rank"].tolist()[:3] == [1, 2, 3] and pd.isna(table["rank"][3])
    assert table["slower_than_first"].tolist()[1:3] == ["cannot tell", "sure"]
    assert table["verdict"][3] == "cannot tell"
    text = ranking_section(table)
    assert "GI on vega56: projected, not measured" in text and "| cannot tell |" in text


def test_configurations_are_compared_with_the_cheapest(rng: np.random.Generator) -> None:
    device = np.exp(rng.normal(size=POINTS))  # far wider than any ratio of two on it
    device[0] = 1.0

    def whole(number: int, ms: float | None, scene: str = "hall", **changes) -> Whole:
        head = dict.fromkeys(RATIO_COLUMNS[:7], "x")
        head |= {"configuration": number, "technique": f"t{number}", "scene": scene}
        if ms is None:
            return Whole(head, {WHOLE_FRAME: GibenchError("too large to trace")})
        total = Total(ms * device * changes.pop("own", 1.0), "DRAM", {}, **changes)
        return Whole(head, {WHOLE_FRAME: total})

    apart = np.exp(np.where(np.arange(POINTS) % 2, 2.0, -2.0))
    apart[0] = 1.0
    table = ratio_table(
        [
            *(whole(1, 3.0), whole(2, 1.0), whole(3, None), whole(4, 1.1, own=apart)),
            *(whole(5, 2.0, unseen="its own arrays"), whole(6, 9.0, "elsewhere")),
        ]
    ).set_index("configuration")
    assert (table["cheapest"] == 2).all()
    assert table.index.tolist() == [1, 3, 4, 5]
    assert table["verdict"].tolist() == ["sure", *["cannot tell"] * 3]
    np.testing.assert_allclose(table.loc[1, ["ratio_low", "ratio_high"]].astype(float), 3.0)
    assert table.loc[1, "ratio_nominal"] == pytest.approx(3.0)
    assert pd.isna(table.loc[4, "ratio_nominal"])  # over 3 times wide
    assert table.loc[3, "ratio_reason"] == "too large to trace"
    assert table.loc[5, "ratio_reason"] == "its own arrays"
    assert WHOLE_GI not in set(table["pass"])
    text = ratios_section(table.reset_index())
    assert "| 3.00 to 3.00 times (about 3.00) | 2: t2 x | sure |" in text
    assert ratios_section(table.reset_index().iloc[:0]) == ""
