"""Measuring a device's machine part on the device itself, so that its projected ranges narrow.

Only microbenchmarks are run, none of gibench's techniques: what is projected is never fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.device import Device, Launch, ProgramSpec, reads, scalar, unsigned, writes
from gibench.errors import BadInput
from gibench.measure.machine.roofs import measure_roofs
from gibench.profiles import DeviceProfile, Interval, Machine

REPEATS = 7
"""Times each figure is measured; the lowest, the median and the highest are kept."""

_CHASE_STEPS = 200_000
_CHAIN_TURNS = 100_000
_CHAIN = 8  # multiply-adds a turn, as in calibrate.cl
# A table for DRAM's latency is so many times the last cache: an eighth of it is still found there.
_BEYOND = 8
_LARGEST_TABLE = 1 << 29

_CHASE = ProgramSpec("measure/calibrate.cl", {})


def calibrate(
    profile: DeviceProfile, cl_device: Any = None, tell: Callable[[str], None] = lambda _: None
) -> dict[str, Interval]:
    """Measure what microbenchmarks can tell of a profile's machine part, in about a minute.

    Bandwidth by STREAM's triad and a streaming read (McCalpin 1995), the clock by independent
    multiply-adds where the profile knows units and lanes exactly, latencies by chasing pointers
    (Saavedra and Smith 1995), the latency of arithmetic by a chain of multiply-adds, and what an
    empty launch costs.

    Args:
        profile: of the device; it has a machine part.
        cl_device: the device; by default the one that runs chose.
        tell: is given a line before each figure is measured.

    Returns:
        Intervals by the name of the figure: those that could be measured.

    Raises:
        BadInput: the profile has no machine part, or is not this device's.
        CannotRun: the device cannot hold the buffers.
    """
    machine = profile.machine
    if machine is None:
        raise BadInput(
            "has no machine part", where=profile.name, mend="calibrate narrows one: add [machine]"
        )
    device = Device.unlimited(cl_device)
    units = int(device.cl_device.max_compute_units)
    if not machine.units.low <= units <= machine.units.high:
        raise BadInput(
            f"the device has {units} compute units, the profile {machine.units.nominal:g}",
            where=profile.name,
            mend="give the profile of this device, or another device by --device",
        )
    source = f"gibench calibrate on this device: lowest, median and highest of {REPEATS}"
    tell("bandwidth, arithmetic and launches")
    roofs = [measure_roofs(profile, cl_device) for _ in range(REPEATS)]
    found = {"launch_us": _interval([each.launch_us for each in roofs], source)}
    rates = [rate for each in roofs for rate in (each.read_gb_per_s, each.triad_gb_per_s)]
    found |= _bandwidth(machine, rates, source)
    if machine.units.spread == machine.lanes.spread == 1:
        a_clock = 2 * machine.units.nominal * machine.lanes.nominal
        clocks = [each.fma_gflop_per_s * 1e3 / a_clock for each in roofs]
        found["clock_mhz"] = _interval(clocks, source)
    clock_ghz = found.get("clock_mhz", machine.clock_mhz).nominal * 1e-3
    tell("latency of arithmetic")
    chain = [clock_ghz * ns for ns in chain_ns(device)]
    found["alu_latency_clocks"] = _interval(chain, source)
    line = int(machine.line_bytes.high)
    for name, size in _tables(machine, int(device.cl_device.max_mem_alloc_size)).items():
        tell(f"latency of {size / 1024:,.0f} KiB")
        factor = 1.0 if name == "dram_latency_ns" else clock_ghz
        said = f"{source}; pointers chased through {size / 1024:,.0f} KiB"
        found[name] = _interval([factor * ns for ns in chase_ns(device, size, line)], said)
    return found


def calibrated(profile: DeviceProfile, found: dict[str, Interval]) -> DeviceProfile:
    """The profile with the measured figures in place of its own."""
    assert profile.machine is not None
    return replace(profile, machine=replace(profile.machine, **found))


def _interval(values: Sequence[float], source: str) -> Interval:
    return Interval(min(values), float(np.median(values)), max(values), source)


def _bandwidth(machine: Machine, rates: Sequence[float], source: str) -> dict[str, Interval]:
    """The share of the data rate that streams reach; the rate too where they reach more."""
    peak = machine.dram_gb_per_s
    if max(rates) <= peak.nominal:
        of_peak = Interval(peak.nominal, peak.nominal, peak.nominal, peak.source)
        shares = _interval([rate / peak.nominal for rate in rates], source)
        return {"dram_gb_per_s": of_peak, "dram_share": shares}
    reached = Interval(max(rates), max(rates), max(rates), source)
    return {
        "dram_gb_per_s": reached,
        "dram_share": _interval([rate / max(rates) for rate in rates], source),
    }


def _tables(machine: Machine, largest: int) -> dict[str, int]:
    """Bytes of the table whose entries lie in each level, by the figure that it tells.

    A level whose size is not known well enough, or that is too large here, is left out.
    """
    tables = {}
    first, second = machine.l1_bytes, machine.l2_bytes
    if first.low >= 4096:
        tables["l1_latency_clocks"] = int(first.low / 2)
    between = int(second.low / 2)
    if between > 2 * first.high:
        tables["l2_latency_clocks"] = between
    beyond = int(_BEYOND * second.high)
    if beyond <= min(largest, _LARGEST_TABLE):
        tables["dram_latency_ns"] = beyond
    return tables


def one_cycle(count: int, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """A random permutation (count,) of one cycle (Sattolo 1986)."""
    order = rng.permutation(count)
    following = np.empty(count, np.int64)
    following[order] = np.roll(order, -1)
    return following


def chase_table(size: int, line: int, rng: np.random.Generator) -> npt.NDArray[np.uint32]:
    """A table (n,) of ``size`` bytes, an entry on each line of ``line`` bytes, one by one."""
    apart = line // 4
    lines = max(2, size // line)
    table = np.zeros(lines * apart, np.uint32)
    table[::apart] = one_cycle(lines, rng) * apart
    return table


def chase_ns(device: Device, size: int, line: int) -> list[float]:
    """Nanoseconds a dependent load takes in a table of ``size`` bytes, ``REPEATS`` times."""
    table = device.upload("chase", chase_table(size, line, np.random.default_rng(0)))
    out = device.empty("chase_end", 1, np.uint32)
    args = (reads("next", table), unsigned("steps", _CHASE_STEPS), writes("out", out))
    launch = Launch(_CHASE, "calibrate_chase", args, 1, workgroup_size=1)
    times = [ns / _CHASE_STEPS for ns in _times_ns(device, launch)]
    device.release(table, out)
    return times


def chain_ns(device: Device) -> list[float]:
    """Nanoseconds of a multiply-add that the next needs, ``REPEATS`` times."""
    out = device.empty("chain_end", 1, np.float32)
    args = (
        scalar("factor", np.float32(0.5)),
        scalar("addend", np.float32(0.25)),
        unsigned("turns", _CHAIN_TURNS),
        writes("out", out),
    )
    launch = Launch(_CHASE, "calibrate_chain", args, 1, workgroup_size=1)
    times = [ns / (_CHAIN * _CHAIN_TURNS) for ns in _times_ns(device, launch)]
    device.release(out)
    return times


def _times_ns(device: Device, launch: Launch) -> list[float]:
    """By the device's clock; the first, which builds and touches pages, is not among them."""
    prepared = device.prepare(launch, 1)
    times = []
    for _ in range(REPEATS + 1):
        event = prepared.enqueue(device.queue)
        event.wait()
        times.append(float(event.profile.end - event.profile.start))
    return times[1:]
