"""Plain data as bytes for another process: large arrays apart, each known by its content."""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

LARGE = 1 << 16
"""Bytes from which an array goes apart. Smaller ones are sooner sent again than looked up."""


@dataclass(frozen=True)
class Packed:
    """A value as bytes.

    Attributes:
        body: all but its large arrays.
        parts: these, by SHA-256 of their bytes. A scene's arrays are the same parts in whatever
            value they stand, so that who has them does not need them again.
        digest: SHA-256 of the body, which names its parts.
    """

    body: bytes = field(repr=False)
    parts: Mapping[str, bytes] = field(repr=False)
    digest: str

    @property
    def size(self) -> int:
        """Bytes in all."""
        return len(self.body) + sum(map(len, self.parts.values()))


def packed(value: Any) -> Packed:
    """``value`` as bytes."""
    body = io.BytesIO()
    packer = _Packer(body)
    packer.dump(value)
    content = body.getvalue()
    return Packed(content, packer.parts, digest_of(content))


def unpacked(body: bytes, parts: Mapping[str, bytes]) -> Any:
    """The value of :func:`packed`."""
    return _Unpacker(io.BytesIO(body), parts).load()


def digest_of(content: bytes) -> str:
    """SHA-256, hexadecimal."""
    return hashlib.sha256(content).hexdigest()


class _Packer(pickle.Pickler):
    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=5)
        self.parts: dict[str, bytes] = {}
        self._known: dict[int, tuple[Any, str]] = {}

    def persistent_id(self, obj: Any) -> str | None:
        """The digest of a large array; None of all else."""
        if type(obj) is not np.ndarray or obj.nbytes < LARGE or obj.dtype.hasobject:
            return None
        if id(obj) not in self._known:
            content = pickle.dumps(obj, protocol=5)
            self._known[id(obj)] = obj, digest_of(content)  # held: its id stays its own
            self.parts[self._known[id(obj)][1]] = content
        return self._known[id(obj)][1]


class _Unpacker(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, parts: Mapping[str, bytes]) -> None:
        super().__init__(file)
        self._parts = parts
        self._made: dict[str, Any] = {}

    def persistent_load(self, pid: str) -> Any:
        """The array of a digest, the same one each time."""
        if pid not in self._made:
            self._made[pid] = pickle.loads(self._parts[pid])
        return self._made[pid]
