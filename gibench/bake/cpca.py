"""Clustered principal component analysis of transport (Sloan et al. 2003; thesis 4.5, 5.6.6)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from gibench.bake.srp_data import Cluster
from gibench.scene.model import Floats, Ints


def aabb_clusters(positions: Floats, most: int) -> list[Ints]:
    """Clusters of receiver ``positions`` (n, 3), each of at most ``most``, as ascending indices.

    The bounding box of the receivers is cut in half across its longest axis, and so is each
    half's own bounding box, until few enough are left (thesis 5.6.6). Receivers that coincide, so
    that no cut separates them, are split by index.
    """
    done: list[Ints] = []
    waiting = [np.arange(len(positions), dtype=np.int32)]
    while waiting:
        members = waiting.pop()
        if len(members) <= most:
            if len(members):
                done.append(members)
            continue
        inside = positions[members].astype(np.float64)
        low, high = inside.min(axis=0), inside.max(axis=0)
        axis = int(np.argmax(high - low))
        left = inside[:, axis] < 0.5 * (low[axis] + high[axis])
        if left.all() or not left.any():
            left = np.arange(len(members)) < len(members) // 2
        waiting += [members[~left], members[left]]
    return done


def truncated_svd(
    matrix: npt.NDArray[Any], most: int, threshold: float
) -> tuple[Floats, Floats, float]:
    """``matrix`` (m, k) as reconstruction (m, n) @ projection (n, k) with the fewest vectors.

    n is the smallest number, at most ``most``, for which the relative Frobenius error
    ||T - U S V^T|| / ||T|| = sqrt(sum_{i >= n} s_i^2 / sum_i s_i^2) is at most ``threshold``: the
    root mean square error of the cluster's coefficients relative to their own root mean square,
    which is how the paper's threshold of 0.005 is read here. The singular vectors come from the
    eigenvectors of the smaller Gram matrix in float64: singular values are then accurate to
    about 1e-8 of the largest, far below any threshold.

    Returns:
        U (m, n) float32, S V^T (n, k) float32, the relative Frobenius error.
    """
    t = np.asarray(matrix, np.float64)
    rows, columns = t.shape
    wide = columns >= rows
    gram = t @ t.T if wide else t.T @ t
    total = float(np.trace(gram))
    none = np.zeros((rows, 0), np.float32), np.zeros((0, columns), np.float32), 0.0
    if not total > 0:
        return none
    size = len(gram)
    values, vectors = eigh(gram, subset_by_index=(max(0, size - most), size - 1), driver="evr")
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    left_over = np.maximum(total - np.cumsum(values), 0.0)
    enough = np.flatnonzero(left_over <= threshold**2 * total)
    count = int(enough[0]) + 1 if len(enough) else len(values)
    vectors = vectors[:, :count]
    if wide:
        u, projection = vectors, vectors.T @ t
    else:
        # U = T V / S and S V^T; directions of no energy are left out above by `count` or are null.
        s = np.sqrt(values[:count])
        u = np.divide(t @ vectors, s, out=np.zeros((rows, count)), where=s > 1e-12 * s[0])
        projection = s[:, None] * vectors.T
    error = float(np.sqrt(left_over[count - 1] / total))
    return u.astype(np.float32), projection.astype(np.float32), error


def compress(
    receivers: Ints, probes: Ints, matrix: Floats, coefficients: int, most: int, threshold: float
) -> Cluster:
    """One cluster's transport ``matrix`` (m, k * coefficients), compressed.

    The blocks of probes that no receiver of the cluster uses are dropped first.
    """
    blocks = matrix.reshape(len(receivers), len(probes), coefficients)
    used = np.flatnonzero(blocks.any(axis=(0, 2)))
    kept = blocks[:, used].reshape(len(receivers), -1)
    u, projection, error = truncated_svd(kept, most, threshold)
    return Cluster(receivers.astype(np.int32), probes[used].astype(np.int32), projection, u, error)
