"""The machine part of profiles: intervals with their source, faults told one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gibench.cli.main import call
from gibench.errors import BadInput
from gibench.profiles import (
    MACHINE_FIGURES,
    Interval,
    built_in_profiles,
    load_profile,
    read_profile,
)

VEGA = built_in_profiles()["vega56"]
L1 = 'l1_bytes = { value = 16384, source = "AMD, Graphics Cores Next whitepaper 2012: 16 KB" }'


@pytest.mark.parametrize("name", sorted(built_in_profiles()))
def test_every_built_in_machine_is_in_order_and_near_its_limits(name: str) -> None:
    profile = load_profile(name)
    machine = profile.machine
    assert machine is not None
    for key in MACHINE_FIGURES:
        each = getattr(machine, key)
        assert 0 < each.low <= each.nominal <= each.high, key
        assert len(each.source) >= len("estimate"), key
    # The peak by units, lanes and clock is the one that the profile reports, an order apart.
    peak = 2e-3 * machine.units.high * machine.lanes.high * machine.clock_mhz.high
    assert 0.9 < peak / profile.fp32_gflop_per_s < 2.4
    assert machine.dram_gb_per_s.low <= profile.bandwidth_gb_per_s <= machine.dram_gb_per_s.high
    assert machine.l1_bytes.high < machine.l2_bytes.high
    assert machine.l1_latency_clocks.low <= machine.l2_latency_clocks.high


@pytest.mark.parametrize(
    ("old", "new", "told"),
    (
        (L1, "", "'machine.l1_bytes' is missing"),
        (L1, L1.replace("value = 16384", "low = 2, nominal = 1, high = 1"), "low 2 above high 1"),
        (L1, L1.replace("value = 16384", "low = 1, nominal = 9, high = 4"), "nominal 9 outside"),
        (L1, L1.replace("value = 16384", "low = 1, high = 4"), "no 'nominal'"),
        (L1, L1.replace("16384", "-1"), "must be positive"),
        (L1, L1.replace("16384", "true"), "not a number"),
        (L1, L1.replace("16384,", "16384, width = 3,"), "unknown 'width'"),
        (L1, "l1_bytes = { value = 16384 }", "no source"),
        (L1, L1 + '\nl1_size = { value = 1, source = "x" }', "machine.l1_size"),
        ("waves = { value = 40,", "waves = { value = 40.5,", "must be whole"),
        ("local_bytes = { value = 65536,", "local_bytes = { value = 16,", "less than the 32,768"),
        ("sector_bytes = { value = 64,", "sector_bytes = { value = 48,", "32, 64, 128"),
        ("sector_bytes = { value = 64,", "sector_bytes = { value = 256,", "made of sectors"),
        ("nominal = 0.78, high = 0.88", "nominal = 0.78, high = 1.2", "at most 1"),
        ("[machine]", "[machin]", "machin"),
    ),
)
def test_a_fault_is_one_line_that_names_it(
    old: str, new: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert VEGA.count(old) == 1
    path = tmp_path / "mine.toml"
    path.write_text(VEGA.replace(old, new))
    with pytest.raises(BadInput, match=told.replace("(", "\\(")):
        load_profile(str(path))
    assert call(["profiles", "check", str(path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert any(told in line for line in lines) and all("mine.toml" in line for line in lines)


def test_all_faults_are_told_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    bad = VEGA.replace(L1, "").replace("waves = { value = 40,", "waves = { value = -40,")
    path.write_text(bad.replace("[simd_width]\nvalue = 64", "[simd_width]\nvalue = 0"))
    assert call(["profiles", "check", str(path)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 3
    assert all(name in told for name in ("simd_width", "machine.l1_bytes", "machine.waves"))


def test_limits_alone_make_a_profile_that_nothing_is_projected_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(VEGA.partition("\n[machine]\n")[0])
    profile = load_profile(str(path))
    assert profile.machine is None
    assert profile.content_hash == load_profile("vega56").content_hash
    assert profile.machine_hash != load_profile("vega56").machine_hash
    assert call(["profiles", "check", str(path)]) == 2
    assert "no machine part" in capsys.readouterr().err
    assert call(["profiles", "check", "vega56"]) == 0
    assert "sound" in capsys.readouterr().out


def test_a_known_figure_is_an_interval_of_one_number(rng: np.random.Generator) -> None:
    number = float(rng.uniform(1, 1e6))
    text = VEGA.replace(L1, L1.replace("16384", repr(number)))
    profile, faults = read_profile(text, where="mine.toml")
    assert profile is not None and not faults and profile.machine is not None
    assert profile.machine.l1_bytes == Interval(
        number, number, number, profile.machine.l1_bytes.source
    )
    assert profile.machine.l1_bytes.spread == 1 and not profile.machine.l1_bytes.estimated
    assert load_profile("iphone7").machine.l1_bytes.estimated  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "changed",
    (
        VEGA.replace("[machine]", "[machine] # of the die"),
        VEGA.replace("[machine]", "[ machine ]\t"),
        VEGA.replace("\n", "\r\n"),
    ),
)
def test_however_the_machine_part_is_written_the_limits_are_the_same(changed: str) -> None:
    profile, faults = read_profile(changed, where="mine.toml")
    assert profile is not None and not faults and profile.machine is not None
    assert profile.content_hash == load_profile("vega56").content_hash
