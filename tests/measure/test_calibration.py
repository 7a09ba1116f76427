"""A device's own microbenchmarks, and the profile that comes of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gibench.cli.main import call
from gibench.device import Device, list_devices
from gibench.errors import BadInput
from gibench.measure.machine import calibration
from gibench.measure.machine.calibration import calibrate, calibrated, chase_table, one_cycle
from gibench.profiles import DeviceProfile, Interval, load_profile
from gibench.profiles.profile import parse_profile
from gibench.profiles.written import profile_toml


def of_this_device() -> DeviceProfile:
    """A profile with as many units as there are, next to nothing known of latencies."""
    profile = load_profile("vega56")
    assert profile.machine is not None
    units = Device.unlimited().cl_device.max_compute_units

    def wide(low: float, high: float) -> Interval:
        return Interval(low, (low * high) ** 0.5, high, "estimate")

    machine = replace(
        profile.machine,
        units=Interval(units, units, units, "this machine"),
        lanes=wide(1, 64),
        l1_bytes=wide(16384, 49152),
        l2_bytes=wide(1 << 18, 1 << 22),
        l1_latency_clocks=wide(0.1, 1000),
        l2_latency_clocks=wide(0.1, 10_000),
        dram_latency_ns=wide(0.1, 10_000),
        dram_gb_per_s=wide(1000, 10_000),
        launch_us=wide(0.01, 10_000),
    )
    return replace(profile, machine=machine)


@pytest.mark.parametrize("count", [2, 3, 64, 1001])
def test_a_chase_goes_through_every_entry(rng: np.random.Generator, count: int) -> None:
    following = one_cycle(count, rng)
    at, seen = 0, set()
    for _ in range(count):
        seen.add(at)
        at = int(following[at])
    assert at == 0 and len(seen) == count
    table = chase_table(count * 64, 64, rng)
    assert table.nbytes == count * 64
    assert sorted(table[::16]) == [16 * n for n in range(count)]


def test_measured_figures_replace_estimates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "REPEATS", 2)
    monkeypatch.setattr(calibration, "_CHASE_STEPS", 20_000)
    monkeypatch.setattr(calibration, "_CHAIN_TURNS", 5_000)
    profile = of_this_device()
    found = calibrate(profile)
    assert set(found) == {
        *("launch_us", "dram_gb_per_s", "dram_share", "alu_latency_clocks"),
        *("l1_latency_clocks", "l2_latency_clocks", "dram_latency_ns"),
    }  # not the clock: lanes are not known
    before, after = profile.machine, calibrated(profile, found).machine
    assert before is not None and after is not None
    for name, interval in found.items():
        assert interval.low <= interval.nominal <= interval.high
        assert name == "dram_gb_per_s" or "calibrate" in interval.source
    for name in ("launch_us", "l1_latency_clocks", "l2_latency_clocks", "dram_latency_ns"):
        assert getattr(after, name).spread < getattr(before, name).spread
    # A table past every cache takes longer to chase than one in the first.
    clock_ghz = before.clock_mhz.nominal * 1e-3
    assert after.dram_latency_ns.low > after.l1_latency_clocks.low / clock_ghz
    # What is reached is the rate times the share, whatever the rate was said to be.
    reached = after.dram_gb_per_s.nominal * after.dram_share.high
    known = replace(before, dram_gb_per_s=Interval(0.01, 0.01, 0.01, "too little"))
    less = calibrated(profile, calibration._bandwidth(known, [reached], "x")).machine
    assert less is not None and less.dram_gb_per_s.nominal == reached
    assert less.dram_share.high == 1


@pytest.mark.parametrize("name", ["iphone7", "titan-x-pascal", "mali-g78"])
def test_a_profile_is_written_as_it_is_read(name: str) -> None:
    profile = load_profile(name)
    again = parse_profile(profile_toml(profile), where="again")
    assert again.machine == profile.machine and again.figures == profile.figures
    assert profile_toml(again) == profile_toml(profile)


def test_another_devices_profile_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    units = list_devices()[0].max_compute_units
    out = tmp_path / "mine.toml"
    assert call(["calibrate", "-d", "h100", "-o", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"the device has {units} compute units, the profile 1" in line and "--device" in line
    assert not out.exists()
    with pytest.raises(BadInput, match="no machine part"):
        calibrate(replace(load_profile("iphone7"), machine=None))


def test_the_command_writes_a_profile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibration, "REPEATS", 1)
    monkeypatch.setattr(calibration, "_CHASE_STEPS", 2_000)
    monkeypatch.setattr(calibration, "_CHAIN_TURNS", 500)
    mine = tmp_path / "this.toml"
    mine.write_text(profile_toml(of_this_device()))
    out = tmp_path / "calibrated.toml"
    assert call(["calibrate", "-d", str(mine), "-o", str(out)]) == 0
    printed = capsys.readouterr()
    assert "launch_us" in printed.out and "latency of arithmetic" in printed.err
    profile = load_profile(str(out))
    assert profile.name == "vega56-calibrated" and "calibrated on" in profile.title
    assert profile.machine is not None and "calibrate" in profile.machine.launch_us.source
    assert call(["profiles", "check", str(out)]) == 0
