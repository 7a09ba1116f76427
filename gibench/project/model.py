"""How long a launch takes on a machine: the longest of its parts at every point of the unknowns.

Parts: DRAM, L2, lines of L1, instructions issued, local memory, atomics on one address, and
latency: what the waves that a device holds at once wait for (Little's law). A roofline (Williams,
Waterman and Patterson 2009) with caches and occupancy. Nothing in it was fitted to any kernel's
times.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Doubles
from gibench.profiles import Machine
from gibench.project.caches import SECTOR, CacheSizes, Traffic, simulate
from gibench.project.unknowns import Points, kernel_points, machine_points
from gibench.trace import waves
from gibench.trace.streams import WaveStreams

LATENCY, LAUNCH = "latency", "launch cost"
PARTS = ("DRAM", "L2", "L1", "instructions", "local memory", "atomics", LATENCY)
_RESIDENT = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
"""Numbers of groups on a unit that caches are simulated for."""
_LOCAL_CLOCK_BYTES = waves.BANKS * waves.WORD


@dataclass(frozen=True)
class Times:
    """Times of a launch at every point (p,), ms.

    Attributes:
        total: without the launch cost.
        launch: its launch cost.
        parts: of each of ``PARTS``.
        places: of the unknowns, by name; those of the kernel's own behind its label.
        bound_by: the longest part at the nominal point.
        resident: groups on a unit at the nominal point.
        unseen: what the model does not see of this launch; empty where it sees what matters.
    """

    total: Doubles
    launch: Doubles
    parts: Mapping[str, Doubles]
    places: Mapping[str, Doubles]
    bound_by: str
    resident: int
    unseen: str = ""


def launch_times(streams: WaveStreams, machine: Machine) -> Times:
    """Times of a launch on a machine.

    Args:
        streams: of its traced groups, at the SIMD width of the machine's profile.
        machine: what it is projected on.
    """
    at = machine_points(machine)
    own = kernel_points(streams.label, _identity(streams))
    resident = _resident(streams, at, own)
    used = streams.total_groups / np.ceil(streams.total_groups / at.figures["units"])
    asked = _asked(streams, machine, at, resident)
    clock = at.figures["clock_mhz"] * 1e3  # clocks a millisecond
    parts = _throughput(streams, at, own, asked, used * clock, clock)
    parts[LATENCY] = _latency(streams, at, own, asked, used * resident * streams.waves, clock)
    table = np.stack([parts[name] for name in PARTS])
    longest = table.argmax(axis=0)
    is_latency = longest == PARTS.index(LATENCY)
    error = np.where(is_latency, own.figures["latency"], own.figures["throughput"])
    sampling = np.exp(own.figures["sampling"] * asked.error)
    places = {**at.places, **{f"{streams.label}: {n}": p for n, p in own.places.items()}}
    return Times(
        total=table.max(axis=0) * error * own.figures["own"] * sampling,
        launch=at.figures["launch_us"] * 1e-3,
        parts=parts,
        places=places,
        bound_by=PARTS[int(longest[0])],
        resident=int(resident[0]),
        unseen=_unseen(streams),
    )


def _unseen(streams: WaveStreams) -> str:
    own = int(streams.waits[:, waves.SPILLED].sum())
    if own <= int(streams.requests.sum()):
        return ""
    return "most of its accesses are to arrays of its own, which registers may or may not hold"


def _identity(streams: WaveStreams) -> str:
    told = (streams.total_groups, streams.items, streams.local_bytes, int(streams.sectors.sum()))
    instructions = int(streams.waits[:, waves.ISSUED].sum())
    return hashlib.sha256(repr((told, instructions)).encode()).hexdigest()


def _resident(streams: WaveStreams, at: Points, own: Points) -> Doubles:
    """Groups that a unit holds at once (p,)."""
    value = at.figures
    found = np.minimum(np.floor(value["waves"] / streams.waves), value["groups"])
    lanes = streams.waves * streams.simd
    by_registers = value["register_bytes"] / (4 * own.figures["registers"] * lanes)
    found = np.minimum(found, np.floor(by_registers))
    if streams.local_bytes:
        found = np.minimum(found, np.floor(value["local_bytes"] / streams.local_bytes))
    return np.maximum(found, 1.0)


@dataclass(frozen=True)
class _Asked:
    """Relative error of sampling; what the launch asks of each level at every point (p,)."""

    error: float
    lines: Doubles
    l2_bytes: Doubles
    dram_bytes: Doubles
    first_bytes: Doubles
    footprint: Doubles
    share_l1: Doubles
    share_l2: Doubles
    share_dram: Doubles


def _asked(streams: WaveStreams, machine: Machine, at: Points, resident: Doubles) -> _Asked:
    runs = [streams.run_of(int(run)) for run in np.unique(streams.run)]
    grown = [_Growth.of(run, int(machine.sector_bytes.nominal)) for run in runs]
    units = int(machine.units.nominal)
    keys = list(
        zip(
            *(at.figures[n].astype(int) for n in ("l1_bytes", "l2_bytes", "line_bytes")),
            at.figures["sector_bytes"].astype(int),
            (max(r for r in _RESIDENT if r <= n) for n in resident),
            strict=True,
        )
    )
    known = {key: _whole_launch(streams, runs, grown, units, key) for key in dict.fromkeys(keys)}
    table = np.array([known[key][0] for key in keys]).T
    sampled = len(streams.run) < streams.total_groups
    return _Asked(known[keys[0]][1] if sampled else 0.0, *table)


@dataclass(frozen=True)
class _Growth:
    """How what a run of groups touches grows with their number.

    Attributes:
        touched: bytes of every buffer (b,).
        power: of the number of groups, by buffer (b,): 1 where each touches its own, 0 where all
            touch the same.
        together: the same of all buffers.
    """

    touched: Doubles
    power: Doubles
    together: float

    @staticmethod
    def of(run: WaveStreams, sector_bytes: int) -> _Growth:
        """The growth within a run, by its first half."""
        groups = len(run.run)
        half = max(1, groups // 2)
        per = sector_bytes // SECTOR
        whole = _touched(run, int(run.ends[-1]), per)
        first = _touched(run, int(run.ends[half - 1]), per)
        if groups == 1:
            return _Growth(whole, np.ones(len(whole)), 1.0)
        steps = np.log(groups / half)
        power = np.log(np.maximum(whole, 1) / np.maximum(first, 1)) / steps
        together = np.log(max(whole.sum(), 1) / max(first.sum(), 1)) / steps
        return _Growth(whole, np.clip(power, 0, 1), float(np.clip(together, 0, 1)))

    def factor(self, run: WaveStreams) -> Doubles:
        """What the whole launch touches of every buffer over what the run does (b,)."""
        grown = (run.total_groups / len(run.run)) ** self.power
        room = run.buffer_sectors * SECTOR / np.maximum(self.touched, 1)
        return np.maximum(np.minimum(grown, room), 1.0)


def _touched(run: WaveStreams, words: int, per: int) -> Doubles:
    sectors = np.unique((run.words[:words] >> 3) // per) * per + per - 1
    of = np.searchsorted(run.buffer_start, sectors, "right") - 1
    found = np.bincount(np.maximum(of, 0), minlength=max(1, len(run.buffer_start)))
    return found.astype(np.float64) * per * SECTOR * run.kept


def _whole_launch(
    streams: WaveStreams,
    runs: list[WaveStreams],
    grown: list[_Growth],
    units: int,
    key: tuple[int, ...],
) -> tuple[Doubles, float]:
    """What the launch asks behind caches of one kind, scaled from its runs, and how far they
    differ.
    """
    l1, l2, line, sector, resident = key
    rows, weights = [], []
    for run, growth in zip(runs, grown, strict=True):
        groups = len(run.run)
        held = min(resident, groups)
        simulated = max(1, min(units, groups // held))
        at_once = min(streams.total_groups, units * resident)
        share = (min(groups, simulated * held) / max(at_once, 1)) ** growth.together
        sizes = CacheSizes(simulated, held, l1, max(line * 16, int(l2 * min(share, 1.0))), line,
                           max(sector, SECTOR))  # fmt: skip
        found = simulate(run, sizes)
        rows.append(_scaled(run, growth, found))
        weights.append(groups)
    table = np.array(rows)
    mean = np.average(table, axis=0, weights=weights)
    if len(rows) < 2:
        return mean, 0.0
    spread = table[:, :3].std(axis=0, ddof=1) / np.maximum(table[:, :3].mean(axis=0), 1e-30)
    work = np.array([run.waits[:, waves.ISSUED].mean() for run in runs])
    spread = max(float(spread.max()), float(work.std(ddof=1) / max(work.mean(), 1e-30)))
    return mean, min(spread / np.sqrt(len(rows)), 0.5)


def _scaled(run: WaveStreams, growth: _Growth, found: Traffic) -> list[float]:
    scale = run.total_groups / len(run.run)
    factor = growth.factor(run)
    first = float((found.first_bytes * factor).sum())
    # Of first touches of the sample, those that are the launch's first touches too.
    rarer = min(1.0, first / max(float(found.first_bytes.sum()) * scale, 1e-30))
    hit_l1, hit_l2, missed, missed_first = found.load_share
    again = (found.again_bytes + found.written_bytes) * scale
    return [
        found.lines * scale,
        found.l2_bytes * scale,
        again,
        first,
        float((growth.touched * factor).sum()),
        hit_l1,
        hit_l2 + missed_first * (1 - rarer),
        missed - missed_first * (1 - rarer),
    ]


def _throughput(
    streams: WaveStreams, at: Points, own: Points, asked: _Asked, unit_clocks: Doubles,
    clock: Doubles,
) -> dict[str, Doubles]:  # fmt: skip
    value, scale = at.figures, streams.total_groups / len(streams.run)
    fits = asked.footprint < value["l2_bytes"] / 2
    cold = 1 - own.figures["warm"] * fits
    dram = asked.dram_bytes + asked.first_bytes * cold
    sector_bytes = float(streams.sectors.sum()) * scale * SECTOR
    issued = float(streams.waits[:, waves.ISSUED].sum()) * scale * own.figures["instructions"]
    local = float(streams.local_cycles.sum()) * scale * _LOCAL_CLOCK_BYTES
    return {
        "DRAM": dram / (value["dram_gb_per_s"] * value["dram_share"] * 1e6),
        "L2": asked.l2_bytes / (value["l2_bytes_per_clock"] * clock),
        "L1": np.maximum(asked.lines, sector_bytes / value["l1_bytes_per_clock"]) / unit_clocks,
        "instructions": issued * streams.simd / value["lanes"] / unit_clocks,
        "local memory": local / value["local_bytes_per_clock"] / unit_clocks,
        "atomics": streams.atomics_on_one / clock,
    }


def _latency(
    streams: WaveStreams, at: Points, own: Points, asked: _Asked, slots: Doubles, clock: Doubles
) -> Doubles:
    """What waves wait for, of which ``slots`` wait at once; at least the longest wave's own."""
    value, unknown = at.figures, own.figures
    memory = (
        asked.share_l1 * value["l1_latency_clocks"] + asked.share_l2 * value["l2_latency_clocks"]
    ) / clock + asked.share_dram * value["dram_latency_ns"] * 1e-6
    local = value["local_latency_clocks"] / clock
    issue = np.maximum(value["alu_latency_clocks"] / unknown["together"], 1.0)
    issue = np.maximum(issue, streams.simd / value["lanes"]) * unknown["instructions"] / clock

    def waiting(row: Doubles) -> Doubles:
        in_a_row = row[waves.IN_A_ROW]
        loads = in_a_row + unknown["unroll"] * np.maximum(row[waves.BATCHES] - in_a_row, 0)
        others = unknown["unroll"] * row[waves.LOCAL_BATCHES]
        return np.asarray(loads * memory + others * local + row[waves.ISSUED] * issue)

    waits = streams.waits.astype(np.float64)
    longest = waits[np.lexsort((waits[:, waves.ISSUED], waits[:, waves.BATCHES]))[-1]]
    rounds = streams.total_groups * streams.waves / slots
    return np.maximum(waiting(longest), waiting(waits.mean(axis=0)) * rounds)
