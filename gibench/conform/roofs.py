"""The kernels that measure the machine's roofs: they must do the work that is counted for them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gibench.device import Launch, ProgramSpec, reads, scalar, unsigned, writes
from gibench.measure.machine.calibration import chase_table
from gibench.techniques.parts.conformance.case import Bench, Case, off, run

STRETCH, TURNS = 8, 5


def _roofs(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Triad, streaming read, multiply-add chains and one store."""
    device = bench.open()
    width = device.vector_width
    spec = ProgramSpec("measure/roofs.cl", {"VEC": width})
    items, count = 53, 52 * STRETCH + 4
    b, c = rng.random((2, count, width), np.float32)
    shown, other = device.upload("b", b), device.upload("c", c)
    lengths = (unsigned("count", count), unsigned("stretch", STRETCH))
    a = device.empty("a", (count, width), np.float32)
    half = scalar("scalar", np.float32(0.5))
    args = (writes("a", a), reads("b", shown), reads("c", other), half, *lengths)
    run(device, [Launch(spec, "roof_triad", args, items=items)], size)
    yield off(device.read(a), b.astype(np.float64) + 0.5 * c, relative=3e-7)
    sums = device.empty("sums", (items, width), np.float32)
    run(
        device,
        [
            Launch(
                spec, "roof_read", (writes("sums", sums), reads("b", shown), *lengths), items=items
            )
        ],
        size,
    )
    starts = np.arange(0, count, STRETCH)
    expected = np.add.reduceat(b.astype(np.float64), starts, axis=0)
    yield off(device.read(sums)[: len(starts)], expected, relative=3e-6)
    out = device.empty("out", (items, width), np.float32)
    factor = np.float32(0.75)
    numbers = (scalar("factor", factor), unsigned("turns", TURNS), unsigned("count", items))
    run(device, [Launch(spec, "roof_fma", (writes("out", out), *numbers), items=items)], size)
    s = 0.5 + (np.arange(items) & 7)
    chains = s[:, None] + np.arange(10)
    for _ in range(TURNS):
        chains = chains * 0.75 + s[:, None]
    yield off(device.read(out), np.repeat(chains.sum(axis=1)[:, None], width, axis=1), 3e-6)
    one = device.empty("one", 1, np.float32)
    run(device, [Launch(spec, "roof_launch", (writes("out", one),), items=1)], size)
    yield off(device.read(one), np.ones(1))


def _calibration(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Where a chased pointer ends, and a chain of multiply-adds."""
    device = bench.open()
    spec = ProgramSpec("measure/calibrate.cl", {})
    table = chase_table(4096, 64, rng)
    steps = int(rng.integers(1, 64))
    at = 0
    for _ in range(steps):
        at = int(table[at])
    end = device.empty("end", 1, np.uint32)
    held = device.upload("table", table)
    args = (reads("next", held), unsigned("steps", steps), writes("out", end))
    run(device, [Launch(spec, "calibrate_chase", args, items=1)], size)
    yield off(device.read(end), np.array([at]))
    factor, addend = rng.uniform(0.1, 0.9, 2).astype(np.float32)
    x = float(addend)
    for _ in range(8 * TURNS):
        x = x * float(factor) + float(addend)
    last = device.empty("last", 1, np.float32)
    numbers = (scalar("factor", factor), scalar("addend", addend), unsigned("turns", TURNS))
    chain = Launch(spec, "calibrate_chain", (*numbers, writes("out", last)), items=1)
    run(device, [chain], size)
    # Each step rounds once, and passes on a share of what came before: 1 / (1 - factor) in all.
    yield off(device.read(last), np.array([x]), relative=2.0**-24 / (1 - float(factor)))


CASES = [
    Case(
        "The machine's roofs",
        tuple(
            f"measure/roofs.cl:{name}"
            for name in ("roof_triad", "roof_read", "roof_fma", "roof_launch")
        ),
        _roofs,
    ),
    Case(
        "Latencies of loads and arithmetic",
        ("measure/calibrate.cl:calibrate_chase", "measure/calibrate.cl:calibrate_chain"),
        _calibration,
    ),
]
