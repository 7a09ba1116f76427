"""`gibench run` with the real techniques, small, here and in processes of its own."""

from __future__ import annotations

import hashlib
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from gibench.cli.main import call

SCENE = ("--scene", "cornell-box", "--receivers", "600")
SRP = (
    *("--sh-order", "1", "--set", "srp.transport_rays=64"),
    *("--set", "srp.relight_samples=64"),
)
SMALL = (
    *("--device-profile", "iphone7", *SCENE, *SRP),
    *("--resolution", "64x48", "--frames", "3", "--save-images"),
)
SRP_PASSES = [
    *("lightmap_update", "probe_update", "cluster_projection"),
    *("irradiance_transport", "dilate", "camera", "application"),
]


def gibench(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gibench", *arguments], capture_output=True, text=True, timeout=120
    )


def written(cache: Path) -> list[tuple[str, int]]:
    files = [*cache.rglob("*.npz"), *cache.rglob("*.bin")]
    return sorted((f.name, f.stat().st_mtime_ns) for f in files)


def test_baked_once_both_techniques_run_twice_to_the_same_images(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Baked and run in this process, run again in one of its own."""
    cache = ("--cache-dir", str(tmp_path / "cache"))
    assert call(["bake", *SCENE, *SRP, *cache]) == 0
    assert "srp on cornell-box" in capsys.readouterr().out
    stored = written(tmp_path / "cache")
    assert len(stored) >= 2  # the lightmap and a cluster
    pictures = []
    for turn in ("first", "second"):
        command = (
            "run",
            "--no-quality",
            "-t",
            "srp",
            "-t",
            "direct",
            *SMALL,
            *cache,
            "--out",
            str(tmp_path / turn),
        )
        if turn == "first":
            assert call([*command]) == 0
            assert capsys.readouterr().err == ""
        else:
            ran = gibench(*command)
            assert ran.returncode == 0, ran.stderr
            assert ran.stderr == ""
        files = sorted((tmp_path / turn / "images").rglob("*.png"))
        pictures.append([(f.name, hashlib.sha256(f.read_bytes()).hexdigest()) for f in files])
    assert written(tmp_path / "cache") == stored  # nothing was baked again
    assert len(pictures[0]) >= 5
    assert pictures[0] == pictures[1]  # same seed, same images, bit for bit
    passes = pd.read_csv(tmp_path / "first" / "passes.csv")
    assert set(passes["status"]) == {"ok"}
    assert list(passes[passes["technique"] == "srp"]["pass"]) == SRP_PASSES
    assert (passes["median_ms"] > 0).all()
    frames = pd.read_csv(tmp_path / "first" / "frames.csv")
    assert list(frames["technique"]) == ["srp", "direct"]
    assert (frames["memory_bytes"] <= frames["memory_budget_bytes"]).all()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_run_in_one_line_and_keeps_its_samples(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "gibench", "run", "--no-quality", "--technique", "direct"),
            *("--receivers", "600", "--resolution", "32x24", "--frames", "1000000"),
            *("--cache-dir", str(tmp_path / "cache"), "--out", str(tmp_path / "out")),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    begin = time.monotonic()
    samples = tmp_path / "out" / "samples.csv"
    # Unwrapping, building and warming up come before the first block of samples.
    while time.monotonic() - begin < 60:
        if samples.exists() and len(samples.read_text().splitlines()) > 1:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    (line,) = err.splitlines()
    assert line.startswith("gibench: interrupted; ")
    kept = int(line.split()[2].replace(",", ""))
    assert kept > 0
    assert len(samples.read_text().splitlines()) == kept + 1
    assert f"interrupted after {kept} of" in (tmp_path / "out" / "frames.csv").read_text()
