"""The resumable store of a bake: a folder a stage, one checksummed file a unit.

Layout beneath the folder that :class:`BakeStore` is given::

    <stage>-<key>/         the key's first 20 hexadecimal digits
      manifest.json        the whole key, what it was made from, for people to read
      <unit>.bin           the arrays of a unit
      seconds              wall time that computing it has taken
      <unit>.claim         locked by the run that is computing the unit

A ``.bin`` file is ``GIBENCH1``, the SHA-256 of what follows, then an uncompressed NumPy ``.npz``.
Files appear whole or not at all (:func:`gibench.files.write_whole`). Whatever is missing or fails
its checksum is baked again; nothing else is.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from filelock import FileLock, Timeout

from gibench.bake.stage import Arrays, Stage
from gibench.errors import BadInput, CannotRun
from gibench.files import remove_unfinished, write_whole

MAGIC = b"GIBENCH1"


class BakeStore:
    """Named groups of arrays beneath ``folder/<name>-<key>``. Used by one thread at a time.

    Args:
        folder: where stores are kept; made if missing.
        name: of the stage.
        key: content key, hexadecimal: same key, same content.
        made_from: what the key stands for, for people to read.

    Raises:
        BadInput: the folder cannot be made or written.
    """

    def __init__(self, folder: Path, name: str, key: str, made_from: Mapping[str, Any]) -> None:
        self.path = Path(folder) / f"{name}-{key[:20]}"
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(self.path, error) from error
        self._manifest = {"stage": name, "key": key, **made_from}
        self._claims: dict[str, FileLock] = {}

    @staticmethod
    def of(folder: Path, stage: Stage) -> BakeStore:
        """The store of ``stage`` beneath ``folder``."""
        return BakeStore(folder, stage.name, stage.key, dict(stage.made_from))

    def __enter__(self) -> BakeStore:
        return self

    def __exit__(self, *error: object) -> None:
        """Let go of every claim."""
        for name in list(self._claims):
            self.release(name)

    def claim(self, name: str) -> bool:
        """Whether unit ``name`` is ours to compute from now on; not while another run has it.

        The operating system drops the claims of a run that dies. Look for the unit again after
        claiming it: another run may have stored it just before.

        Raises:
            BadInput: the folder cannot be written.
        """
        lock = self._lock(name)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            return False
        except OSError as error:
            raise _unwritable(self.path, error) from error
        self._claims[name] = lock
        remove_unfinished(self.path / name)
        return True

    def release(self, name: str) -> None:
        """Let go of the claim on unit ``name``.

        The file goes with it. A run that had it open then holds a lock that no longer keeps
        others out: at worst a unit is computed twice, with the same result.
        """
        lock = self._claims.pop(name)
        Path(lock.lock_file).unlink(missing_ok=True)
        lock.release()

    def is_free(self, name: str) -> bool:
        """Whether nobody is computing unit ``name``: it is stored, or there to be claimed."""
        lock = self._lock(name)
        if not Path(lock.lock_file).exists():
            return True
        try:
            lock.acquire(timeout=0)
        except Timeout:
            return False
        lock.release()
        return True

    def _lock(self, name: str) -> FileLock:
        return FileLock(self.path / f"{name}.claim", thread_local=False)

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Write ``arrays`` as ``name`` at once and for good.

        Raises:
            CannotRun: the disk is full.
            BadInput: the folder cannot be written.
        """
        if not (self.path / "manifest.json").exists() and self.claim("manifest"):
            self._write("manifest.json", json.dumps(self._manifest, indent=2).encode())
            self.release("manifest")
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

    def add_seconds(self, seconds: float) -> None:
        """Add to the wall time that computing this stage has taken so far.

        Raises:
            CannotRun: the disk is full.
            BadInput: the folder cannot be written.
        """
        self._write("seconds", f"{self.seconds() + seconds:.6f}".encode())

    def seconds(self) -> float:
        """Wall time that computing this stage has taken, s, by all runs together; 0 where nothing
        tells.
        """
        try:
            return float((self.path / "seconds").read_text())
        except (OSError, ValueError):
            return 0.0

    def remove(self, names: Iterable[str]) -> None:
        """Remove units, but for those that another run is computing."""
        for name in names:
            if (self.path / f"{name}.bin").exists() and self.claim(name):
                (self.path / f"{name}.bin").unlink(missing_ok=True)
                self.release(name)

    def _write(self, name: str, content: bytes) -> None:
        try:
            write_whole(self.path / name, content)
        except OSError as error:
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
