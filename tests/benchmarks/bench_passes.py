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

from gibench.device.selection import select_cl_device
from gibench.measure.plan.grid import grid
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.profiles import load_profile
from gibench.techniques.job import Shot
from gibench.techniques.registry import techniques

pytest_plugins = ["gibench.pytest_plugin"]

SMALL = {"srp": {"transport_rays": (256,), "relight_samples": (512,)}}
RECEIVERS, FRAMES_BEFORE = 4000, 20


@lru_cache(maxsize=1)
def ready(name: str, variant: str):
    """A technique some frames into its animation, and its prepared passes by name."""
    settings = {name: SMALL[name]} if name in SMALL else {}
    (job,) = grid(
        [load_profile("iphone7")],
        [techniques()[name]],
        receivers=(RECEIVERS,),
        variants=(variant,),
        settings=settings,
        shot=Shot(320, 180),
    )
    shared = Shared(Path(tempfile.gettempdir()) / "gibench-bench-cache", 0)
    session = Session.open(job, shared, select_cl_device(None))
    session.prepare()
    for frame in range(FRAMES_BEFORE):
        session.frame(frame)
    return session.technique, {item.name: item for item in session.prepared}


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
