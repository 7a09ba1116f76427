"""The fixture for users' own kernels: device time through pytest-benchmark, read by compare."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gibench.cli.main import call
from gibench.pytest_plugin import DeviceClock

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


def record(folder: Path, turns: int) -> Path:
    folder.mkdir()
    (folder / "conftest.py").write_text('pytest_plugins = ["gibench.pytest_plugin"]\n')
    (folder / "test_mine.py").write_text(TEST % turns)
    # pytest-benchmark switches itself off in what looks like a worker of xdist.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
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


def test_users_kernels_are_timed_by_the_device_and_compared(tmp_path: Path, capsys) -> None:
    old, new = record(tmp_path / "old", 200), record(tmp_path / "new", 2000)
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
