"""Clustered principal component analysis of transport (Sloan et al. 2003; thesis 4.5, 5.6.6)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from gibench.bake.srp_data import Cluster
from gibench.scene.model import Floats, Ints

# A cluster is not refined below this many receivers: the projection matrix would outgrow what its
# receivers' rows take uncompressed.
SMALLEST_REFINED = 64


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
        if len(members) > most:
            left = halve(positions[members])
            waiting += [members[~left], members[left]]
        elif len(members):
            done.append(members)
    return done


def halve(positions: Floats) -> npt.NDArray[np.bool_]:
    """(n,) which ``positions`` (n, 3) lie in the lower half of their box, by its longest axis."""
    p = positions.astype(np.float64)
    low, high = p.min(axis=0), p.max(axis=0)
    axis = int(np.argmax(high - low))
    left = p[:, axis] < 0.5 * (low[axis] + high[axis])
    if left.all() or not left.any():
        left = np.arange(len(p)) < len(p) // 2
    return np.asarray(left)


def truncated_svd(
    matrix: npt.NDArray[Any],
    most: int,
    threshold: float,
    gram: npt.NDArray[np.float64] | None = None,
) -> tuple[Floats, Floats, float]:
    """``matrix`` (m, k) as reconstruction (m, n) @ projection (n, k) with the fewest vectors.

    n is the smallest number, at most ``most``, for which the relative Frobenius error
    ||T - U S V^T|| / ||T|| = sqrt(sum_{i >= n} s_i^2 / sum_i s_i^2) is at most ``threshold``: the
    root mean square error of the cluster's coefficients relative to their own root mean square,
    which is how the paper's threshold of 0.005 is read here. The left singular vectors are the
    eigenvectors of T T^T in float64, so that errors down to 1e-7 are told apart, far below any
    threshold of use; S V^T = U^T T.

    Args:
        matrix: T.
        most: most vectors.
        threshold: relative Frobenius error at which fewer are enough.
        gram: T T^T, where the caller has it.

    Returns:
        U (m, n) float32, S V^T (n, k) float32, the relative Frobenius error.
    """
    t = np.asarray(matrix, np.float64)
    size = len(t)
    gram = t @ t.T if gram is None else gram
    total = float(np.trace(gram))
    if not total > 0:
        return np.zeros((size, 0), np.float32), np.zeros((0, t.shape[1]), np.float32), 0.0
    values, vectors = eigh(gram, subset_by_index=(max(0, size - most), size - 1), driver="evr")
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    left_over = np.maximum(total - np.cumsum(values), 0.0)
    enough = np.flatnonzero(left_over <= threshold**2 * total)
    count = int(enough[0]) + 1 if len(enough) else len(values)
    u = vectors[:, :count]
    error = float(np.sqrt(left_over[count - 1] / total))
    return u.astype(np.float32), (u.T @ t).astype(np.float32), error


def compress(
    receivers: Ints,
    positions: Floats,
    probes: Ints,
    matrix: Floats,
    coefficients: int,
    most: int,
    threshold: float,
    refine_above: float,
) -> list[Cluster]:
    """Transport ``matrix`` (m, k * coefficients) of one AABB leaf as one cluster or several.

    A cluster that ``most`` vectors leave with a relative error over ``refine_above`` is halved as
    its AABB leaf was, until it has fewer than 2 * SMALLEST_REFINED receivers: the paper refines
    its leaves by error likewise (Silvennoinen and Lehtinen 2017, section 4.1: 935 clusters for
    246 325 receivers). In each cluster the blocks of probes that none of its receivers uses are
    dropped.

    Args:
        receivers: (m,) receiver indices.
        positions: (m, 3) of them, m.
        probes: (k,) probes of the column blocks.
        matrix: the transport rows.
        coefficients: columns of a block.
        most: most vectors of a cluster.
        threshold: relative Frobenius error at which fewer vectors are enough.
        refine_above: relative Frobenius error above which a cluster is halved.
    """
    rows = matrix.astype(np.float64)
    gram = rows @ rows.T
    blocks = matrix.reshape(len(receivers), len(probes), coefficients)
    in_use = np.asarray(blocks.any(axis=2))
    done: list[Cluster] = []
    waiting = [np.arange(len(receivers))]
    while waiting:
        part = waiting.pop()
        used = np.flatnonzero(in_use[part].any(axis=0))
        kept = blocks[part][:, used].reshape(len(part), -1)
        own = gram[np.ix_(part, part)]
        u, projection, error = truncated_svd(kept, most, threshold, own)
        if error > refine_above and len(part) >= 2 * SMALLEST_REFINED:
            left = halve(positions[part])
            waiting += [part[~left], part[left]]
            continue
        members, columns = receivers[part].astype(np.int32), probes[used].astype(np.int32)
        done.append(Cluster(members, columns, projection, u, error))
    return done
