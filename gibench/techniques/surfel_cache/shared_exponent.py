"""Three channels in 32 bits: as kernels_cl/surfel_cache/shared_exponent.cl has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.device.build import Define

MOST: Final = 65408.0
"""The largest value: (2^9 - 1) 2^7."""
SHARED_MACROS: Final[Mapping[str, Define]] = {"SHARED_MOST": MOST}
"""Of every program that includes kernels_cl/surfel_cache/shared_exponent.cl."""
LEAST_STEP: Final = 2.0**-24
"""Between the smallest values."""


def encode(values: npt.NDArray[Any]) -> npt.NDArray[np.uint32]:
    """Values (n, 3) as 32 bits each (EXT_texture_shared_exponent); NaN as 0."""
    v = np.clip(np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=MOST), 0.0, MOST)
    largest = v.max(axis=1)
    with np.errstate(divide="ignore"):
        exponent = np.maximum(-16, np.floor(np.log2(largest))) + 16
    exponent += np.floor(largest * 2.0 ** (24 - exponent) + 0.5) > 511
    mantissa = np.floor(v * 2.0 ** (24 - exponent)[:, None] + 0.5).astype(np.uint32)
    high = exponent.astype(np.uint32) << 27
    return np.asarray(mantissa[:, 0] | mantissa[:, 1] << 9 | mantissa[:, 2] << 18 | high)


def decode(bits: npt.NDArray[Any]) -> Doubles:
    """What 32 bits (n,) stand for, (n, 3)."""
    bits = np.asarray(bits, np.uint32)
    mantissa = np.stack([bits & 511, bits >> 9 & 511, bits >> 18 & 511], axis=1)
    return np.asarray(mantissa * 2.0 ** ((bits >> 27).astype(np.int64) - 24)[:, None])
