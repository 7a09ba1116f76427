"""The memory that a traced kernel works in: every buffer on pages of its own, none beside them."""

from __future__ import annotations

import ctypes
import mmap
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gibench.arrays import Longs

_NO_ACCESS = 0


class Arena:
    """One stretch of memory with places in it; what lies between the places cannot be touched, so
    that a kernel that leaves its buffers by more than a page's rest faults.

    Args:
        sizes: bytes of every place.

    Attributes:
        address: of the stretch.
        nbytes: of the stretch.
        starts: address of every place (n,), int64.
        ends: address behind every place (n,), int64.
    """

    def __init__(self, sizes: Sequence[int]) -> None:
        page = mmap.PAGESIZE
        pages = [-(-max(size, 1) // page) for size in sizes]
        self.nbytes = (sum(pages) + len(pages) + 1) * page
        self._map = mmap.mmap(-1, self.nbytes)
        self._bytes = np.frombuffer(self._map, np.uint8)
        self.address = int(self._bytes.ctypes.data)
        places = np.cumsum([1, *(count + 1 for count in pages)])[: len(pages)]
        self.starts: Longs = self.address + places.astype(np.int64) * page
        self.ends: Longs = self.starts + np.array(sizes, np.int64)
        libc = ctypes.CDLL(None, use_errno=True)
        between = [self.address, *(self.starts + np.array(pages, np.int64) * page).tolist()]
        for guard in between:
            libc.mprotect(ctypes.c_void_p(guard), ctypes.c_size_t(page), _NO_ACCESS)

    def view(self, place: int) -> npt.NDArray[np.uint8]:
        """The bytes of a place."""
        start = int(self.starts[place]) - self.address
        return self._bytes[start : start + int(self.ends[place] - self.starts[place])]
