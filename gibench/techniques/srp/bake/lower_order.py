"""A bake of a lower SH order out of one of a higher: no ray is traced again.

Spherical harmonics are orthogonal, so the transport coefficients of the lower orders are the same
numbers whatever the highest order is: the lower bake is the higher one without the columns of the
dropped coefficients, compressed once more.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from gibench.techniques.srp.bake.cpca import truncated_svd
from gibench.techniques.srp.bake.data import Cluster, sh_count


def lower_clusters(
    clusters: Iterable[Cluster], before: int, order: int, most: int, threshold: float
) -> list[Cluster]:
    """``clusters`` of a bake of order ``before`` as if it had been baked at ``order``.

    A cluster T = U P loses columns of P; the rest, P' = A Q by a truncated SVD, gives the cluster
    (U A) Q. U has orthonormal columns, so the error of that truncation is the cluster's own.

    Args:
        clusters: of the higher order.
        before: their SH order.
        order: the order wanted, at most ``before``.
        most: most vectors of a cluster.
        threshold: relative Frobenius error at which fewer vectors are enough.
    """
    return [
        _lowered(cluster, sh_count(before), sh_count(order), most, threshold)
        for cluster in clusters
    ]


def _lowered(cluster: Cluster, before: int, after: int, most: int, threshold: float) -> Cluster:
    vectors = len(cluster.projection)
    blocks = cluster.projection.reshape(vectors, len(cluster.probes), before)
    kept = blocks[:, :, :after].reshape(vectors, len(cluster.probes) * after)
    turned, projection, error = truncated_svd(kept, most, threshold)
    reconstruction = cluster.reconstruction.astype(np.float64) @ turned.astype(np.float64)
    return Cluster(
        cluster.receivers,
        cluster.probes,
        projection,
        reconstruction.astype(np.float32),
        _bound(cluster, kept, error),
    )


def _bound(
    cluster: Cluster, kept: np.ndarray[tuple[int, int], np.dtype[np.float32]], error: float
) -> float:
    """Upper bound of the relative error: all that the higher order had lost may lie in ``kept``."""
    whole = float(np.square(cluster.projection, dtype=np.float64).sum())
    part = float(np.square(kept, dtype=np.float64).sum())
    if not part > 0:
        return cluster.error
    lost = cluster.error**2 / (1.0 - cluster.error**2) * whole
    return math.sqrt(error**2 + lost / (part + lost))
