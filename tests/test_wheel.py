"""A built wheel carries everything: kernels, profiles, scenes; and says what it needs beside it."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import sysconfig
from importlib.metadata import packages_distributions, requires
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_wheel_runs_from_another_folder(tmp_path: Path) -> None:
    """By the base interpreter, with the wheel and what it needs, and nothing of the checkout."""
    built, unpacked = tmp_path / "dist", tmp_path / "installed"
    python = [sys.executable, "-m"]
    subprocess.run(
        [*python, "build", "--wheel", "--outdir", str(built), str(ROOT)],
        check=True,
        capture_output=True,
    )
    (wheel,) = built.glob("*.whl")
    pip = [*python, "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*pip, "--target", str(unpacked), str(wheel)], check=True)

    (told,) = unpacked.glob("gibench-*.dist-info")
    assert "gibench.pytest_plugin" in (told / "entry_points.txt").read_text()

    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    # As a mere folder of the path, site-packages does not lead to an editable installation.
    needed = os.pathsep.join([str(unpacked), sysconfig.get_path("purelib")])
    environment = {k: v for k, v in os.environ.items() if k not in ("VIRTUAL_ENV", "PYTHONHOME")}
    ran = subprocess.run(
        [
            *(getattr(sys, "_base_executable", sys.executable), "-m", "gibench"),
            *("run", "--no-quality", "--device-profile", "iphone7"),
            *("--scene", "cornell-box", "--technique", "direct", "--frames", "2"),
            *("--receivers", "600", "--resolution", "64x48"),
            *("--cache-dir", str(tmp_path / "cache"), "--out", str(elsewhere / "out")),
        ],
        cwd=elsewhere,
        env={**environment, "PYTHONPATH": needed},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    for name in ("samples.csv", "passes.csv", "frames.csv", "report.md", "run.json"):
        assert (elsewhere / "out" / name).stat().st_size > 0
    assert "camera" in (elsewhere / "out" / "passes.csv").read_text()
    assert str(ROOT) not in (elsewhere / "out" / "run.json").read_text()


def test_whatever_is_imported_is_required() -> None:
    """By gibench itself, or by one of its extras; the tests' packages do not hide a missing one."""
    required = {
        re.split(r"[\s;<>=\[]", one)[0].lower().replace("-", "_")
        for one in requires("gibench") or []
        if "extra ==" not in one
        or re.search(r"extra == ['\"](exr|truth|project|history|cluster)['\"]", one)
    }
    imported = {
        name.partition(".")[0]
        for path in (ROOT / "gibench").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        for name in names_of(node)
    } - {*sys.stdlib_module_names, "gibench", "pytest"}  # the plug-in, which pytest itself loads
    known = packages_distributions()
    assert len(imported) > 10
    for name in sorted(imported):
        of = {one.lower().replace("-", "_") for one in known.get(name, [name])}
        assert of & required, f"{name} is imported, but none of {of} is required"


def names_of(node: ast.AST) -> list[str]:
    """What a statement imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.level == 0:
        return [node.module or ""]
    return []
