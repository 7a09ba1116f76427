"""Every pass of every technique through pytest-benchmark, by device time.

    pytest tests/benchmarks/bench_passes.py --benchmark-enable --benchmark-json passes.json

``gibench compare old.json new.json`` holds two such files against each other. The scene is small
(a few minutes for all); for figures to quote use ``gibench run``.
"""

from __future__ import annotations

import tempfile
from functools import lru_cache
from itertools import count
from pathlib import Path

from gibench.device.device import select_cl_device
from gibench.measure.plan.configuration import Request, grid
from gibench.measure.runfolder.results import ConfigurationResult
from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
from gibench.measure.session.setup import LoopOptions, set_up
from gibench.measure.session.shared import Shared
from gibench.profiles import load_profile
from gibench.techniques.registry import techniques

pytest_plugins = ["gibench.pytest_plugin"]

SMALL = {"srp": {"transport_rays": "256", "relight_samples": "512"}}
RECEIVERS, FRAMES_BEFORE = 4000, 20


@lru_cache(maxsize=1)
def ready(name: str, variant: str):
    """A technique some frames into its animation, and its prepared passes by name."""
    settings = {name: SMALL[name]} if name in SMALL else {}
    asked = Request(receivers=(RECEIVERS,), variants=(variant,), settings=settings)
    (configuration,) = grid([load_profile("iphone7")], [techniques()[name]], asked)
    shared = Shared(Path(tempfile.gettempdir()) / "gibench-bench-cache", 0)
    result = ConfigurationResult(configuration, "cornell-box")
    options = LoopOptions(width=320, height=180)
    _, technique = set_up(result, options, shared, select_cl_device(None))
    prepared = prepare_passes(technique, configuration.workgroup_size)
    for frame in range(FRAMES_BEFORE):
        enqueue_frame(technique, prepared, frame)
    return technique, {item.name: item for item in prepared}


def pytest_generate_tests(metafunc):
    """One test per technique, variant and pass; passes are known once a technique is set up."""
    cases = []
    if metafunc.config.getoption("benchmark_enable"):
        for spec in techniques().values():
            for variant in spec.variants:
                cases += [(spec.name, variant, item) for item in ready(spec.name, variant)[1]]
    metafunc.parametrize(
        ("technique", "variant", "name"), cases, ids=["-".join(case) for case in cases]
    )


def test_pass(device_benchmark, technique, variant, name):
    made, passes = ready(technique, variant)
    item = passes[name]
    assert item.problem is None, item.problem
    device_benchmark.benchmark.group = f"{technique} ({variant})"
    queue, frames = made.device.queue, count(FRAMES_BEFORE)

    def frame():
        """A whole frame, for passes change what others read; the events of the one pass."""
        made.begin_frame(next(frames))
        events = {p.name: [one.enqueue(queue) for one in p.launches] for p in passes.values()}
        queue.finish()
        return events[name]

    device_benchmark(frame)
