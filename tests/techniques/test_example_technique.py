"""The worked example of docs/adding-a-technique.md: its two folders are all that a technique takes.

They are copied into a copy of the package, in which nothing else is changed.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import RegularGridInterpolator
from support.oclgrind_runner import needs_oclgrind
from support.rays_oracle import closest_float64
from support.tiny_scenes import room

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "example_technique"
CACHES = shutil.ignore_patterns("__pycache__", "*.pyc")

# Run in the copy: what the example bakes and gives in a small room.
IN_A_ROOM = """
import sys
from pathlib import Path
import numpy as np
from gibench.device import Device
from gibench.measure.plan.view import choose_camera
from gibench.profiles import load_profile
from gibench.techniques.registry import BakeContext, find_technique
from support.made import check_memory, made
from support.tiny_scenes import room

spec, (scene, lightmap) = find_technique("example"), room(5)
settings = spec.settings({"reach": 0.7, "rays": 64, "counts": "3x2x4", "ambient": 0.2})
baked = spec.bake(BakeContext(scene, lightmap, settings, Path(sys.argv[1])))
technique = made(spec, Device(load_profile("iphone7")), scene, lightmap, settings, baked, "tuned",
                 64, 24, 16, choose_camera(scene, None))
check_memory(spec, technique, settings, "tuned", 64, len(lightmap.receivers))
np.savez(sys.argv[2], openness=baked, irradiance=technique.indirect_irradiance())
"""


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package with the example's two folders in it."""
    copy = tmp_path_factory.mktemp("tree")
    for name in ("gibench", "kernels_cl", "tests"):
        shutil.copytree(ROOT / name, copy / name, ignore=CACHES)
    for name in ("scenes", "results", "docs", "README.md", "ARCHITECTURE.md"):
        (copy / name).symlink_to(ROOT / name)
    shutil.copy(ROOT / "pyproject.toml", copy)
    own = sorted(path.relative_to(EXAMPLE) for path in EXAMPLE.rglob("*") if path.is_file())
    own = [path for path in own if path.suffix != ".pyc"]
    assert {path.parts[:-1] for path in own} == {
        ("gibench", "techniques", "example"),
        ("kernels_cl", "example"),
    }
    for path in own:
        assert not (copy / path).exists()
        (copy / path).parent.mkdir(exist_ok=True)
        shutil.copy(EXAMPLE / path, copy / path)
    return copy


def run(tree: Path, *command: str, timeout: float = 300) -> str:
    """What ``python command`` prints in the copy."""
    paths = os.pathsep.join((str(tree), str(tree / "tests")))
    ran = subprocess.run(
        [sys.executable, *command],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": paths, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout + ran.stderr


def test_a_setting_is_an_axis(tree: Path, tmp_path: Path) -> None:
    out, cache = tmp_path / "run", tmp_path / "cache"
    command = ["-m", "gibench", "run", "--no-quality", "-t", "example", "--set", "example.reach=1"]
    command += ["--set", "example.reach=2", "--scene", "cornell-box", "--receivers", "200"]
    command += ["--resolution", "32x24", "--frames", "3", "--warmup", "1", "-q"]
    run(tree, *command, "--cache-dir", str(cache), "--out", str(out))
    frames = pd.read_csv(out / "frames.csv")
    assert frames["technique"].tolist() == ["example"] * 2
    assert frames["reach"].tolist() == [1.0, 2.0]
    assert (frames["gi_ms"] > 0).all()
    passes = pd.read_csv(out / "passes.csv")
    assert set(passes["pass"]) == {"camera", "application"} and set(passes["reach"]) == {1.0, 2.0}
    # The distances do not depend on the reach: they were traced once.
    stored = [path.name.rsplit("-", 1)[0] for path in cache.rglob("example-*") if path.is_dir()]
    assert sorted(stored) == ["example-distances", "example-openness", "example-openness"]


def test_it_computes_what_numpy_does(tree: Path, tmp_path: Path) -> None:
    run(tree, "-c", IN_A_ROOM, str(tmp_path / "cache"), str(tmp_path / "found.npz"))
    found = np.load(tmp_path / "found.npz")
    scene, lightmap = room(5)
    low, high = scene.bounds
    axes = [low[k] + (np.arange(n) + 0.5) * (high[k] - low[k]) / n for k, n in enumerate((3, 2, 4))]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    probes = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    i = np.arange(64)
    up, turn = 1 - (2 * i + 1) / 64, 2 * np.pi * i * (np.sqrt(5) - 1) / 2
    flat = np.sqrt(1 - up**2)
    rays = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)
    _, distance, _, _ = closest_float64(
        scene.corners, np.repeat(probes, 64, axis=0), np.tile(rays, (len(probes), 1))
    )
    openness = (distance.reshape(-1, 64) > 0.7).mean(axis=1)
    assert 0.05 < openness.mean() < 0.95
    np.testing.assert_allclose(found["openness"], openness, atol=1.5 / 64)
    between = RegularGridInterpolator(axes, found["openness"].reshape(4, 2, 3).T.astype(float))
    position = lightmap.receivers.position.astype(float)
    inside = np.clip(position, [a[0] for a in axes], [a[-1] for a in axes])
    expected = np.pi * 0.2 * between(inside)
    np.testing.assert_allclose(
        found["irradiance"], np.repeat(expected[:, None], 3, axis=1), rtol=1e-5
    )


def test_its_kernels_have_oracles_that_they_pass(tree: Path) -> None:
    tests = "tests/conform/test_conform.py"
    name = f"{tests}::test_a_case_runs_the_kernels_that_it_names[The example's openness]"
    every = f"{tests}::test_every_kernel_has_an_oracle"
    told = run(tree, "-m", "pytest", "-q", "-p", "no:cacheprovider", name, every)
    assert "2 passed" in told


@pytest.mark.skipif(importlib.util.find_spec("importlinter") is None, reason="no import-linter")
def test_the_import_contracts_hold_without_a_line_for_it(tree: Path) -> None:
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"
    run(tree, "-c", code)
    other = tree / "gibench" / "techniques" / "example" / "borrowed.py"
    other.write_text("import gibench.techniques.ddgi.settings\n")
    try:
        with pytest.raises(AssertionError, match=r"example is not allowed to import .*ddgi"):
            run(tree, "-c", code)
    finally:
        other.unlink()


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="no mypy")
def test_its_types_hold(tree: Path) -> None:
    run(tree, "-m", "mypy")


@pytest.mark.slow
@pytest.mark.oclgrind
@needs_oclgrind
@pytest.mark.parametrize(
    ("file", "least"),
    [
        ("tests/device/test_oclgrind.py", 1),
        ("tests/device/test_declared_work.py", 1),
        ("tests/techniques/test_stages.py", 1),
    ],
)
def test_tests_of_every_technique_find_it(tree: Path, file: str, least: int) -> None:
    told = run(tree, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "example", file)
    assert int(told.split(" passed")[0].split()[-1]) >= least
