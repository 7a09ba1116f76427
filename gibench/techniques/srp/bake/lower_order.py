"""A bake of a lower SH order out of one of a higher: no ray is traced again.

Spherical harmonics are orthogonal, so the transport coefficients of the lower orders are the same
numbers whatever the highest order is: the lower bake is the higher one without the columns of the
dropped coefficients, compressed once more.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from gibench.progress import progress
from gibench.techniques.srp.bake.cpca import truncated_svd
from gibench.techniques.srp.bake.data import Cluster, RelightSamples, SrpBake, sh_count


def lower_order(bake: SrpBake, order: int, most: int, threshold: float) -> SrpBake:
    """``bake`` as if it had been baked at ``order``.

    A cluster T = U P loses columns of P; the rest, P' = A Q by a truncated SVD, gives the cluster
    (U A) Q. U has orthonormal columns, so the error of that truncation is the cluster's own.

    Args:
        bake: the bake of a higher order.
        order: the order wanted, at most the bake's.
        most: most vectors of a cluster.
        threshold: relative Frobenius error at which fewer vectors are enough.
    """
    if order > bake.sh_order:
        raise ValueError(f"order {order} cannot be had from order {bake.sh_order}")
    count = sh_count(order)
    relight = bake.relight
    basis = np.ascontiguousarray(relight.basis[:, :count])

    def lowered(cluster: Cluster) -> Cluster:
        return _lowered(cluster, bake.coefficients, count, most, threshold)

    clusters = []
    # BLAS threads of one worker would only take the cores of the others.
    with (
        threadpool_limits(limits=1),
        progress(f"Lowering the bake to order {order}", len(bake.clusters)) as advance,
        ThreadPoolExecutor(os.cpu_count()) as pool,
    ):
        for cluster in pool.map(lowered, bake.clusters):
            clusters.append(cluster)
            advance(1)
    return replace(
        bake,
        sh_order=order,
        relight=RelightSamples(relight.directions, basis, relight.texel),
        clusters=tuple(clusters),
    )


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
