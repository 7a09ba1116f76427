"""The fixture for users' own kernels: device time through pytest-benchmark, read by compare."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from gibench.cli.main import call
from gibench.pytest_plugin import DeviceClock

ROOT = Path(__file__).parents[1]

TEST = """
import numpy as np
import pyopencl as cl

SOURCE = '''
kernel void twice(global float *a) {
    float x = a[get_global_id(0)];
    for (int i = 0; i < TURNS; ++i) x = x * 0.5f + 1.0f;
    a[get_global_id(0)] = x;
}
'''

def test_twice(device_benchmark):
    device = cl.get_platforms()[0].get_devices()[0]
    context = cl.Context([device])
    queue = cl.CommandQueue(
        context, properties=cl.command_queue_properties.PROFILING_ENABLE
    )
    kernel = cl.Kernel(cl.Program(context, SOURCE).build(["-DTURNS=%d"]), "twice")
    buffer = cl.Buffer(context, cl.mem_flags.READ_WRITE, 1 << 18)
    cl.enqueue_copy(queue, buffer, np.zeros(1 << 16, np.float32))
    device_benchmark(lambda: kernel(queue, (1 << 16,), (64,), buffer), rounds=20)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of the path that registers the plug-in as an installed gibench does."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    ((name, module),) = project["entry-points"]["pytest11"].items()
    assert name == module == "gibench.pytest_plugin"
    path = tmp_path_factory.mktemp("path")
    (folder := path / "registered-0.dist-info").mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: registered\nVersion: 0\n")
    (folder / "entry_points.txt").write_text(f"[pytest11]\n{name} = {module}\n")
    return path


def record(folder: Path, installed: Path, turns: int, conftest: str = "") -> Path:
    folder.mkdir()
    (folder / "conftest.py").write_text(conftest)
    (folder / "test_mine.py").write_text(TEST % turns)
    # pytest-benchmark switches itself off in what looks like a worker of xdist.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    path = [str(installed), str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(path)
    ran = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir=."),
            *("--benchmark-json", "out.json", "test_mine.py"),
        ],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return folder / "out.json"


def test_users_kernels_are_timed_by_the_device_and_compared(
    tmp_path: Path, installed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With nothing in conftest.py, and with the line that loads the plug-in a second time."""
    old = record(tmp_path / "old", installed, 200)
    twice = 'pytest_plugins = ["gibench.pytest_plugin"]\n'
    new = record(tmp_path / "new", installed, 2000, twice)
    (one,) = json.loads(old.read_text())["benchmarks"]
    assert len(one["stats"]["data"]) == 20
    assert 0 < one["stats"]["median"] < 0.1
    assert call(["compare", str(old), str(new)]) == 1
    assert "test_twice" in capsys.readouterr().err
    assert call(["compare", str(old), str(old)]) == 0


def test_the_clock_counts_events_only() -> None:
    class Event:
        def __init__(self, start: int, end: int) -> None:
            self.profile = type("Profile", (), {"start": start, "end": end})

        def wait(self) -> None:
            pass

    clock = DeviceClock()
    clock.run(lambda: Event(1000, 3000))
    clock.run(lambda: [Event(0, 500), None, Event(700, 1200)])
    clock.run(lambda: None)
    assert clock() == pytest.approx(3e-6)
