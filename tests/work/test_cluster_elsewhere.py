"""A scheduler and workers started as on a real cluster: who times, and a scheduler that goes."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support import srp_setups

import gibench
from gibench.bake.run import BakeReport
from gibench.commands.cluster import cluster
from gibench.errors import CannotRun, GibenchError
from gibench.measure.machine.facts import facts_here
from gibench.work import Serial
from gibench.work.open_cluster import open_cluster

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
pytestmark = pytest.mark.slow


@contextmanager
def started(folder: Path, *workers: list[str]):
    """A scheduler's file and its process, with workers of these options."""
    file = folder / "scheduler.json"
    run = [sys.executable, "-m", "dask"]
    here = ["--host", "127.0.0.1", "--no-dashboard"]
    processes = [
        subprocess.Popen(
            [*run, "scheduler", "--port", "0", "--scheduler-file", str(file), *here],
            stderr=subprocess.DEVNULL,
        )
    ]
    try:
        while not file.exists():
            time.sleep(0.1)
        for options in workers:
            place = ["--local-directory", str(folder / f"worker-{len(processes)}")]
            processes.append(
                subprocess.Popen(
                    [*run, "worker", "--scheduler-file", str(file), *here, *place, *options],
                    stderr=subprocess.DEVNULL,
                )
            )
        yield file, processes[0]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def wait_for(executor, threads: int) -> None:
    for _ in range(300):
        executor.look()
        if executor._threads >= threads:
            return
        time.sleep(0.2)
    raise AssertionError("no workers came")


ALONE = ["--nthreads", "1", "--resources", "exclusive=1"]
PLAIN = ["--nthreads", "2"]


def test_times_are_taken_where_a_worker_is_alone(tmp_path, monkeypatch):
    asked = {"technique": "direct", "receivers": 200, "frames": 2, "budget_ms": 1e6}
    asked |= {"resolution": (32, 24), "target_error": 1.0, "reference_paths": 16}
    asked |= {"variant": ("tuned", "published"), "cache_dir": tmp_path / "cache"}
    here = gibench.advise(out=tmp_path / "here", **asked)
    with (
        started(tmp_path, PLAIN) as (file, _),
        open_cluster(facts_here, scheduler_file=file) as executor,
    ):
        wait_for(executor, 2)
        with pytest.raises(CannotRun, match="declare themselves exclusive, and none does"):
            gibench.advise(out=tmp_path / "none", executor=executor, **asked)
    (tmp_path / "scheduler.json").unlink()
    with started(tmp_path, ALONE) as (file, _), cluster(scheduler_file=file) as executor:
        wait_for(executor, 1)
        # As on a machine that does not see this one's folders.
        monkeypatch.setattr(executor, "shares", lambda folder: False)
        there = gibench.advise(out=tmp_path / "there", executor=executor, **asked)
        assert "PoCL" in executor.timed_on or "Portable" in executor.timed_on
        # A worker of another kind of machine.
        executor.timed_on = "another machine"
        with pytest.raises(CannotRun, match="not compared"):
            gibench.advise(out=tmp_path / "other", executor=executor, **asked)
    drop = ["time_ms", "ms_to_rest", "pareto"]
    pd.testing.assert_frame_equal(
        *(one.table.drop(columns=drop).sort_values("variant", ignore_index=True)
          for one in (here, there))
    )  # fmt: skip
    assert (there.table["time_ms"] > 0).all()
    (tmp_path / "scheduler.json").unlink()
    with (
        started(tmp_path, ALONE, PLAIN) as (file, _),
        open_cluster(facts_here, scheduler_file=file) as executor,
        pytest.raises(CannotRun, match="1 other workers on its machine"),
    ):
        wait_for(executor, 3)


def test_what_is_no_timing_goes_to_any_worker(tmp_path):
    asked = {"quick": True, "target_error": 1.0, "reference_paths": 16}
    here = gibench.experiment(
        name="sh-order", out=tmp_path / "here", cache_dir=tmp_path / "a", **asked
    )
    with started(tmp_path, PLAIN) as (file, _), cluster(scheduler_file=file) as executor:
        wait_for(executor, 2)
        there = gibench.experiment(
            name="sh-order", out=tmp_path / "there", cache_dir=tmp_path / "b", executor=executor,
            **asked,
        )  # fmt: skip
    assert there.table["time_ms"].isna().all()
    both = (one.table.drop(columns="time_ms") for one in (here, there))
    pd.testing.assert_frame_equal(*both)
    for name in ("here", "there"):
        assert (tmp_path / name / "sh-order.md").exists()
    for file in (tmp_path / "here" / "irradiance").glob("*.npy"):
        assert np.array_equal(np.load(file), np.load(tmp_path / "there" / "irradiance" / file.name))


def test_a_scheduler_that_goes_is_one_line_and_a_rerun_goes_on(tmp_path):
    baked = tmp_path / "bake"
    more = {"chunk_rays": 200, "transport_rays": 256}
    with started(tmp_path, PLAIN) as (file, scheduler):

        def stop() -> None:
            while len(list(baked.rglob("*.bin"))) < 6:
                time.sleep(0.01)
            scheduler.kill()

        watching = threading.Thread(target=stop)
        watching.start()
        begin = time.monotonic()
        with open_cluster(facts_here, scheduler_file=file) as executor:
            wait_for(executor, 2)
            with pytest.raises(GibenchError, match="scheduler is gone") as caught:
                srp_setups.bake(baked, executor=executor, **more)
            assert "\n" not in str(caught.value)
        watching.join()
        assert time.monotonic() - begin < 120
    kept = len(list(baked.rglob("*.bin")))
    assert kept >= 6
    report = BakeReport()
    srp_setups.bake(baked, report, executor=Serial(), **more)
    assert sum(stage.loaded for stage in report.stages.values()) >= kept - 1
    srp_setups.bake(tmp_path / "whole", executor=Serial(), **more)
    files = [
        {p.name: p.read_bytes() for p in f.rglob("*.bin")} for f in (baked, tmp_path / "whole")
    ]
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("technique", "settings"),
    [
        ("srp", {"srp.transport_rays": 16, "srp.relight_samples": 16}),
        ("irradiance-probes", {}),
        ("light-field-probes", {}),
        ("surfel-cache", {"surfel-cache.surfels": 256, "surfel-cache.links": 16}),
    ],
)
def test_every_bake_has_the_same_bytes(tmp_path, technique, settings):
    asked = {"technique": [technique], "receivers": 300, "settings": settings}
    with cluster(workers=2) as executor:
        for name, by in (("serial", Serial()), ("cluster", executor)):
            list(gibench.bake_ahead(cache_dir=tmp_path / name, executor=by, **asked))
    found = [
        {str(p.relative_to(tmp_path / name)): p.read_bytes()
         for p in (tmp_path / name).rglob("*.bin")}
        for name in ("serial", "cluster")
    ]  # fmt: skip
    assert found[0] and found[0] == found[1]
