"""PoCL's kernel cache, looked at before PoCL itself does.

PoCL 3.0 ends the whole process where it cannot write its cache, or where what it reads there is not
whole (``Aborted``, no exception). Files are left torn by a disk that was full and by processes that
were killed. Here both are found first and told in one line.
"""

from __future__ import annotations

import os
import struct
import tempfile
import time
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import platformdirs

from gibench.errors import CannotRun

ROOM = 4 << 20
"""Bytes that must be free: more than all kernels of one technique take."""
_STAMP = ".gibench-checked"
# A file younger than this may still be being written by another process.
_YOUNG_S = 2.0
_ELF_HEADER = struct.Struct("<16sHHIQQQIHHHHHH")
_BITCODE = b"BC\xc0\xde"
# What PoCL is still writing, in whichever process: it is given its name once it is whole, and
# nothing reads it before (``pocl_mk_tempname``). A busy compiler takes longer than _YOUNG_S.
_UNFINISHED = "tempfile_"
# Nothing that PoCL writes lies deeper than <two letters>/<hash>/<kernel>/<sizes>/<kernel>.so.
_DEPTH = 5


def cache_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Where PoCL keeps compiled kernels (``pocl_cache_init_topdir``)."""
    if given := environment.get("POCL_CACHE_DIR"):
        return Path(given)
    if given := environment.get("XDG_CACHE_HOME"):
        return Path(given) / "pocl" / "kcache"
    if given := environment.get("HOME"):
        return Path(given) / ".cache" / "pocl" / "kcache"
    return Path(tempfile.gettempdir()) / "pocl" / "kcache"


def check_cache(cl_device: Any) -> None:
    """Find out whether a device's compiler can use its cache; other platforms than PoCL can.

    Raises:
        CannotRun: it cannot be written, the disk is full, or an entry is torn.
    """
    if "Portable" in cl_device.platform.name:
        check_folder(cache_folder())
        _check_pyopencl_cache()


@cache
def check_folder(folder: Path) -> None:
    """Find out whether ``folder`` can serve as PoCL's cache; a process asks once.

    Raises:
        CannotRun: it cannot be written, the disk is full, or an entry is torn.
    """
    mend = "free some space, clear it, or name another with POCL_CACHE_DIR"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".gibench-") as file:
            file.write(bytes(ROOM))
            file.flush()
    except OSError as error:
        raise CannotRun(
            f"PoCL's kernel cache cannot be written ({error.strerror or error})",
            where=folder,
            mend=mend,
        ) from error
    began = time.time()
    if (torn := torn_entry(folder, _last_checked(folder))) is not None:
        raise CannotRun(
            "this entry of PoCL's kernel cache is damaged and would end the process",
            where=torn,
            mend=f"clear the cache, which kernels are then built into anew: rm -r '{folder}'",
        )
    stamp = folder / _STAMP
    stamp.touch()
    os.utime(stamp, (began - _YOUNG_S, began - _YOUNG_S))


def torn_entry(folder: Path, since: float = 0.0) -> Path | None:
    """A compiled file in ``folder`` that is not whole, or None.

    Args:
        folder: PoCL's cache.
        since: files changed before are not looked at again, seconds since the epoch.
    """
    now = time.time()
    for path, changed in _files(os.fspath(folder), _DEPTH):
        if since <= changed < now - _YOUNG_S or changed > now:
            whole = is_whole_bitcode if path.endswith(".bc") else is_whole_library
            if not whole(Path(path)):
                return Path(path)
    return None


def is_whole_library(path: Path) -> bool:
    """Whether a shared object's tables lie within it; a 32-bit one is not looked into."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_ELF_HEADER.size)
    except FileNotFoundError:  # cleared by another process
        return True
    if len(head) < _ELF_HEADER.size or head[:4] != b"\x7fELF":
        return False
    if head[4] != 2:
        return True
    fields = _ELF_HEADER.unpack(head)
    programs, sections = fields[5], fields[6]
    program_size, program_count, section_size, section_count = fields[9:13]
    ends = programs + program_size * program_count, sections + section_size * section_count
    return bool(max(ends) <= size)


def is_whole_bitcode(path: Path) -> bool:
    """Whether a bitcode file is a row of whole blocks (LLVM, "LLVM Bitcode File Format": a block
    at top level begins with ENTER_SUBBLOCK, aligned, then its length in words).
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return True
    if data[:4] != _BITCODE or len(data) % 4:
        return False
    at = 4
    while at < len(data):
        if len(data) - at < 8 or data[at] & 3 != 1:
            return False
        at += 8 + 4 * int.from_bytes(data[at + 4 : at + 8], "little")
    return at == len(data) > 4


def _last_checked(folder: Path) -> float:
    try:
        return (folder / _STAMP).stat().st_mtime
    except OSError:
        return 0.0


def _files(folder: str, depth: int) -> Iterator[tuple[str, float]]:
    """Compiled files beneath ``folder`` and when they changed."""
    try:
        entries = list(os.scandir(folder))
    except OSError:  # cleared by another process, or not ours to read
        return
    for entry in entries:
        if entry.is_dir(follow_symlinks=False):
            if depth:
                yield from _files(entry.path, depth - 1)
        elif entry.name.endswith((".bc", ".so")) and not entry.name.startswith(_UNFINISHED):
            try:
                yield entry.path, entry.stat().st_mtime
            except FileNotFoundError:
                continue


@cache
def _check_pyopencl_cache() -> None:
    """pyopencl keeps code of its own, without which it fails where a kernel is first made."""
    if os.environ.get("PYOPENCL_NO_CACHE"):
        return
    folder = Path(platformdirs.user_cache_dir("pytools", "pytools"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise CannotRun(
            f"pyopencl's cache cannot be written ({error.strerror or error})",
            where=folder,
            mend="name another folder with XDG_CACHE_HOME, or set PYOPENCL_NO_CACHE=1",
        ) from error
