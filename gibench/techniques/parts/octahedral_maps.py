"""Octahedral maps: a square of texels with a value for every direction.

The mapping as ``kernels_cl/common/octahedral.cl`` has it, and maps on a device, one per probe, as
``kernels_cl/parts/octahedral_maps.cl`` reads them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.device import Buffer, BufferSpec, Launch, ProgramSpec, integer, updates

STORED: dict[str, np.dtype[Any]] = {"fp32": np.dtype("f4"), "fp16": np.dtype("f2")}
"""How a map's values may be stored."""


@dataclass(frozen=True)
class OctahedralMaps:
    """Maps of one kind, a map per probe, each with a border of one texel.

    Attributes:
        side: texels of a map's side without its border.
        channels: values of a texel; a texel fills whole 32-bit words.
        storage: a key of :data:`STORED`.
    """

    side: int
    channels: int
    storage: str = "fp32"

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of a value."""
        return STORED[self.storage]

    @property
    def texels(self) -> int:
        """Texels of a map without its border."""
        return self.side**2

    def buffer(self, name: str, probes: int) -> BufferSpec:
        """The maps of ``probes`` probes, borders counted: (p, side + 2, side + 2, channels)."""
        shape = (probes, self.side + 2, self.side + 2, self.channels)
        return BufferSpec.of(name, shape, self.dtype)

    def border_bytes_of(self, probes: int) -> int:
        """Bytes of the borders of ``probes`` maps."""
        return probes * 4 * (self.side + 1) * self.channels * self.dtype.itemsize

    def border_copy(self, maps: Buffer, first: int = 0, probes: int | None = None) -> Launch:
        """The launch that copies borders from the texels they repeat (Majercik et al. 2019).

        Args:
            maps: that lie in a buffer.
            first: texel of the buffer that they begin with.
            probes: how many they are of; by default as many as the buffer has rows.
        """
        probes = maps.shape[0] if probes is None else probes
        args = (
            updates("maps", maps),
            integer("first", first),
            integer("probes", probes),
            integer("side", self.side),
            integer("words", self.channels * self.dtype.itemsize // 4),
        )
        program = ProgramSpec("parts/border_copy.cl")
        return Launch(program, "border_copy", args, items=probes * 4 * (self.side + 1))


def octahedral_decode(square: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Unit directions (n, 3) of points (n, 2) in [-1, 1]^2 (Cigolle et al. 2014)."""
    p = np.asarray(square, np.float64)
    z = 1.0 - np.abs(p).sum(axis=1)
    folded = (1.0 - np.abs(p[:, ::-1])) * np.where(p >= 0, 1.0, -1.0)
    xy = np.where((z >= 0)[:, None], p, folded)
    d = np.concatenate([xy, z[:, None]], axis=1)
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))
