"""Transport matrices in 32 or 16 bits (see kernels_cl/srp/storage.cl)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.techniques.srp.bake.data import Cluster

Storage = Literal["fp32", "fp16", "snorm16"]
STORAGES: tuple[Storage, ...] = get_args(Storage)

# The largest fp16 value of a row lies in [2^14, 2^15): far from overflow at 65504, and values are
# subnormal, and so stored as 0, only 2^-28 below it.
_FP16_TOP_EXPONENT = 15
_FP16_SMALLEST_NORMAL = 2.0**-14
_SNORM16_MAX = 32767.0


@dataclass(frozen=True)
class StoredCluster:
    """A cluster's matrices as stored.

    Attributes:
        cluster: where they come from.
        projection: (n, k * c) stored values; int16 bits, or float32.
        reconstruction: (m, n) stored values.
        scale: (n,) float32: what a light basis vector is multiplied with to undo the scaling of
            its projection row and its reconstruction column.
    """

    cluster: Cluster
    projection: npt.NDArray[Any]
    reconstruction: npt.NDArray[Any]
    scale: Floats


def storage_dtype(storage: str) -> np.dtype[Any]:
    """Type of an array of stored values."""
    return np.dtype(np.float32 if storage == "fp32" else np.int16)


def storage_bytes(storage: str) -> int:
    """Bytes of a stored value."""
    return storage_dtype(storage).itemsize


def storage_macro(storage: str) -> str:
    """What the kernels' macro STORAGE is defined as."""
    return f"STORAGE_{storage.upper()}"


def store_cluster(cluster: Cluster, storage: str) -> StoredCluster:
    """Store a cluster's matrices as ``fp32``, ``fp16`` or ``snorm16``."""
    projection, row_scale = _store_rows(cluster.projection, storage)
    reconstruction, column_scale = _store_rows(cluster.reconstruction.T, storage)
    return StoredCluster(
        cluster,
        projection,
        np.ascontiguousarray(reconstruction.T),
        (row_scale * column_scale).astype(np.float32),
    )


def stored_values(stored: npt.NDArray[Any], storage: str) -> npt.NDArray[np.float64]:
    """The numbers that stored values of any shape mean, before scaling."""
    if storage == "fp16":
        return stored.view(np.float16).astype(np.float64)
    return stored.astype(np.float64)


def _store_rows(
    matrix: npt.NDArray[Any], storage: str
) -> tuple[npt.NDArray[Any], npt.NDArray[np.float64]]:
    """Stored values and the factor (rows,) that each row of them is to be multiplied with."""
    if storage == "fp32":
        return np.ascontiguousarray(matrix, np.float32), np.ones(len(matrix))
    largest = np.abs(matrix).max(axis=1, initial=0.0).astype(np.float64)
    largest[largest == 0] = 1.0
    if storage == "fp16":
        _, exponent = np.frexp(largest)
        scale = np.exp2(exponent.astype(np.float64) - _FP16_TOP_EXPONENT)
        values = matrix / scale[:, None]
        values[np.abs(values) < _FP16_SMALLEST_NORMAL] = 0.0
        return np.ascontiguousarray(values.astype(np.float16)).view(np.int16), scale
    scale = largest / _SNORM16_MAX
    return np.rint(matrix / scale[:, None]).astype(np.int16), scale
