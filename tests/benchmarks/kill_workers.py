"""Workers killed at random moments of a bake and of a truth: what is lost, and what comes twice.

    python tests/benchmarks/kill_workers.py --kills 50

Each time round, a bake of SRP and a path-traced truth are computed by two worker processes, one of
which is killed (SIGKILL) again and again; the bytes are held against those computed in this
process. Each unit must be taken exactly once.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from support import srp_setups

from gibench.bake.lightmap import cached_lightmap
from gibench.measure.machine.facts import facts_here
from gibench.reference.path_tracer import reference_irradiance
from gibench.scene.load import load_scene
from gibench.work import Serial
from gibench.work.cluster import Dask
from gibench.work.open_cluster import open_cluster


@dataclass
class Counting:
    """An executor that counts how often the result of each unit was taken."""

    dask: Dask
    taken: Counter[tuple[int, str]] = field(default_factory=Counter)
    asked: set[tuple[int, str]] = field(default_factory=set)
    runs: int = 0

    def run(self, compute: Any, common: Any, units: Any, done: Any = lambda u, r: None) -> Any:
        """As that of the cluster."""
        self.runs += 1
        number = self.runs

        def named() -> Any:
            for unit in units:
                self.asked.add((number, unit.name))
                yield unit

        def take(unit: Any, result: Any) -> None:
            self.taken[number, unit.name] += 1
            done(unit, result)

        return self.dask.run(compute, common, named(), take)


class Killer(threading.Thread):
    """Kills a random worker at a random moment after every few units, so that work goes on."""

    def __init__(self, counting: Counting, wanted: int, seed: int) -> None:
        super().__init__(daemon=True)
        self.counting, self.wanted = counting, wanted
        self.random = random.Random(seed)
        self.kills = 0

    def run(self) -> None:
        """Until so many are killed."""
        while self.kills < self.wanted:
            until = self.counting.taken.total() + self.random.randint(0, 2)
            while self.counting.taken.total() < until:
                time.sleep(0.02)
            time.sleep(self.random.uniform(0.0, 1.5))
            with suppress(Exception):
                found = self.counting.dask._client.run(os.getpid, on_error="return")
                pids = [pid for pid in found.values() if isinstance(pid, int)]
                if pids:
                    os.kill(self.random.choice(pids), signal.SIGKILL)
                    self.kills += 1


def bytes_of(folder: Path) -> dict[str, bytes]:
    """The stored units."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*.bin"))}


def main() -> int:
    """Tell the tally; 1 where anything differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", choices=("bake", "truth"))
    asked = parser.parse_args()
    changed = {"transport_rays": 128, "relight_samples": 256}
    scene = load_scene("cornell-box")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        srp_setups.bake(folder / "serial", executor=Serial(), chunk_rays=300, **changed)
        baked = bytes_of(folder / "serial")
        lightmap = cached_lightmap(scene, 500, folder)
        truth = reference_irradiance(scene, lightmap, paths=512, seed=5)

        def bake(executor: Any, number: int) -> bool:
            srp_setups.bake(folder / str(number), executor=executor, chunk_rays=300, **changed)
            return bytes_of(folder / str(number)) == baked

        def trace(executor: Any, number: int) -> bool:
            found = reference_irradiance(scene, lightmap, paths=512, seed=5, executor=executor)
            same = np.array_equal(found.value, truth.value) and found.rays == truth.rays
            return bool(same and np.array_equal(found.stderr, truth.stderr))

        bad = 0
        print("| what | kills | times computed | units | lost | twice | same bytes |")
        print("|---|---:|---:|---:|---:|---:|---|")
        for what, compute in (("bake", bake), ("truth", trace)):
            if asked.only in (None, what):
                bad += not tally(what, compute, asked)
    return min(bad, 1)


def tally(what: str, compute: Callable[[Any, int], bool], asked: argparse.Namespace) -> bool:
    """Compute again and again until so many workers were killed; whether all was well."""
    with open_cluster(facts_here, workers=asked.workers) as dask:
        counting = Counting(dask)
        killer = Killer(counting, asked.kills, asked.seed)
        killer.start()
        times = same = 0
        while killer.kills < asked.kills:
            times += 1
            same += compute(counting, times)
            told = f"{what}: {times} times, {same} the same, {killer.kills} kills"
            print(told, file=sys.stderr, flush=True)
    lost = sum(unit not in counting.taken for unit in counting.asked)
    twice = sum(count > 1 for count in counting.taken.values())
    print(
        f"| {what} | {killer.kills} | {times} | {len(counting.asked)} | {lost} | {twice} | "
        f"{same} of {times} |",
        flush=True,
    )
    return lost == twice == 0 and same == times


if __name__ == "__main__":
    sys.exit(main())
