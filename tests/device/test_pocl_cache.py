"""PoCL's kernel cache: full, unusable and torn ones are told before they end the process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from gibench.device import pocl_cache
from gibench.device.pocl_cache import (
    cache_folder,
    is_whole_bitcode,
    is_whole_library,
    torn_entry,
)

RUNS = """
import pyopencl as cl
from gibench.device import Device
device = Device.unlimited()
source = "__kernel void f(__global int *a) { a[get_global_id(0)] = 1; }"
kernel = cl.Program(device.context, source).build().f
kernel(device.queue, (16,), None, cl.Buffer(device.context, cl.mem_flags.READ_WRITE, 64))
device.queue.finish()
"""


def started(environment: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    """The command line in a process of its own; ``devices`` compiles a kernel."""
    return subprocess.run(
        [sys.executable, "-m", "gibench", "devices"],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **environment},
    )


def one_line(ran: subprocess.CompletedProcess[str]) -> str:
    assert ran.returncode == 3, ran.stderr
    (line,) = ran.stderr.splitlines()
    return line


def test_where_the_cache_lies() -> None:
    assert cache_folder({"POCL_CACHE_DIR": "/a", "HOME": "/b"}) == Path("/a")
    assert cache_folder({"XDG_CACHE_HOME": "/a", "HOME": "/b"}) == Path("/a/pocl/kcache")
    assert cache_folder({"HOME": "/b"}) == Path("/b/.cache/pocl/kcache")


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that PoCL has filled and that nothing has looked at since."""
    folder = tmp_path_factory.mktemp("kcache")
    environment = {**os.environ, "POCL_CACHE_DIR": str(folder)}
    subprocess.run([sys.executable, "-c", RUNS], check=True, env=environment, timeout=120)
    return folder


def _aged(folder: Path) -> Iterator[Path]:
    """Its compiled files, as if they had been there for a while."""
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".bc", ".so"):
            os.utime(path, (time.time() - 60, time.time() - 60))
            yield path


def test_what_pocl_writes_is_whole_and_any_part_of_it_is_not(filled: Path, tmp_path: Path) -> None:
    files = list(_aged(filled))
    assert {path.suffix for path in files} == {".bc", ".so"}
    assert torn_entry(filled) is None
    for path in files:
        whole = is_whole_bitcode if path.suffix == ".bc" else is_whole_library
        data = path.read_bytes()
        part = tmp_path / path.name
        for length in (0, 3, 100, len(data) // 2, len(data) - 1):
            part.write_bytes(data[:length])
            assert not whole(part), (path, length)


@pytest.mark.parametrize("suffix", [".so", ".bc"])
def test_a_torn_entry_is_named_before_pocl_reads_it(filled: Path, suffix: str) -> None:
    torn = [path for path in _aged(filled) if path.suffix == suffix][-1]
    data = torn.read_bytes()
    torn.write_bytes(data[: len(data) // 2])
    os.utime(torn, (time.time() - 30, time.time() - 30))
    (filled / pocl_cache._STAMP).unlink(missing_ok=True)
    try:
        line = one_line(started({"POCL_CACHE_DIR": str(filled)}))
    finally:
        torn.write_bytes(data)
    assert str(torn) in line
    assert f"rm -r '{filled}'" in line
    assert started({"POCL_CACHE_DIR": str(filled)}).returncode == 0


@pytest.mark.parametrize("suffix", [".so", ".bc"])
def test_what_another_process_is_writing_is_not_damaged(tmp_path: Path, suffix: str) -> None:
    """PoCL makes an empty file and compiles for seconds before it fills and renames it."""
    hour_ago = time.time() - 3600
    for name, torn in (("tempfile_8ahB59", False), ("kernel", True)):
        path = tmp_path / f"{name}{suffix}"
        path.touch()
        os.utime(path, (hour_ago, hour_ago))
        assert torn_entry(tmp_path) == (path if torn else None)


def test_only_what_is_new_is_looked_at_again(filled: Path) -> None:
    path = next(_aged(filled))
    data = path.read_bytes()
    path.write_bytes(b"")
    os.utime(path, (time.time() - 60, time.time() - 60))
    try:
        assert torn_entry(filled) == path
        assert torn_entry(filled, time.time() - 30) is None
        path.touch()  # another process may be writing it
        assert torn_entry(filled, time.time() - 30) is None
    finally:
        path.write_bytes(data)


def test_a_cache_that_is_no_folder(tmp_path: Path) -> None:
    place = tmp_path / "file"
    place.write_text("")
    line = one_line(started({"POCL_CACHE_DIR": str(place)}))
    assert str(place) in line
    assert "POCL_CACHE_DIR" in line
    line = one_line(started({"XDG_CACHE_HOME": str(place), "POCL_CACHE_DIR": str(tmp_path / "k")}))
    assert "pyopencl's cache cannot be written" in line


def test_a_full_disk(tmp_path: Path) -> None:
    place = tmp_path / "full"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("mounting a small file system takes root")
    try:
        line = one_line(started({"POCL_CACHE_DIR": str(place)}))
    finally:
        subprocess.run(["umount", str(place)], check=True)
    assert "No space left on device" in line
    assert str(place) in line
