"""The machine part of a profile: what a model of the device needs, each figure an interval.

Nothing of it binds or is measured with; :mod:`gibench.project` computes ranges of time from it. A
profile's file has a line for each figure in its ``[machine]`` table: ``{ low, nominal, high,
source }``, or ``{ value, source }`` where it is known exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from gibench.errors import BadInput

ESTIMATE = "estimate"
"""The word by which a source says that there is none."""


@dataclass(frozen=True)
class Interval:
    """A figure that is known to lie between two others, and where that comes from."""

    low: float
    nominal: float
    high: float
    source: str

    @property
    def estimated(self) -> bool:
        """Whether nobody published it."""
        return ESTIMATE in self.source

    @property
    def spread(self) -> float:
        """The highest over the lowest."""
        return self.high / self.low


@dataclass(frozen=True)
class Machine:
    """What a device is made of.

    Attributes:
        units: compute units (multiprocessors, shader cores, subslices), each with an L1 of its own.
        lanes: lanes a unit issues a clock, of single precision.
        waves: waves of the profile's SIMD width a unit holds.
        groups: work-groups a unit holds.
        register_bytes: of a unit.
        local_bytes: local memory of a unit.
        local_bytes_per_clock: of a unit's local memory.
        l1_bytes: of a unit; a few hundred where global loads are not cached there.
        l1_bytes_per_clock: of a unit.
        l2_bytes: the last level that all units share.
        l2_bytes_per_clock: of the device.
        line_bytes: of a cache line, the unit in which L1 is looked up.
        sector_bytes: the least that is fetched.
        alu_latency_clocks: from an instruction to one that needs its result.
        local_latency_clocks: of local memory.
        l1_latency_clocks: of a hit in L1.
        l2_latency_clocks: of a hit in L2.
        dram_latency_ns: of a miss.
        dram_gb_per_s: by data rate and width of the bus.
        dram_share: of that, what microbenchmarks reach.
        clock_mhz: sustained (low) to boost (high).
        launch_us: from the end of a launch to the start of the next of one queue.
    """

    units: Interval
    lanes: Interval
    waves: Interval
    groups: Interval
    register_bytes: Interval
    local_bytes: Interval
    local_bytes_per_clock: Interval
    l1_bytes: Interval
    l1_bytes_per_clock: Interval
    l2_bytes: Interval
    l2_bytes_per_clock: Interval
    line_bytes: Interval
    sector_bytes: Interval
    alu_latency_clocks: Interval
    local_latency_clocks: Interval
    l1_latency_clocks: Interval
    l2_latency_clocks: Interval
    dram_latency_ns: Interval
    dram_gb_per_s: Interval
    dram_share: Interval
    clock_mhz: Interval
    launch_us: Interval


MACHINE_FIGURES = tuple(field.name for field in fields(Machine))
_WHOLE = frozenset(("units", "waves", "groups", "line_bytes", "sector_bytes"))
_EXAMPLE = '{ low = 1, nominal = 2, high = 4, source = "estimate" }'


def read_machine(table: Any, where: str) -> tuple[Machine | None, list[BadInput]]:
    """The machine part that a file's ``[machine]`` table holds.

    Args:
        table: what the file has under ``machine``.
        where: the file's name, for messages.

    Returns:
        The machine, None where anything is wrong with it; all that is wrong.
    """
    if not isinstance(table, Mapping):
        return None, [BadInput("'machine' is no table", where=where, mend="write [machine]")]
    found: dict[str, Interval] = {}
    faults = [
        BadInput(
            f"unknown figure 'machine.{name}'",
            where=where,
            mend=f"the figures are {', '.join(MACHINE_FIGURES)}",
        )
        for name in sorted(set(table) - set(MACHINE_FIGURES))
    ]
    for name in MACHINE_FIGURES:
        interval = _interval(table.get(name), name, where)
        if isinstance(interval, BadInput):
            faults.append(interval)
        else:
            found[name] = interval
    faults += _together(found, where)
    return (None, faults) if faults else (Machine(**found), [])


def _interval(entry: Any, name: str, where: str) -> Interval | BadInput:
    what = f"figure 'machine.{name}'"
    if not isinstance(entry, Mapping):
        return BadInput(f"{what} is missing", where=where, mend=f"add {name} = {_EXAMPLE}")
    source = entry.get("source")
    if not isinstance(source, str) or not source.strip():
        return BadInput(f"{what} has no source", where=where, mend=f"write {name} = {_EXAMPLE}")
    keys = ("value",) if "value" in entry else ("low", "nominal", "high")
    for stranger in sorted(set(entry) - {*keys, "source"}):
        return BadInput(f"{what} has an unknown '{stranger}'", where=where, mend=_EXAMPLE)
    numbers = []
    for key in keys:
        number = entry.get(key)
        if number is None:
            return BadInput(f"{what} has no '{key}'", where=where, mend=f"write {_EXAMPLE}")
        if isinstance(number, bool) or not isinstance(number, int | float):
            return BadInput(f"{what} has {key} = {number!r}, not a number", where=where)
        if not 0 < number < float("inf"):
            return BadInput(f"{what} has {key} = {number}", where=where, mend="it must be positive")
        if name in _WHOLE and number != int(number):
            return BadInput(f"{what} has {key} = {number}", where=where, mend="it must be whole")
        numbers.append(float(number))
    low, nominal, high = numbers * 3 if len(numbers) == 1 else numbers
    if low > high:
        return BadInput(
            f"{what} has low {low:g} above high {high:g}", where=where, mend="swap them"
        )
    if not low <= nominal <= high:
        return BadInput(
            f"{what} has nominal {nominal:g} outside {low:g} to {high:g}",
            where=where,
            mend="low, nominal, high in ascending order",
        )
    return Interval(low, nominal, high, source)


def _together(found: Mapping[str, Interval], where: str) -> list[BadInput]:
    """What is wrong with figures that each alone may be right."""
    faults = []
    share = found.get("dram_share")
    if share is not None and share.high > 1:
        faults.append(
            BadInput(
                f"figure 'machine.dram_share' has high {share.high:g}",
                where=where,
                mend="a share is at most 1",
            )
        )
    line, sector = found.get("line_bytes"), found.get("sector_bytes")
    for name, each in (("line_bytes", line), ("sector_bytes", sector)):
        if each is not None and any(
            number not in (32, 64, 128, 256) for number in (each.low, each.nominal, each.high)
        ):
            faults.append(
                BadInput(
                    f"figure 'machine.{name}' has {each.nominal:g}",
                    where=where,
                    mend="it must be 32, 64, 128 or 256",
                )
            )
    if line is not None and sector is not None and sector.high > line.low:
        faults.append(
            BadInput(
                "figure 'machine.sector_bytes' is above 'machine.line_bytes'",
                where=where,
                mend="a line is made of sectors",
            )
        )
    return faults
