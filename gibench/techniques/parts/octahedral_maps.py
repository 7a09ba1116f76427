"""The octahedral map of directions, as ``kernels_cl/common/octahedral.cl`` has it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def octahedral_decode(square: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Unit directions (n, 3) of points (n, 2) in [-1, 1]^2 (Cigolle et al. 2014)."""
    p = np.asarray(square, np.float64)
    z = 1.0 - np.abs(p).sum(axis=1)
    folded = (1.0 - np.abs(p[:, ::-1])) * np.where(p >= 0, 1.0, -1.0)
    xy = np.where((z >= 0)[:, None], p, folded)
    d = np.concatenate([xy, z[:, None]], axis=1)
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


def octahedral_cells(directions: npt.NDArray[Any], grid: int) -> npt.NDArray[np.int64]:
    """The cell (row * grid + column) of each direction (n, 3)."""
    d = np.asarray(directions, np.float64)
    d = d / np.abs(d).sum(axis=1, keepdims=True)
    folded = (1.0 - np.abs(d[:, 1::-1])) * np.where(d[:, :2] >= 0, 1.0, -1.0)
    p = np.where((d[:, 2] >= 0)[:, None], d[:, :2], folded)
    at = np.clip(((p * 0.5 + 0.5) * grid).astype(np.int64), 0, grid - 1)
    return np.asarray(at[:, 1] * grid + at[:, 0])
