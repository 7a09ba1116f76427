"""What traces say, as rows, sentences and a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from gibench.profiles import DeviceProfile
from gibench.report.occupancy import GROUPS, LOCAL, held, waves_of
from gibench.trace.facts import CACHE_BYTES, AccessFacts, LaunchFacts, SimdFacts

KINDS = ("load", "store", "atomic")
SHOWN_CACHE = 1 << 20
"""The cache that the terminal's table and the sentences stand for."""
_UNSURE = 0.1
"""A relative standard error that a sentence tells."""
_LONG_CHAIN = 16
"""Loads in a row that a sentence tells."""


def at_width(facts: LaunchFacts, simd: int) -> SimdFacts:
    """The facts at the widest analysed waves of at most ``simd`` lanes."""
    fitting = [each for each in facts.simd if each.simd <= simd]
    return max(fitting, key=lambda each: each.simd) if fitting else facts.simd[0]


def row(facts: LaunchFacts, profile: DeviceProfile) -> dict[str, Any]:
    """The figures of a launch as a row of ``explain.csv``."""
    found: dict[str, Any] = {
        "groups": facts.groups,
        "groups_traced": facts.traced,
        "workgroup_size": facts.items,
    }
    for each in facts.simd:
        found |= {
            f"lines_over_fewest_{each.simd}": each.lines_over_fewest,
            f"sectors_over_fewest_{each.simd}": each.sectors_over_fewest,
            f"simd_efficiency_{each.simd}": each.efficiency,
            f"bank_conflicts_{each.simd}": each.bank_conflicts,
            f"loads_in_a_row_{each.simd}": each.in_a_row,
            f"load_batches_{each.simd}": each.batches,
            f"lines_stderr_{each.simd}": each.lines_error,
            f"efficiency_stderr_{each.simd}": each.efficiency_error,
        }
    found |= {
        "flops": facts.flops,
        "instructions": facts.instructions,
        "work_stderr": facts.instructions_error,
        "requested_bytes": facts.requested_bytes,
    }
    for size, dram in zip(CACHE_BYTES, facts.dram_bytes, strict=True):
        found[f"dram_bytes_{size >> 10}k"] = dram
    for name, moved in zip(("bytes_behind_l1", "bytes_behind_l2"), facts.behind, strict=False):
        found[name] = moved
    found |= {
        "atomics": facts.atomics,
        "atomics_per_address": facts.atomics_per_address,
        "private_per_item": facts.private_per_item,
        "outside": facts.outside,
        "local_bytes": facts.local_bytes,
        "groups_per_unit": facts.groups / profile.compute_units,
        "waves_per_group": waves_of(facts, profile),
    }
    unit = held(facts, profile)
    if unit is not None:
        found |= {
            "groups_that_fit_local": unit.fit_local if facts.local_bytes else math.nan,
            "groups_held": unit.groups,
            "work_items_held": unit.groups * facts.items,
            "waves_held_share": unit.share,
            "held_by": unit.held_by,
        }
    return found


def sentence(facts: LaunchFacts, profile: DeviceProfile, declared_bytes: float = 0.0) -> str:
    """What a person can act on, the worst first; at most two things."""
    simd = at_width(facts, profile.simd_width)
    told = [
        *_faults(facts),
        *_idle(facts, profile),
        *_lines(simd),
        *_banks(simd),
        *_lanes(simd),
        *_atomics(facts),
        *_dram(facts, declared_bytes),
        *_local(facts, profile),
        *_chain(simd),
    ]
    if told:
        return "; ".join([*told[:2], *_sampled(facts)])
    moved = facts.dram_bytes[CACHE_BYTES.index(SHOWN_CACHE)]
    rate = f"{facts.flops / moved:.2g} flops a byte of DRAM" if moved else "no global memory"
    lines = simd.lines_over_fewest
    where = "" if math.isnan(lines) else f"{lines:.2g} times the fewest cache lines, "
    return "; ".join([f"nothing stands out: {where}{rate}", *_sampled(facts)])


def _sampled(facts: LaunchFacts) -> list[str]:
    """That the sample says little, where its runs of groups differ much."""
    if not facts.instructions_error > _UNSURE:
        return []
    return [
        f"groups differ: by its {facts.traced:,} of {facts.groups:,} groups the launch is known to "
        f"{100 * facts.instructions_error:.0f} %"
    ]


def _chain(simd: SimdFacts) -> list[str]:
    if simd.in_a_row < _LONG_CHAIN:
        return []
    return [
        f"a wave waits for {simd.in_a_row:.0f} loads one after another: only other waves hide that"
    ]


def _faults(facts: LaunchFacts) -> list[str]:
    if not facts.outside:
        return []
    return [f"{facts.outside:,} accesses of the sample lie outside every buffer: mend that first"]


def _idle(facts: LaunchFacts, profile: DeviceProfile) -> list[str]:
    if facts.groups >= profile.compute_units or facts.items * facts.groups <= profile.simd_width:
        return []
    groups = "work-group" if facts.groups == 1 else "work-groups"
    idle = profile.compute_units - facts.groups
    return [
        f"{facts.groups} {groups} for {profile.compute_units} units: {idle} of them "
        f"{'has' if idle == 1 else 'have'} nothing to do"
    ]


def _lines(simd: SimdFacts) -> list[str]:
    """Of all loads, stores or atomics of one buffer, those that touch the most lines beyond the
    fewest, where they matter.
    """
    together: dict[tuple[str, int], list[AccessFacts]] = {}
    for access in simd.accesses:
        together.setdefault((access.buffer, access.kind), []).append(access)
    total = sum(access.lines for access in simd.accesses)
    found = []
    for (buffer, kind), group in together.items():
        lines, fewest = sum(a.lines for a in group), sum(a.fewest_lines for a in group)
        requests = sum(a.requests for a in group)
        if lines > fewest and lines - fewest >= 0.2 * total and lines >= 1.5 * fewest:
            worst = max(group, key=lambda a: a.lines - a.fewest_lines)
            text = (
                f"each {KINDS[kind]} of `{buffer}` touches {lines / requests:.3g} lines where "
                f"{fewest / requests:.3g} could do: {_apart(worst)}"
            )
            found.append((lines - fewest, text))
    return [max(found)[1]] if found else []


def _apart(access: AccessFacts) -> str:
    if access.stride is None:
        return "neighbours' addresses are scattered"
    return f"neighbours are {_bytes(abs(access.stride))} apart"


def _banks(simd: SimdFacts) -> list[str]:
    excess, worst = max(
        ((a.cycles - a.fewest_cycles, a) for a in simd.accesses),
        key=lambda each: each[0],
        default=(0, None),
    )
    if worst is None or not excess or worst.cycles < 1.5 * worst.fewest_cycles:
        return []
    return [
        f"each {KINDS[worst.kind]} of `{worst.buffer}` takes {worst.cycles / worst.requests:.3g} "
        f"turns of local memory's banks where {worst.fewest_cycles / worst.requests:.3g} could do: "
        f"{_apart(worst)}, a padded row would spread them"
    ]


def _lanes(simd: SimdFacts) -> list[str]:
    if not simd.efficiency < 0.7:
        return []
    return [
        f"{100 * simd.efficiency:.0f} % of the lanes are active: neighbours take other branches or "
        "loops of other lengths"
    ]


def _atomics(facts: LaunchFacts) -> list[str]:
    sampled = facts.atomics * facts.traced / max(facts.groups, 1)
    if facts.atomics_per_address < 64 or facts.atomics_per_address < 0.1 * sampled:
        return []
    return [
        f"{facts.atomics_per_address:,} of {sampled:,.0f} sampled atomics fall on one address: "
        "they wait for each other"
    ]


def _dram(facts: LaunchFacts, declared: float) -> list[str]:
    moved = facts.dram_bytes[CACHE_BYTES.index(SHOWN_CACHE)]
    if not declared or moved < 2 * declared:
        return []
    times = f"{moved / declared:.1f} times the bytes that the pass must move"
    if moved < 1.5 * facts.dram_bytes[-1]:
        return [f"touches {times}, whatever the cache: of each sector it uses but a part"]
    return [f"moves {times} behind a cache of 1 MB: what it reads again no longer lies there"]


def _local(facts: LaunchFacts, profile: DeviceProfile) -> list[str]:
    """That local memory, or the number of groups, leaves a unit half empty or more."""
    low, unit, high = (held(facts, profile, end) for end in ("low", "nominal", "high"))
    if low is None or unit is None or high is None or unit.share > 0.5:
        return []
    of = f"of the {unit.of_waves} waves that it has room for"
    if unit.held_by == LOCAL:
        least, most = sorted((low.groups, high.groups))
        many = f"{least:,}" if least == most else f"{least:,} to {most:,}"
        groups = "group" if most == 1 else "groups"
        return [
            f"its {_bytes(facts.local_bytes)} of local memory let {many} {groups} at a time onto a "
            f"unit of {profile.name}: {unit.waves} {of}"
        ]
    if high.held_by == GROUPS and high.share <= 0.5:
        return [
            f"groups of {facts.items} work-items are small: a unit of {profile.name} holds "
            f"{unit.groups} groups, so {unit.waves} {of}"
        ]
    return []


def _bytes(count: int) -> str:
    return f"{count / 1024:.3g} KB" if count >= 1024 else f"{count} bytes"


def show_explanation(table: pd.DataFrame, profile: DeviceProfile) -> None:
    """The table on the terminal, with a sentence for every kernel."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.report.figures import number, percent
    from gibench.report.terminal import console

    out = console()
    out.print(
        f"What launches do, at waves of {profile.simd_width} lanes ({profile.name}); traced, not "
        "timed: no figure here is a time",
        soft_wrap=True,
    )
    shown = Table("pass", "kernel", "groups")
    for name in ("lines", "sectors", "lanes", "banks", "DRAM MB", "over declared", "Mflop"):
        shown.add_column(name, justify="right")
    for name in ("M instr.", "atomics", "on one", "groups/unit", "held"):
        shown.add_column(name, justify="right")
    simd = 64 if profile.simd_width >= 64 else 32
    for _, each in table.iterrows():
        if each["status"] != "ok":
            continue
        shown.add_row(
            escape(str(each["pass"])),
            escape(str(each["kernel"])),
            f"{each['groups_traced']:,.0f}/{each['groups']:,.0f}",
            number(each[f"lines_over_fewest_{simd}"]),
            number(each[f"sectors_over_fewest_{simd}"]),
            percent(each[f"simd_efficiency_{simd}"]),
            number(each[f"bank_conflicts_{simd}"]),
            number(each["dram_bytes_1024k"] / 1e6),
            number(each["dram_over_declared"]),
            number(each["flops"] / 1e6),
            number(each["instructions"] / 1e6),
            number(each["atomics"], 0),
            number(each["atomics_per_address"], 0),
            number(each["groups_per_unit"], 1),
            number(each.get("groups_held", math.nan), 0),
        )
    if shown.row_count:
        out.print(shown)
    for line in told(table):
        out.print(escape(line), soft_wrap=True)


def told(table: pd.DataFrame) -> list[str]:
    """A line for every launch: what it does, or why it was not traced."""
    lines = []
    for _, each in table.iterrows():
        text = each["sentence"] if each["status"] == "ok" else f"{each['status']}: {each['reason']}"
        name = (
            each["pass"] if each["pass"] == each["kernel"] else f"{each['pass']} {each['kernel']}"
        )
        layout = each.get("layout")
        shown = (each["technique"], each["variant"], "" if pd.isna(layout) else layout, name)
        lines.append(f"{' '.join(str(part) for part in shown if part)}: {text}")
    return lines


def columns(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The columns of ``explain.csv``: those of the launch first, what can be read last."""
    first = [
        "technique",
        "variant",
        "layout",
        "scene",
        "profile",
        "pass",
        "kernel",
        "launch",
        "frame",
    ]
    last = ["declared_bytes", "dram_over_declared", "sentence", "status", "reason"]
    between = dict.fromkeys(name for each in rows for name in each)
    return [*first, *(name for name in between if name not in (*first, *last)), *last]
