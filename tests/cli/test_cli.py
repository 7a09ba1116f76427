"""The command line as a stranger meets it: every fault is one line and the right exit code."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from gibench.cli.main import call
from gibench.profiles import built_in_profiles, load_profile

PROFILE = """
schema_version = 1
name = "bad"
title = "A device"
simd_width = { value = 32, source = "estimate" }
max_workgroup_size = { value = 512, source = "estimate" }
default_workgroup_size = { value = 256, source = "estimate" }
local_memory_bytes = { value = 16384, source = "estimate" }
memory_budget_bytes = { value = -1, source = "estimate" }
max_buffer_bytes = { value = 1024, source = "estimate" }
compute_units = { value = 6, source = "estimate" }
fp32_gflop_per_s = { value = 250, source = "estimate" }
bandwidth_gb_per_s = { value = 25, source = "estimate" }
dispatch_us = { value = 10, source = "estimate" }
"""


def gibench(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gibench", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **variables},
    )


def make_bad_profile(folder: Path) -> list[str]:
    (folder / "bad.toml").write_text(PROFILE)
    return ["--device-profile", str(folder / "bad.toml")]


def make_unwritable_folder(folder: Path) -> list[str]:
    (folder / "file").write_text("in the way")
    return ["--out", str(folder / "file" / "out")]


def make_occupied_folder(folder: Path) -> list[str]:
    (folder / "taken").mkdir()
    (folder / "taken" / "thesis.txt").write_text("years of work")
    return ["--out", str(folder / "taken")]


def make_unwritable_cache(folder: Path) -> list[str]:
    (folder / "file").write_text("in the way")
    return ["--cache-dir", str(folder / "file" / "cache")]


def make_empty_obj(folder: Path) -> list[str]:
    (folder / "empty.obj").write_text("")
    return ["--scene", str(folder / "empty.obj")]


def make_truncated_glb(folder: Path) -> list[str]:
    (folder / "cut.glb").write_bytes(b"glTF\x02\x00\x00\x00\x00\x10\x00\x00\x10\x00\x00\x00JSON{")
    return ["--scene", str(folder / "cut.glb")]


def make_binary_obj(folder: Path) -> list[str]:
    (folder / "binary.obj").write_bytes(bytes(range(256)) * 64)
    return ["--scene", str(folder / "binary.obj")]


BAD_INPUTS = {
    "frames -1": (["--frames", "-1"], 2, "--frames"),
    "frames 0": (["--frames", "0"], 2, "--frames"),
    "frames in words": (["--frames", "many"], 2, "--frames"),
    "sh order 9": (["--technique", "srp", "--sh-order", "9"], 2, "0 to 7"),
    "work-group 0": (["--workgroup-size", "0"], 2, "--workgroup-size"),
    "work-group 3000": (["--workgroup-size", "3000"], 2, "512"),
    "work-group 33": (["--workgroup-size", "33"], 3, "multiple"),
    "resolution": (["--resolution", "big"], 2, "WxH"),
    "resolution 0": (["--resolution", "0x10"], 2, "out of range"),
    "no such option": (["--frobnicate"], 2, "--frobnicate"),
    "no such technique": (["--technique", "magic"], 2, "magic"),
    "no such variant": (["--variant", "quick"], 2, "published, tuned"),
    "no such setting": (["--set", "direct.speed=9"], 2, "speed"),
    "a setting of another technique": (["--set", "srp.storage=fp16"], 2, "srp"),
    "a setting without value": (["--set", "direct"], 2, "technique.setting=value"),
    "unknown profile": (["--device-profile", "nokia3310"], 2, "nokia3310"),
    "negative budget": (make_bad_profile, 2, "memory_budget_bytes"),
    "no such device": (["--device", "99"], 2, "99"),
    "no such camera": (["--camera", "balcony"], 2, "balcony"),
    "missing scene": (["--scene", "nowhere.obj"], 2, "nowhere"),
    "empty OBJ": (make_empty_obj, 2, "empty.obj"),
    "truncated glb": (make_truncated_glb, 2, "cut.glb"),
    "binary .obj": (make_binary_obj, 2, "binary.obj"),
    "unwritable folder": (make_unwritable_folder, 2, "cannot be written"),
    "unwritable cache": (make_unwritable_cache, 2, "cannot be written"),
    "folder of something else": (make_occupied_folder, 2, "already holds"),
}


IN_A_PROCESS = ("frames -1", "unknown profile", "truncated glb", "unwritable folder")
"""One of each kind (an option, a name, a file, a folder) goes through a process of its own; the
others are called, to be quick."""


@pytest.mark.parametrize("name", BAD_INPUTS)
def test_bad_input_is_one_line_and_an_exit_code(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given, code, told = BAD_INPUTS[name]
    extra = given(tmp_path) if callable(given) else given
    arguments = ["run", "--technique", "direct", "--out", str(tmp_path / "out"), *extra]
    if name in IN_A_PROCESS:
        ran = gibench(*arguments)
        returned, out, err = ran.returncode, ran.stdout, ran.stderr
    else:
        returned = call(arguments)
        out, err = capsys.readouterr()
    assert returned == code, err
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("gibench: ")
    assert told in lines[0]
    assert "Traceback" not in err
    assert out == ""
    assert not (tmp_path / "out" / "samples.csv").exists()
    if name == "folder of something else":
        assert [f.name for f in (tmp_path / "taken").iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("command", (["run", "--technique", "direct"], ["devices"]))
def test_no_opencl_platform_is_one_line_and_exit_3(command: list[str], tmp_path: Path) -> None:
    out = ["--out", str(tmp_path / "out")] if command[0] == "run" else []
    # A folder that does not exist: with an empty one the loader goes back to its own.
    ran = gibench(*command, *out, OCL_ICD_VENDORS=str(tmp_path / "none"))
    assert ran.returncode == 3
    assert len(ran.stderr.splitlines()) == 1
    assert "no OpenCL platform" in ran.stderr
    assert "pyopencl[pocl]" in ran.stderr  # how to mend it


def test_help_answers_in_half_a_second() -> None:
    """Of the processor's time, which no neighbour on a busy machine lengthens much."""

    def seconds() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert gibench("--help").returncode == 0
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert min(seconds() for _ in range(3)) < 0.5


def test_help_loads_nothing_heavy() -> None:
    code = "import sys; from gibench.cli.main import main; sys.argv[1:] = ['--help']; main()"
    ran = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", code],
        capture_output=True,
        text=True,
        check=False,
    )
    loaded = {line.rpartition("|")[2].strip() for line in ran.stderr.splitlines()}
    assert "typer" in loaded
    assert not loaded & {"numpy", "pandas", "pyopencl", "scipy", "matplotlib", "trimesh"}


@pytest.mark.parametrize(
    "command", ([], ["run"], ["bake"], ["profiles"], ["devices"], ["scenes"], ["techniques"])
)
def test_help_is_plain_where_it_is_no_terminal(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert call([*command, "--help"]) == 0
    out, err = capsys.readouterr()
    assert "Usage: gibench" in out
    assert "\x1b" not in out
    assert "[bold]" not in out
    assert err == ""


def test_help_says_everything_under_its_headings(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["--help"]) == 0
    assert "..." not in capsys.readouterr().out.partition("Commands:")[2]  # no summary cut short
    assert call(["quality", "--help"]) == 0
    out = capsys.readouterr().out
    headings = ["What to run", "The truth to compare with", "How and where", "Options:"]
    sections = re.split("|".join(f"^{heading}.*$" for heading in headings), out, flags=re.M)[1:]
    for section, option in zip(
        sections, ("--technique", "--target-error", "--out", "--help"), strict=True
    ):
        assert re.search(rf"^ .*{option} ", section, flags=re.M), option


def test_no_color_is_honoured() -> None:
    assert "\x1b[3" not in gibench("profiles", FORCE_COLOR="1", NO_COLOR="1").stdout


def test_version_and_module_entry() -> None:
    ran = gibench("--version")
    assert re.fullmatch(r"gibench \d+\.\d+\.\d+\S*\n", ran.stdout)


def test_every_figure_of_a_profile_is_shown_with_its_source(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call(["profiles"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in ("iphone7", "radeon560", "vega56"))
    assert call(["profiles", "show", "iphone7"]) == 0
    shown = capsys.readouterr().out
    for figure in ("simd_width", "max_workgroup_size", "memory_budget_bytes", "bandwidth_gb_per_s"):
        (line,) = [text for text in shown.splitlines() if f" {figure} " in text]
        assert len(line.split("│")[3].strip()) > 5
    assert call(["profiles", "show", "nope"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_profile_printed_as_toml_is_a_profile_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = gibench("profiles", "show", "iphone7", "--toml").stdout
    assert printed == built_in_profiles()["iphone7"]
    mine = tmp_path / "mine.toml"
    mine.write_text(printed.replace('name = "iphone7"', 'name = "mine"'), encoding="utf-8")
    assert call(["profiles", "show", str(mine), "--toml"]) == 0
    assert capsys.readouterr().out == mine.read_text("utf-8")
    assert load_profile(str(mine)).figures == load_profile("iphone7").figures


def test_devices_and_techniques_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["devices"]) == 0
    assert "Portable Computing Language" in capsys.readouterr().out
    assert call(["techniques"]) == 0
    assert "direct" in capsys.readouterr().out


def test_built_in_scenes_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["scenes"]) == 0
    out = capsys.readouterr().out
    assert "cornell-box" in out
    assert "40,564" in out


def test_an_unexpected_fault_is_one_line_and_debug_shows_its_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr("gibench.commands.listings.built_in_profiles", broken)
    assert call(["profiles"]) == 1
    text = capsys.readouterr().err
    assert len(text.splitlines()) == 1
    assert "ZeroDivisionError" in text
    assert "please report" in text
    assert call(["profiles"], debug=True) == 1
    assert "Traceback" in capsys.readouterr().err


def test_ctrl_c_is_one_line_and_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gibench.commands.listings.built_in_profiles", interrupted)
    assert call(["profiles"]) == 130
    assert capsys.readouterr().err == "gibench: interrupted\n"


def test_a_reader_that_leaves_is_no_fault() -> None:
    shell = f"{sys.executable} -m gibench run --help | head -n 1"
    ran = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {shell}"], capture_output=True, text=True
    )
    assert ran.stderr == ""
    assert ran.returncode == 0
