"""What a buffer holds, said before there is one: everything about memory comes from this."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class BufferSpec:
    """A buffer as it is declared.

    Attributes:
        name: what it holds; unique within its group in the ledger.
        shape: logical shape.
        dtype: element type.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @staticmethod
    def of(name: str, shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> BufferSpec:
        """A declaration from a shape, or a length, and anything NumPy takes for a type."""
        shape = (shape,) if isinstance(shape, int) else tuple(int(n) for n in shape)
        return BufferSpec(name, shape, np.dtype(dtype))

    @staticmethod
    def like(name: str, array: npt.NDArray[Any]) -> BufferSpec:
        """The declaration of a buffer that holds ``array``."""
        return BufferSpec(name, array.shape, array.dtype)

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return int(np.prod(self.shape, dtype=np.int64)) * self.dtype.itemsize


def total_bytes(specs: Iterable[BufferSpec]) -> int:
    """Bytes of all ``specs`` together."""
    return sum(spec.nbytes for spec in specs)


def largest(specs: Iterable[BufferSpec]) -> int:
    """Bytes of the largest of ``specs``; 0 where there is none."""
    return max((spec.nbytes for spec in specs), default=0)
