"""The model on launches whose bound is known, and ranges of what it does not know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.traced import traced

from gibench.profiles import Interval, Machine, load_profile
from gibench.project.model import launch_times
from gibench.project.ranges import RANGE, SURE, UNKNOWN, range_of, ratio, together
from gibench.project.unknowns import POINTS, kernel_points, machine_points
from gibench.trace.analysis import wave_streams
from gibench.trace.request import Sampling

SOURCE = """
__kernel void copy(__global const float *from, __global float *to)
{
    to[get_global_id(0)] = from[get_global_id(0)];
}
__kernel void work(__global const float *from, __global float *to, int steps)
{
    float x = from[get_global_id(0)];
    for (int i = 0; i < steps; ++i)
        x = x * 1.0001f + 0.5f;
    to[get_global_id(0)] = x;
}
__kernel void chase(__global const int *next, __global int *out, int steps)
{
    int at = get_global_id(0);
    for (int i = 0; i < steps; ++i)
        at = next[at];
    out[get_global_id(0)] = at;
}
"""
HOW = Sampling(runs=2, length=6)


def known(name: str = "vega56") -> Machine:
    """A machine of which all is known: its nominal figures."""
    machine = load_profile(name).machine
    assert machine is not None
    figures = {
        key: Interval(each.nominal, each.nominal, each.nominal, "test")
        for key, each in vars(machine).items()
    }
    return Machine(**figures)


@pytest.fixture(scope="module")
def copied():
    n = 1 << 20
    values = {"from": np.zeros(n, np.float32), "to": np.zeros(n, np.float32)}
    return wave_streams(traced(SOURCE, "copy", n // 256, 256, HOW, **values), 64)


def test_a_copy_is_bound_by_dram_and_takes_its_bytes(copied) -> None:
    machine = known()
    times = launch_times(copied, machine)
    assert times.bound_by == "DRAM"
    rate = machine.dram_gb_per_s.nominal * machine.dram_share.nominal * 1e6
    assert times.parts["DRAM"][0] == pytest.approx(2 * 4 * (1 << 20) / rate, rel=0.02)
    found = range_of(together([times]), machine)
    assert found.verdict == RANGE and found.low < found.nominal < found.high
    faster = replace(machine, dram_gb_per_s=Interval(900, 900, 900, "test"))
    halved = ratio(together([times]), together([launch_times(copied, faster)]))
    assert halved.verdict == SURE and 1.5 < halved.nominal < 2.3


def test_work_is_bound_by_instructions_and_grows_with_them() -> None:
    n = 256 * 512
    values = {"from": np.zeros(n, np.float32), "to": np.zeros(n, np.float32)}
    few, many = (
        launch_times(
            wave_streams(
                traced(SOURCE, "work", 512, 256, HOW, **values, steps=np.int32(steps)), 64
            ),
            known(),
        )
        for steps in (2000, 4000)
    )
    assert few.bound_by == many.bound_by == "instructions"
    assert many.parts["instructions"][0] / few.parts["instructions"][0] == pytest.approx(
        2, rel=0.01
    )


def test_a_chase_of_one_wave_takes_its_steps_latencies(rng: np.random.Generator) -> None:
    machine = known()
    ring = rng.permutation(1 << 20).astype(np.int32)
    values = {"next": ring, "out": np.zeros(64, np.int32), "steps": np.int32(100)}
    times = launch_times(wave_streams(traced(SOURCE, "chase", 1, 64, **values), 64), machine)
    assert times.bound_by == "latency"
    # Of each request's 64 lanes some miss everything: DRAM answers.
    assert times.parts["latency"][0] > 100 * machine.dram_latency_ns.nominal * 1e-6
    assert times.parts["latency"][0] < 115 * machine.dram_latency_ns.nominal * 1e-6 + 0.01
    unsure = replace(
        machine, dram_latency_ns=Interval(100, machine.dram_latency_ns.nominal, 900, "estimate")
    )
    found = range_of(together([replace(times, places=times.places)]), unsure)
    assert found.verdict == UNKNOWN and "dram_latency_ns" in found.reason


def test_what_is_not_known_of_a_machine_widens_the_range_and_is_named(copied) -> None:
    machine = known()
    narrow = range_of(together([launch_times(copied, machine)]), machine)
    unsure = replace(machine, dram_share=Interval(0.1, 0.5, 1.0, "estimate"))
    wide = range_of(together([launch_times(copied, unsure)]), unsure)
    assert wide.width > 2 * narrow.width
    assert wide.driven_by == "dram_share" and narrow.driven_by != "dram_share"
    assert wide.shown is None and narrow.shown == narrow.nominal


def test_points_are_nominal_first_and_inside_their_intervals() -> None:
    machine = load_profile("iphone7").machine
    assert machine is not None
    found = machine_points(machine)
    for name, values in found.figures.items():
        each = getattr(machine, name)
        assert values[0] == each.nominal
        assert (values >= each.low * 0.999).all() and (values <= each.high * 1.001).all()
        if each.spread > 1 and name not in ("line_bytes", "sector_bytes"):
            below = (values < each.nominal).mean()
            assert 0.2 < below < 0.6, name
    assert len(found.places["l2_bytes"]) == POINTS
    same, other = kernel_points("a", "x"), kernel_points("a", "y")
    assert (same.figures["unroll"] == other.figures["unroll"]).all()
    assert (same.figures["own"] != other.figures["own"]).any()
    assert (kernel_points("b", "x").figures["unroll"] != same.figures["unroll"]).any()
