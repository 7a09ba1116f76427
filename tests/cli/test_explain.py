"""``gibench explain``: of a technique, of a kernel of one's own, and of wrong input."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gibench.cli.main import call
from gibench.profiles import built_in_profiles
from gibench.trace import extra

SOURCE = """
__kernel void columns(__global const float *from, __global float *to, int n)
{
    const int i = get_global_id(0);
    to[(i % n) * n + i / n] = from[i];
}
__kernel void rows(__global const float4 *from, __global float4 *to, __local float4 *room)
{
    room[get_local_id(0)] = from[get_global_id(0)];
    barrier(CLK_LOCAL_MEM_FENCE);
    to[get_global_id(0)] = room[get_local_id(0)];
}
__kernel void astray(__global float *to, int far)
{
    to[(size_t)get_global_id(0) * far] = 1.0f;
}
"""


MOTION = """
[[motion]]
object = "short box"
axis = [0, 1, 0]
"""
COLUMNS = ["--kernel", "{file}:columns", "--arg", "from=64", "--arg", "to=64"]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.cl"
    path.write_text(SOURCE, encoding="utf-8")
    return path


def explained(tmp_path: Path, *arguments: str) -> tuple[int, pd.DataFrame | None]:
    out = tmp_path / "out"
    code = call(["explain", "--out", str(out), "--cache-dir", str(tmp_path / "cache"), *arguments])
    table = out / "explain.csv"
    return code, pd.read_csv(table) if table.is_file() else None


@pytest.mark.drawn
def test_every_pass_of_a_technique_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, table = explained(
        *(tmp_path, "-t", "direct", "--receivers", "400", "--resolution", "64x48", "--frame", "1"),
        *("-w", "64"),
    )
    assert code == 0
    assert table is not None
    assert (table["status"] == "ok").all()
    assert {"camera", "application"} & set(table["pass"])
    for simd in (32, 64):
        assert (table[f"lines_over_fewest_{simd}"] >= 1).all()
        assert table[f"simd_efficiency_{simd}"].between(0, 1).all()
    assert (np.diff(table.filter(like="dram_bytes_"), axis=1) <= 0).all()
    assert (tmp_path / "out" / "reuse.png").stat().st_size > 1000
    shown = capsys.readouterr().out
    assert "no figure here is a time" in shown
    for sentence in table["sentence"]:
        assert sentence[:60] in shown


def test_passes_of_objects_and_materials_that_change_are_explained(tmp_path: Path) -> None:
    motion = tmp_path / "moving.toml"
    motion.write_text(MOTION, encoding="utf-8")
    code, table = explained(
        *(tmp_path, "-t", "direct", "--receivers", "400", "--resolution", "32x24", "--frame", "1"),
        *("-w", "64", "--motion", str(motion), "--camera-path", "flight"),
        *("--kernel", "rays/refit.cl:move_vertices"),
    )
    assert code == 0
    assert table is not None
    assert set(table["kernel"][table["status"] == "ok"]) == {"move_vertices"}


def test_a_kernel_of_one_s_own_gets_a_sentence_to_act_on(tmp_path: Path, file: Path) -> None:
    code, table = explained(
        *(tmp_path, "--kernel", f"{file}:columns", "--arg", "from=65536", "--arg", "to=65536"),
        *("--arg", "n=256"),
    )
    assert code == 0
    assert table is not None
    assert re.search(
        r"each store of `to` touches 32 lines where 2 could do: neighbours are 1 KB apart",
        table["sentence"][0],
    )


def test_arrays_and_local_memory_are_given_by_name(tmp_path: Path, file: Path) -> None:
    np.save(tmp_path / "from.npy", np.ones((1024, 4), np.float32))
    code, table = explained(
        *(tmp_path, "--kernel", f"{file}:rows", "--arg", f"from={tmp_path / 'from.npy'}"),
        *("--arg", "to=1024", "--arg", "room=64", "-w", "64"),
    )
    assert code == 0
    assert table is not None
    row = table.iloc[0]
    assert (row["local_bytes"], row["lines_over_fewest_32"], row["bank_conflicts_32"]) == (
        1024,
        1,
        1,
    )
    assert row["groups"] == 16


def test_the_same_command_takes_over_its_own_folder_and_no_other(
    tmp_path: Path, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("--kernel", f"{file}:astray", "--arg", "to=64", "--arg", "far=1", "-w", "64")
    assert explained(tmp_path, *asked)[0] == 0
    assert explained(tmp_path, *asked)[0] == 0
    assert explained(tmp_path, *asked, "--items", "64")[0] == 2
    assert "already holds another run" in capsys.readouterr().err


def test_a_kernel_that_faults_is_a_row_and_exit_code_1(
    tmp_path: Path, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, table = explained(
        tmp_path, "--kernel", f"{file}:astray", "--arg", "to=64", "--arg", "far=16777216"
    )
    assert code == 1
    assert table is not None
    assert table["status"].tolist() == ["failed"]
    assert "the kernel faulted (SIGSEGV)" in capsys.readouterr().err


TILES = """
__kernel void tiles(__global const float *from, __global float *to)
{
    const size_t at = get_global_id(1) * PITCH + get_global_id(0);
    to[at] = from[at];
}
__kernel void far(__global const float *from, __global float *to)
{
    const size_t at = get_global_id(0) * PITCH + get_global_id(1);
    to[at] = from[at];
}
"""


def test_a_kernel_of_one_s_own_is_projected_and_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "tiles.cl"
    path.write_text(TILES, encoding="utf-8")
    code, table = explained(
        *(tmp_path, "--kernel", f"{path}:tiles", "--kernel", f"{path}:far", "--define=PITCH=1024"),
        *("--items", "1024x1024", "--group", "32x8", "--arg=from=1048576", "--arg=to=1048576"),
        *("--project", "vega56", "--project", "titan-x-pascal"),
    )
    assert code == 0
    assert table is not None
    assert table["groups"].tolist() == [4096, 4096]
    assert table["lines_over_fewest_32"].tolist() == pytest.approx([1, 16])
    ranges = pd.read_csv(tmp_path / "out" / "projected.csv")
    assert ranges["variant"].tolist() == ["tiles", "tiles", "far", "far"]
    moved = 8 * 1024 * 1024
    for _, row in ranges[ranges["variant"] == "tiles"].iterrows():
        peak = {"vega56": 410e9, "titan-x-pascal": 480e9}[row["device"]]  # bytes/s, data sheets
        assert row["projected_low_ms"] > 0.9e3 * moved / peak
        assert row["projected_low_ms"] < 3e3 * moved / peak
    ratios = pd.read_csv(tmp_path / "out" / "ratios.csv")
    assert ratios["variant"].tolist() == ["far", "far"]
    assert set(ratios["verdict"]) <= {"sure", "likely"}
    shown = capsys.readouterr().out
    assert "Projected, not measured" in shown
    assert "1: tiles.cl tiles" in shown


def bare(folder: Path) -> Path:
    """A profile without a machine part."""
    path = folder / "bare.toml"
    text = built_in_profiles()["vega56"].partition("\n[machine]\n")[0]
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--kernel", "mine"], "--kernel 'mine' is not FILE:NAME"),
        (["--kernel", "absent.cl:x"], "there is no kernel file absent.cl"),
        (["--kernel", "{file}:x"], "has no kernel 'x'; it has columns"),
        (["--kernel", "{file}:columns", "--arg", "n=2"], "argument 'from' .* is not given; add"),
        (["--kernel", "{file}:astray", "--arg", "q=2"], "has no argument 'q'; it has to, far"),
        (["--kernel", "{file}:astray", "--arg", "to"], "--arg 'to' is not NAME=VALUE"),
        (["--kernel", "{file}:astray", "--arg", "to=x", "--arg", "far=1"], "to=x is no number"),
        (["--kernel", "{bad}:x"], r"does not build: line 1:\d+: use of undeclared identifier 'y'"),
        (["--arg", "n=2"], "--arg is for a kernel of your own; add --kernel FILE.cl:NAME"),
        (["--items", "64"], "--items is for a kernel of your own"),
        (
            ["--project", "vega56"],
            "--project is for a kernel of your own; add .* 'gibench run --project",
        ),
        ([*COLUMNS, "--arg", "n=2", "--group", "8by8"], "--group '8by8' is no size; give for"),
        ([*COLUMNS, "--arg", "n=2", "--group", "8x8"], "--group 8x8 needs the launch's size, too"),
        ([*COLUMNS, "--arg", "n=2", "--items", "0"], "--items '0' is no size"),
        (
            [*COLUMNS, "--arg", "n=2", "--items", "64x9", "--group", "8x8"],
            "--items 64x9 is no multiple of the work-group size 8x8; give --items 64x16",
        ),
        ([*COLUMNS, "--arg", "n=2", "--group", "64x64", "--items", "64x64"], "size 4096 is over"),
        ([*COLUMNS, "--define", "2=3"], "--define '2=3' is not NAME=VALUE"),
        ([*COLUMNS, "--define", "A", "--define", "A=1"], "--define A is given twice"),
        ([*COLUMNS, "--arg", "n=2", "--project", "{bare}"], "has no machine part to project from"),
        ([*COLUMNS, "--arg", "n=5000000000"], "n=5000000000 is out of range; give -2147483648 to"),
        ([*COLUMNS, "--arg", "n=2", "--arg", "n=3"], "--arg n is given twice"),
        ([*COLUMNS, "--arg", "n=2", "--items", "64", "-w", "96"], "--items 64 is no multiple"),
        ([*COLUMNS, "--arg", "n=2", "-w", "100000"], "work-group size 100000 is over"),
        (
            ["--kernel", "{file}:columns", "--arg", "to=64", "--arg", "from=999999999999"],
            "from=999999999999 is too large to trace",
        ),
        (
            ["--kernel", "{file}:columns", "--arg", "to=64", "--arg", "from={doubles}"],
            "holds float64, and the kernel takes float",
        ),
        (
            ["--kernel", "{file}:rows", "--arg", "to=64", "--arg", "from={odd}"],
            "holds 7 numbers, no whole number of elements of 4",
        ),
        (
            ["--kernel", "{file}:rows", "--arg=to=64", "--arg=from=64", "--arg=room={odd}"],
            "'room' is local memory",
        ),
        (["-t", "nothing"], "no technique called 'nothing'"),
    ],
)
def test_wrong_input_is_one_line(
    arguments: list[str],
    message: str,
    file: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    bad = tmp_path / "bad.cl"
    bad.write_text("__kernel void x(__global int *a) { *a = y; }", encoding="utf-8")
    doubles, odd = tmp_path / "doubles.npy", tmp_path / "odd.npy"
    np.save(doubles, np.ones(8))
    np.save(odd, np.ones(7, np.float32))
    given = [
        each.format(file=file, bad=bad, doubles=doubles, odd=odd, bare=bare(tmp_path))
        for each in arguments
    ]
    code, _ = explained(tmp_path, *given)
    error = capfd.readouterr().err.strip()
    assert code == 2
    assert re.search(message, error)
    assert "\n" not in error


def test_without_the_extra_one_line_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(extra, "find_spec", lambda name: None if name == "llvmlite" else name)
    code, _ = explained(tmp_path)
    assert code == 3
    error = capsys.readouterr().err
    assert (
        error
        == "gibench: tracing needs llvmlite; install the extra: pip install 'gibench[project]'\n"
    )
