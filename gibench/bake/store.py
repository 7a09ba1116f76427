"""The resumable store of an SRP bake: one checksummed file per unit of work.

Layout beneath the folder that :class:`BakeStore` is given::

    <key>/                 the first 20 hexadecimal digits of the content key
      manifest.json        format version, the whole key, what it was made from, for people to read
      lock                 held by the run that is baking
      probes.bin           probe positions, radius, overlap
      relight.bin          relight samples
      cluster-00000.bin    the compressed cluster, or refined clusters, of one AABB leaf

A ``.bin`` file is ``GIBENCH1``, the SHA-256 of what follows, then an uncompressed NumPy ``.npz``.
Files appear whole or not at all: they are written under a temporary name, flushed to the disk and
renamed. Whatever is missing or fails its checksum is baked again; nothing else is.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from filelock import FileLock, Timeout

from gibench.errors import BadInput, CannotRun
from gibench.progress import progress

# Raised whenever what is baked, or how it is stored, changes.
FORMAT_VERSION = 3
MAGIC = b"GIBENCH1"

Arrays = dict[str, npt.NDArray[Any]]


class BakeStore:
    """Named groups of arrays beneath ``folder/<key>``.

    Args:
        folder: where stores are kept; made if missing.
        key: content key, hexadecimal: same key, same content.
        made_from: what the key stands for, for people to read.

    Raises:
        BadInput: the folder cannot be made or written.
    """

    def __init__(self, folder: Path, key: str, made_from: Mapping[str, Any]) -> None:
        self.path = Path(folder) / key[:20]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(self.path, error) from error
        self._manifest = {"format": FORMAT_VERSION, "key": key, **made_from}

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the store: a second run of the same bake waits here, then finds it done.

        The operating system drops the lock of a run that dies.
        """
        lock = FileLock(self.path / "lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            with progress("Waiting for another run that bakes the same"):
                lock.acquire()
        except OSError as error:
            raise _unwritable(self.path, error) from error
        try:
            self._sweep()
            if not (self.path / "manifest.json").exists():
                self._write("manifest.json", json.dumps(self._manifest, indent=2).encode())
            yield
        finally:
            lock.release()

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Write ``arrays`` as ``name`` at once and for good.

        Raises:
            CannotRun: the disk is full.
            BadInput: the folder cannot be written.
        """
        body = io.BytesIO()
        np.savez(body, allow_pickle=False, **arrays)
        payload = body.getvalue()
        self._write(f"{name}.bin", MAGIC + hashlib.sha256(payload).digest() + payload)

    def load(self, name: str) -> Arrays | None:
        """The arrays saved as ``name``; None when there are none or they are damaged."""
        try:
            data = (self.path / f"{name}.bin").read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise _unwritable(self.path, error) from error
        head = len(MAGIC) + hashlib.sha256().digest_size
        payload = data[head:]
        if data[:head] != MAGIC + hashlib.sha256(payload).digest():
            return None
        with np.load(io.BytesIO(payload), allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}

    def nbytes(self) -> int:
        """Bytes the store takes on disk."""
        return sum(file.stat().st_size for file in self.path.glob("*.bin"))

    def _sweep(self) -> None:
        """Remove temporary files of runs that were killed; we hold the lock, so none is alive."""
        for leftover in self.path.glob("*.tmp"):
            leftover.unlink(missing_ok=True)

    def _write(self, name: str, content: bytes) -> None:
        temporary = None
        try:
            handle, temporary = tempfile.mkstemp(suffix=".tmp", dir=self.path)
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(temporary).replace(self.path / name)
        except OSError as error:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)
            raise _unwritable(self.path, error) from error


def _unwritable(path: Path, error: OSError) -> BadInput | CannotRun:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return CannotRun(
            "the disk is full; what is baked so far is kept and a rerun goes on from there",
            where=path,
            mend="free some space or move the cache with --cache-dir",
        )
    return BadInput(
        f"the bake cannot be stored here ({error.strerror})",
        where=path,
        mend="choose a folder that can be written with --cache-dir",
    )
