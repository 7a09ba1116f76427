"""What a cluster costs: worker processes of this machine against computing here, and what the same
units would take on 64 and 1024 workers.

    python tests/benchmarks/cluster_overhead.py measure --out overhead.json
    python tests/benchmarks/cluster_overhead.py simulate overhead.json --plot schedule.png

``measure`` bakes SRP (its units are chunks of probes and receivers) and traces a truth, serially in
one worker process (which has the executor's cost and no neighbour) and in 2, 4 and 8; on two cores
the latter show overhead alone. It writes the seconds of every unit, and bytes sent and returned.

``simulate`` gives these units to so many workers, longest last as they come, with a scheduler that
takes its time for every unit and a network of so many bytes a second, and says which of the three
(the longest unit of a stage, the scheduler, the bytes) keeps it from being quicker.
"""

from __future__ import annotations

import argparse
import heapq
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

NETWORK_BYTES_PER_S = 1.0e9 / 8
"""Of a gigabit Ethernet, the least that a cluster has."""


@dataclass
class Stage:
    """One run of the executor: its units need all of the stage before.

    Attributes:
        name: what was computed.
        seconds: that each unit took its worker, in order.
        sent: bytes that all units need, once a worker.
        unit_bytes: sent and returned per unit.
    """

    name: str
    seconds: list[float] = field(default_factory=list)
    sent: int = 0
    unit_bytes: float = 0.0


class Recording:
    """An executor that notes what each run of another takes."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner
        self.stages: list[Stage] = []

    def run(self, compute: Any, common: Any, units: Any, done: Any = lambda u, r: None) -> Any:
        """As that of the other."""
        tally = self.inner.tally
        stage = Stage(getattr(common, "stage", common).__class__.__name__)
        stage.name = getattr(getattr(common, "stage", None), "name", stage.name)
        before = asdict(tally)
        last = [tally.worker_seconds]

        def take(unit: Any, result: Any) -> None:
            stage.seconds.append(tally.worker_seconds - last[0])
            last[0] = tally.worker_seconds
            done(unit, result)

        found = self.inner.run(compute, common, units, take)
        after = asdict(tally)
        stage.sent = after["sent"] - before["sent"]
        stage.unit_bytes = (after["back"] - before["back"]) / max(1, len(stage.seconds))
        self.stages.append(stage)
        return found


def work(executor: Any, folder: Path, scale: float) -> None:
    """A bake and a truth."""
    from support import srp_setups

    from gibench.bake.lightmap import cached_lightmap
    from gibench.reference.path_tracer import reference_irradiance
    from gibench.scene.load import load_scene

    rays = max(64, int(4096 * scale))
    srp_setups.bake(
        folder, executor=executor, chunk_rays=4000, transport_rays=rays, relight_samples=rays
    )
    scene = load_scene("cornell-box")
    lightmap = cached_lightmap(scene, 4000, folder)
    paths = max(64, int(8192 * scale))
    reference_irradiance(scene, lightmap, paths=paths, seed=5, executor=executor)


def measure(out: Path, counts: Sequence[int], scale: float, repeats: int) -> None:
    """Time :func:`work` serially and on worker processes, in turns, and keep what units took."""
    from gibench.measure.machine.facts import facts_here
    from gibench.work import Serial
    from gibench.work.open_cluster import open_cluster

    seconds: dict[str, list[float]] = {}
    told: dict[str, Any] = {}
    stages: list[Stage] = []

    class Apart:
        """Not Serial by type: truths are traced in tiles."""

        def run(self, compute: Any, common: Any, units: Any, done: Any = lambda u, r: None) -> Any:
            return Serial().run(compute, common, units, done)

    for turn in range(repeats):
        for count in (0, *counts):
            with tempfile.TemporaryDirectory() as name:
                if count == 0:
                    work(Apart(), Path(name) / "warm", 0.02)
                    begin = time.perf_counter()
                    work(Apart(), Path(name) / "cold", scale)
                    seconds.setdefault("serial", []).append(time.perf_counter() - begin)
                    continue
                with open_cluster(facts_here, workers=count) as dask:
                    for warm in range(2):  # every worker has built its kernels
                        work(dask, Path(name) / f"warm-{warm}", 0.02)
                    recording = Recording(dask)
                    begin = time.perf_counter()
                    work(recording, Path(name) / "cold", scale)
                    seconds.setdefault(str(count), []).append(time.perf_counter() - begin)
                    if count == counts[0] and turn == 0:
                        stages = recording.stages
                    told[str(count)] = {
                        "units": sum(len(stage.seconds) for stage in recording.stages),
                        "sent": sum(stage.sent for stage in recording.stages),
                        "back": sum(
                            stage.unit_bytes * len(stage.seconds) for stage in recording.stages
                        ),
                    }
    content = {"seconds": seconds, "told": told, "stages": [asdict(stage) for stage in stages]}
    content["per_unit_ms"] = per_unit()
    out.write_text(json.dumps(content, indent=1))
    serial = min(seconds["serial"])
    print("| workers | s (best) | over serial | units | sent MB | back MB |")
    print("|---:|---:|---:|---:|---:|---:|")
    print(f"| serial | {serial:.2f} | | | | |")
    for count in counts:
        best, one = min(seconds[str(count)]), told[str(count)]
        print(
            f"| {count} | {best:.2f} | {best / serial - 1:+.1%} | {one['units']} | "
            f"{one['sent'] / 1e6:.2f} | {one['back'] / 1e6:.2f} |"
        )
    print(f"an empty unit costs {content['per_unit_ms']:.2f} ms of parent and scheduler")


@dataclass(frozen=True)
class Nothing:
    """A unit that takes no time."""

    number: int
    name: str = "nothing"


def nothing(common: None, unit: Nothing, worker: Any) -> int:
    """Nothing."""
    return unit.number


def per_unit(count: int = 1000) -> float:
    """Milliseconds of parent and scheduler per unit, from units that take none."""
    from gibench.measure.machine.facts import facts_here
    from gibench.work.open_cluster import open_cluster

    with open_cluster(facts_here, workers=2) as dask:
        dask.run(nothing, None, [Nothing(n) for n in range(50)])
        begin = time.perf_counter()
        dask.run(nothing, None, [Nothing(n) for n in range(count)])
        return 1e3 * (time.perf_counter() - begin) / count


@dataclass(frozen=True)
class Scheduled:
    """A simulated run.

    Attributes:
        seconds: in all.
        bars: stage, worker, begin and end of every unit.
        bound: by what each stage was held up, its seconds.
    """

    seconds: float
    bars: list[tuple[int, int, float, float]]
    bound: list[tuple[str, str, float]]


def schedule(stages: Sequence[Stage], workers: int, per_unit_s: float, rate: float) -> Scheduled:
    """Units to whoever is free, in their order, no sooner than the scheduler and the one network
    link of the parent have handed them out; common data goes from worker to worker, doubling.
    """
    now = 0.0
    bars, bound = [], []
    for number, stage in enumerate(stages):
        begin = now
        rounds = max(1, (workers - 1).bit_length())
        ready = begin + stage.sent / rate * rounds
        free = [(ready, worker) for worker in range(workers)]
        heapq.heapify(free)
        handed = ready
        end = ready
        back = stage.unit_bytes / rate
        for seconds in stage.seconds:
            handed += max(per_unit_s, back)
            at, worker = heapq.heappop(free)
            start = max(at, handed)
            heapq.heappush(free, (start + seconds, worker))
            bars.append((number, worker, start, start + seconds))
            end = max(end, start + seconds)
        now = end
        count = len(stage.seconds)
        least = {
            "the longest unit": max(stage.seconds, default=0.0),
            "the scheduler": count * per_unit_s,
            "bytes": stage.sent / rate * rounds + count * back,
            "the work itself": sum(stage.seconds) / workers,
        }
        bound.append((stage.name, max(least, key=lambda name: least[name]), now - begin))
    return Scheduled(now, bars, bound)


def simulate(file: Path, plot: Path | None, copies: int, counts: Sequence[int]) -> None:
    """Tell what so many workers would give; ``copies`` of each unit stand for a larger job."""
    content = json.loads(file.read_text())
    stages = [Stage(**one) for one in content["stages"]]
    for stage in stages:
        stage.seconds = stage.seconds * copies
    per_unit_s = content["per_unit_ms"] / 1e3
    alone = sum(sum(stage.seconds) for stage in stages)
    units = sum(len(stage.seconds) for stage in stages)
    print(f"{units} units, {alone:.1f} s of work, {per_unit_s * 1e3:.2f} ms each to hand out\n")
    print("| workers | s | times faster | efficiency | bound by (share of the time) |")
    print("|---:|---:|---:|---:|---|")
    results = {}
    for count in counts:
        found = results[count] = schedule(stages, count, per_unit_s, NETWORK_BYTES_PER_S)
        shares: dict[str, float] = {}
        for _, what, seconds in found.bound:
            shares[what] = shares.get(what, 0.0) + seconds / found.seconds
        said = ", ".join(
            f"{what} {share:.0%}" for what, share in sorted(shares.items(), key=lambda s: -s[1])
        )
        faster = alone / found.seconds
        print(f"| {count} | {found.seconds:.2f} | {faster:.1f} | {faster / count:.0%} | {said} |")
    if plot is not None:
        draw(stages, results[counts[-2] if len(counts) > 1 else counts[0]], plot, copies)


def draw(stages: Sequence[Stage], found: Scheduled, path: Path, copies: int) -> None:
    """The schedule: a row a worker, a colour a stage."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Patch, Rectangle

    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    colours = plt.get_cmap("tab10")
    for number in range(len(stages)):
        bars = [Rectangle((b, w), e - b, 0.9) for stage, w, b, e in found.bars if stage == number]
        axes.add_collection(PatchCollection(bars, facecolor=colours(number % 10), linewidth=0))
    workers = 1 + max(worker for _, worker, _, _ in found.bars)
    axes.set(xlim=(0, found.seconds), ylim=(0, workers), xlabel="s", ylabel="worker")
    axes.set_title(
        f"Simulated: {len(found.bars)} units ({copies} times those measured) on {workers} workers"
    )
    handles = [Patch(color=colours(n % 10), label=stage.name) for n, stage in enumerate(stages)]
    axes.legend(handles=handles, loc="upper right", fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    sub = parser.add_subparsers(dest="what", required=True)
    one = sub.add_parser("measure")
    one.add_argument("--out", type=Path, default=Path("overhead.json"))
    one.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4, 8])
    one.add_argument("--scale", type=float, default=1.0)
    one.add_argument("--repeats", type=int, default=3)
    two = sub.add_parser("simulate")
    two.add_argument("file", type=Path)
    two.add_argument("--plot", type=Path)
    two.add_argument("--copies", type=int, default=100)
    two.add_argument("--workers", type=int, nargs="+", default=[1, 8, 64, 1024])
    asked = parser.parse_args()
    if asked.what == "measure":
        measure(asked.out, asked.workers, asked.scale, asked.repeats)
    else:
        simulate(asked.file, asked.plot, asked.copies, asked.workers)


if __name__ == "__main__":
    main()
