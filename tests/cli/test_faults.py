"""Faults in the middle of a run: it says what happened, keeps what it measured, exits non-zero."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pyopencl as cl
import pytest
from support import fake_technique

import gibench
from gibench.cli.main import call
from gibench.device import Device, PreparedLaunch
from gibench.measure.machine import roofs
from gibench.measure.runfolder import folder as run_folder
from gibench.measure.session.session import Session
from gibench.measure.statistics.summary import Roofs

GRID = ("-w", "64", "-w", "128", "--frames", "20", "--warmup", "0")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    specs = {spec.name: spec for spec in (fake_technique.SPEC, fake_technique.PLAIN)}
    monkeypatch.setattr("gibench.techniques.registry.techniques", lambda: specs)
    roofs = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)
    monkeypatch.setattr("gibench.measure.machine.roofs.measure_roofs", lambda *_: roofs)

    def start(*arguments: str) -> int:
        return call(
            [
                *("run", "--no-quality", "--technique", "fake", "--receivers", "400", "--quiet"),
                *("--resolution", "16x8", "--cache-dir", str(tmp_path / "cache")),
                *("--out", str(tmp_path / "out"), *GRID, *arguments),
            ]
        )

    return start


def left(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame, dict]:
    record = json.loads((folder / "run.json").read_text())
    return pd.read_csv(folder / "samples.csv"), pd.read_csv(folder / "frames.csv"), record


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    out, err = capsys.readouterr()
    (line,) = err.splitlines()
    assert "Traceback" not in out + err
    return line


def test_the_disk_fills_while_samples_are_written(run, tmp_path, monkeypatch, capsys) -> None:
    append, calls = run_folder.RunFolder.append_samples, []

    def filling(self, rows) -> None:
        calls.append(len(rows))
        if len(calls) == 4:
            error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            raise run_folder._cannot_write(self.path / "samples.csv", error) from error
        append(self, rows)

    monkeypatch.setattr(run_folder.RunFolder, "append_samples", filling)
    assert run() == 1
    line = one_line(capsys)
    assert "No space left on device" in line
    samples, frames, record = left(tmp_path / "out")
    assert len(samples) == 3 * 5 * 2  # three blocks of five frames of two passes
    assert f"{len(samples)} samples are kept" in line
    assert "failed" in set(frames["status"])
    assert "No space left" in record["write_error"]
    assert len(calls) == 4  # nothing further was run


def test_ctrl_c_while_samples_are_stored_waits_for_them(run, tmp_path, monkeypatch, capsys) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    append, calls = run_folder.RunFolder.append_samples, []

    def signalled(self, rows) -> None:
        calls.append(len(rows))
        if len(calls) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        append(self, rows)

    monkeypatch.setattr(run_folder.RunFolder, "append_samples", signalled)
    assert run() == 130
    line = one_line(capsys)
    samples, frames, record = left(tmp_path / "out")
    assert len(samples) == 3 * 5 * 2  # three blocks of five frames of two passes
    assert f"{len(samples)} samples are kept" in line
    assert len(calls) == 3  # nothing further was run
    assert record["interrupted"]
    assert frames["reason"].str.startswith("interrupted after").all()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_while_roofs_are_measured_again(run, tmp_path, monkeypatch, capsys) -> None:
    """After the last frame: all samples are there, and so must the tables be."""
    measure, calls = roofs.measure_roofs, []

    def interrupted(*args):
        calls.append(args)
        if len(calls) == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return measure(*args)

    monkeypatch.setattr(roofs, "measure_roofs", interrupted)
    assert run() == 130
    line = one_line(capsys)
    samples, frames, record = left(tmp_path / "out")
    assert len(calls) == 2
    assert f"{len(samples)} samples are kept" in line
    assert record["finished"]
    assert record["interrupted"]
    assert not record["roofs"]["measured_again"]
    assert frames["frames"].min() > 0
    assert set(frames["status"]) == {"ok"}
    assert frames["reason"].isna().all()
    report = (tmp_path / "out" / "report.md").read_text()
    assert "**Interrupted:**" in report
    assert report.count("not measured again") == len(record["roofs"]["start"])
    assert (tmp_path / "out" / "passes.csv").exists()
    assert gibench.load_run(tmp_path / "out").frames["median_ms"].notna().all()


def test_ctrl_c_while_tables_are_written_waits_for_them(run, tmp_path, monkeypatch, capsys) -> None:
    write = run_folder.RunFolder.write_text

    def signalled(self, name: str, text: str) -> None:
        if name == "passes.csv":
            os.kill(os.getpid(), signal.SIGINT)
        write(self, name, text)

    monkeypatch.setattr(run_folder.RunFolder, "write_text", signalled)
    assert run() == 130
    assert "samples are kept" in one_line(capsys)
    report = (tmp_path / "out" / "report.md").read_text()
    assert "Interrupted" not in report  # nothing is missing
    assert "not measured again" not in report


def test_the_disk_is_full_when_tables_are_written(run, tmp_path, monkeypatch, capsys) -> None:
    def full(path: Path, content: bytes) -> None:
        if path.name in ("passes.csv", "frames.csv"):
            error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            raise run_folder._cannot_write(path, error) from error
        write(path, content)

    write = run_folder.write_atomically
    monkeypatch.setattr(run_folder, "write_atomically", full)
    assert run() == 1
    line = one_line(capsys)
    assert "No space left on device" in line
    assert "80 samples are kept" in line
    assert len(pd.read_csv(tmp_path / "out" / "samples.csv")) == 80
    assert call(["report", str(tmp_path / "out")]) == 0  # the record is there: tables can be made


def _without_twins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled ahead by a second technique: what is counted is a configuration's own."""
    monkeypatch.setattr(Session, "compile", lambda self: None)


def test_an_allocation_that_fails_midway_costs_one_configuration(
    run, tmp_path, monkeypatch, capsys
) -> None:
    buffer, made = cl.Buffer, []

    def failing(*args):
        made.append(1)
        if len(made) == 5:  # the second buffer of the second configuration
            raise cl.MemoryError("MEM_OBJECT_ALLOCATION_FAILURE")
        return buffer(*args)

    _without_twins(monkeypatch)
    monkeypatch.setattr(cl, "Buffer", failing)
    assert run() == 0  # skipped for want of memory: not a failure
    samples, frames, _ = left(tmp_path / "out")
    assert dict(zip(frames["workgroup_size"], frames["status"], strict=True)) == {
        64: "ok",
        128: "skipped",
    }
    assert "cannot allocate" in frames["reason"][1]
    assert set(samples["configuration"]) == {1}
    assert len(samples) == 40


def test_a_launch_that_throws_fails_its_configuration_only(
    run, tmp_path, monkeypatch, capsys
) -> None:
    enqueue, turns = PreparedLaunch.enqueue, []

    def throwing(self, queue):
        if self.local == 128:
            turns.append(1)
            if len(turns) > 7:
                raise cl.RuntimeError("OUT_OF_RESOURCES")
        return enqueue(self, queue)

    _without_twins(monkeypatch)
    monkeypatch.setattr(PreparedLaunch, "enqueue", throwing)
    assert run() == 1
    assert "OUT_OF_RESOURCES" in one_line(capsys)
    samples, frames, _ = left(tmp_path / "out")
    by_size = frames.set_index("workgroup_size")
    assert by_size.loc[64, "status"] == "ok"
    assert by_size.loc[128, "status"] == "failed"
    assert by_size.loc[128, "frames"] == 7
    assert (samples["configuration"] == 2).sum() == 2 * 7


def test_a_run_killed_half_way_is_told_apart_and_may_be_run_again(run, tmp_path, capsys) -> None:
    assert run() == 0
    out = tmp_path / "out"
    record = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps(record | {"finished": False}))
    for name in ("passes.csv", "frames.csv", "report.md"):
        (out / name).unlink()
    assert call(["report", str(out)]) == 2
    assert "never finished" in one_line(capsys)
    assert run() == 0  # the same arguments take the folder over
    assert (out / "report.md").exists()


def test_devices_are_let_go_after_a_fault(run, tmp_path, monkeypatch) -> None:
    alive: list[Device] = []
    import weakref

    create = Device.__init__

    def watched(self, *args, **kwargs):
        create(self, *args, **kwargs)
        alive.append(weakref.ref(self))  # type: ignore[arg-type]

    monkeypatch.setattr(Device, "__init__", watched)
    assert run("--set", "fake.fault=frame") == 1
    assert len(alive) == 2
    assert all(one() is None for one in alive)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("command", [("profiles",), ("scenes",)])
def test_standard_output_that_is_full_is_one_line(command: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(
            [sys.executable, "-m", "gibench", *command],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
        )
    assert ran.returncode == 1
    (line,) = ran.stderr.splitlines()
    assert line.startswith("gibench: the output: cannot be written (No space left")


def test_a_run_into_a_full_file_system_says_so(tmp_path: Path) -> None:
    place = tmp_path / "small"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=20k", "tmpfs", str(place)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a small file system takes root")
    options = ["--technique", "direct", "--receivers", "200", "--resolution", "16x8"]
    more = ["--frames", "3", "--warmup", "0", "--cache-dir", str(tmp_path / "cache"), "-q"]
    out = ["--out", str(place / "out")]
    try:
        ran = subprocess.run(
            [sys.executable, "-m", "gibench", "run", "--no-quality", *options, *more, *out],
            capture_output=True,
            text=True,
            timeout=120,
        )
        kept = pd.read_csv(place / "out" / "samples.csv")
    finally:
        subprocess.run(["umount", str(place)], check=True)
    assert ran.returncode == 1
    (line,) = ran.stderr.splitlines()
    assert "No space left on device" in line
    assert f"{len(kept)} samples are kept" in line
