"""A built wheel carries everything: kernels, profiles, scenes and its own OpenCL."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_wheel_runs_from_a_fresh_environment_in_another_folder(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(tmp_path / "dist"), str(ROOT)],
        check=True,
        capture_output=True,
    )
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    venv = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", str(venv)], check=True)
    pip = [str(venv / "bin" / "python"), "-m", "pip", "install", "--quiet"]
    subprocess.run([*pip, "--disable-pip-version-check", str(wheel)], check=True)

    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    ran = subprocess.run(
        [
            *(str(venv / "bin" / "gibench"), "run", "--device-profile", "iphone7"),
            *("--scene", "cornell-box", "--technique", "direct", "--frames", "2"),
            *("--receivers", "600", "--resolution", "64x48"),
            *("--cache-dir", str(tmp_path / "cache"), "--out", str(elsewhere / "out")),
        ],
        cwd=elsewhere,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    for name in ("samples.csv", "passes.csv", "frames.csv", "report.md", "run.json"):
        assert (elsewhere / "out" / name).stat().st_size > 0
    assert "forward_render" in (elsewhere / "out" / "passes.csv").read_text()
