"""Clustered principal component analysis of transport (Sloan et al. 2003; Bennett 2019).

Silvennoinen and Lehtinen (2017, section 4.1) refine the leaves of an AABB tree "based on a fixed
error threshold" of 0.005 and at most 32 vectors, and leave open what the error is of and how a leaf
is refined. Here it is the root mean square error of a leaf's irradiance under expected light
(:mod:`gibench.techniques.srp.bake.expected_light`), relative to that irradiance itself, and of all
refinements of the leaf that meet it the smallest is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from gibench.arrays import Floats, Ints
from gibench.techniques.srp.bake.data import Cluster

# A cluster is not split into parts of fewer rows than this: 32 vectors hold 32 rows as they are, so
# that less brings nothing.
SMALLEST_PART = 16
# Weight of the error of the coefficients themselves, which is that under probe radiance that is
# white noise, beside the error under expected light: for lights finer than its patches. At a
# hundredth, random coefficients are 1.0 to 1.3 % off on samples of Sponza's leaves and the whole
# scene takes 90.1 MB; at 1 they are 0.6 % off and it takes 106.8 MB
# (tests/support/srp_compression.py).
WHITE_LIGHT = 1.0
# How much a direction counts beside a position, in extents of the cluster, where it is split.
NORMAL_WEIGHT = 0.5
# What a cluster costs beside its matrices, in stored values: tables and padding.
CLUSTER_VALUES = 50
# A probe's block is dropped if this much of the error that its size is worth is all it prevents.
DROP_SHARE = 0.3


def aabb_clusters(positions: Floats, most: int) -> list[Ints]:
    """Clusters of receiver ``positions`` (n, 3), each of at most ``most``, as ascending indices.

    The bounding box of the receivers is cut in half across its longest axis, and so is each
    half's own bounding box, until few enough are left (Bennett 2019, 5.6.6). Receivers
    that coincide, so that no cut separates them, are split by index.
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


@dataclass(frozen=True)
class _Node:
    """A part of a leaf, and the parts it may be split into.

    Attributes:
        part: (m,) receivers of the leaf.
        vectors: (m * components, v) float64 left singular vectors, the largest first, at most
            ``most``.
        left_over: (v + 1,) squared error of the irradiance with so many of them.
        values: stored values that one vector takes.
        parts: none, or two.
    """

    part: Ints
    vectors: npt.NDArray[np.float64]
    left_over: npt.NDArray[np.float64]
    values: int
    parts: tuple[_Node, ...]

    def best(self, slope: float) -> tuple[float, list[tuple[_Node, int]]]:
        """Least squared error plus ``slope`` times stored values, and the nodes and numbers of
        vectors that have it (Chou, Lookabaugh and Gray 1989: optimal pruning of a tree).
        """
        costs = self.left_over + slope * self.values * np.arange(len(self.left_over))
        count = int(costs.argmin())
        own = float(costs[count]) + slope * CLUSTER_VALUES
        if self.parts:
            found = [part.best(slope) for part in self.parts]
            split = sum(cost for cost, _ in found)
            if split < own:
                return split, [one for _, chosen in found for one in chosen]
        return own, [(self, count)]


def compress(
    receivers: Ints,
    positions: Floats,
    normals: Floats,
    probes: Ints,
    matrix: Floats,
    light: Floats,
    most: int,
    threshold: float,
    components: int = 1,
) -> list[Cluster]:
    """Transport ``matrix`` (m * components, k * c) of one AABB leaf as one cluster or several.

    Of all ways to split the leaf, by position and normal, into clusters of at most ``most`` vectors
    it takes the one of fewest stored values whose error is at most ``threshold``; where none is,
    the one of least error. Then the blocks of probes that matter less than their size are dropped
    (a probe's weight fades to nothing at its radius), which adds a little to the error. Receivers
    without light from any probe become a cluster of no vectors. The rows of a receiver, one for
    each component of its light, stay together and count alike.

    Args:
        receivers: (m,) receiver indices.
        positions: (m, 3) of them, m.
        normals: (m, 3) of them.
        probes: (k,) probes of the column blocks.
        matrix: the transport rows, those of a receiver one after the other.
        light: (k * c, q) probe radiance under each of q equally likely, independent lights.
        most: most vectors of a cluster.
        threshold: root mean square error of the leaf's irradiance relative to itself.
        components: rows of a receiver.
    """
    rows = matrix.astype(np.float64)
    by_receiver = rows.reshape(len(receivers), components, len(probes), -1)
    in_use = np.asarray(np.any(by_receiver, axis=(1, 3)))
    dark = ~in_use.any(axis=1)
    done = []
    if dark.any():
        nothing = np.zeros((components * int(dark.sum()), 0), np.float32)
        empty = np.zeros((0, 0), np.float32)
        done.append(
            Cluster(receivers[dark].astype(np.int32), np.zeros(0, np.int32), empty, nothing, 0.0)
        )
    if dark.all():
        return done
    gram, white = _irradiance_gram(matrix, light)
    features = _split_features(positions, normals)
    coefficients = matrix.shape[1] // len(probes)
    lit = np.flatnonzero(~dark).astype(np.int32)
    root = _tree(lit, gram, in_use, features, coefficients, most, components)
    slope = _slope(root, threshold)
    for node, count in root.best(slope)[1]:
        u = node.vectors[:, :count]
        own = rows[_rows_of(node.part, components)]
        blocks = (u.T @ own).reshape(count, len(probes), coefficients)
        used = np.asarray(in_use[node.part].any(axis=0))
        prevented = _prevented(blocks, used, light, white)
        kept = np.flatnonzero(prevented > DROP_SHARE * slope * count * coefficients)
        count = count if len(kept) else 0
        projection = blocks[:count, kept].reshape(count, len(kept) * coefficients)
        # Rows outside the span of u and the dropped columns within it: both are orthogonal to what
        # is stored.
        whole, stored = float(np.square(own).sum()), float(np.square(projection).sum())
        done.append(
            Cluster(
                receivers[node.part].astype(np.int32),
                probes[kept].astype(np.int32),
                projection.astype(np.float32),
                u[:, :count].astype(np.float32),
                float(np.sqrt(max(0.0, 1.0 - stored / whole))),
            )
        )
    return done


def _irradiance_gram(matrix: Floats, light: Floats) -> tuple[npt.NDArray[np.float64], float]:
    """(r, r) expected products of two rows' irradiance, and the weight of white light."""
    rows = matrix.astype(np.float64)
    own = rows @ rows.T
    lit = (matrix @ light).astype(np.float64)
    gram = lit @ lit.T
    energy = float(np.trace(gram))
    white = WHITE_LIGHT * energy / float(np.trace(own)) if energy > 0 else 1.0
    return gram + white * own, white


def _prevented(
    blocks: npt.NDArray[np.float64], used: npt.NDArray[np.bool_], light: Floats, white: float
) -> npt.NDArray[np.float64]:
    """(k,) squared error of the irradiance that each probe's block (n, k, c) prevents."""
    _, probes, coefficients = blocks.shape
    out = np.zeros(probes)
    of_probe = light.reshape(probes, coefficients, light.shape[1])
    for probe in np.flatnonzero(used):
        block = blocks[:, probe]
        lit = block.astype(np.float32) @ of_probe[probe]
        out[probe] = np.square(lit).sum(dtype=np.float64) + white * np.square(block).sum()
    return out


def _tree(
    part: Ints,
    gram: npt.NDArray[np.float64],
    in_use: npt.NDArray[np.bool_],
    features: npt.NDArray[np.float64],
    coefficients: int,
    most: int,
    components: int,
) -> _Node:
    """``part`` of a leaf with its vectors, split as long as its parts are large enough."""
    rows = _rows_of(part, components)
    own = gram[np.ix_(rows, rows)]
    size = len(rows)
    total = float(np.trace(own))
    values, vectors = eigh(own, subset_by_index=(max(0, size - most), size - 1), driver="evr")
    left_over = np.maximum(total - np.cumsum(np.maximum(values[::-1], 0.0)), 0.0)
    if size <= most:
        left_over[-1] = 0.0  # but for rounding
    parts: tuple[_Node, ...] = ()
    if size >= 2 * SMALLEST_PART and left_over[-1] > 0.0:
        first = _two_means(features[part], SMALLEST_PART // components)
        parts = tuple(
            _tree(part[side], gram, in_use, features, coefficients, most, components)
            for side in (first, ~first)
        )
    return _Node(
        part,
        vectors[:, ::-1],
        np.concatenate([[total], left_over]),
        int(in_use[part].any(axis=0).sum()) * coefficients + size,
        parts,
    )


def _rows_of(receivers: Ints, components: int) -> npt.NDArray[np.intp]:
    """The rows (m * components,) of ``receivers`` (m,) of a leaf."""
    rows = receivers.astype(np.intp)[:, None] * components + np.arange(components)
    return rows.ravel()


def _split_features(positions: Floats, normals: Floats) -> npt.NDArray[np.float64]:
    """(m, 6) what receivers of one part should have in common."""
    p = positions.astype(np.float64)
    return np.concatenate([p, NORMAL_WEIGHT * normals], axis=1)


def _two_means(features: npt.NDArray[np.float64], least: int) -> npt.NDArray[np.bool_]:
    """(m,) one of two groups by position and normal; halves along an axis if one has fewer than
    ``least``.
    """
    x = features - features.mean(axis=0)
    x[:, :3] /= max(float(np.ptp(x[:, :3], axis=0).max()), 1e-30)
    _, axes = np.linalg.eigh(x.T @ x)
    along = x @ axes[:, -1]
    first = along < np.median(along)
    for _ in range(12):
        if first.all() or not first.any():
            break
        a, b = x[first].mean(axis=0), x[~first].mean(axis=0)
        before, first = first, np.square(x - a).sum(axis=1) < np.square(x - b).sum(axis=1)
        if (first == before).all():
            break
    if least <= first.sum() <= len(x) - least:
        return np.asarray(first)
    longest = int(np.argmax(np.ptp(features[:, :3], axis=0)))
    order = np.argsort(features[:, longest], kind="stable")
    first = np.zeros(len(x), np.bool_)
    first[order[: len(x) // 2]] = True
    return first


def _slope(root: _Node, threshold: float) -> float:
    """The largest price of a stored value at which the error stays within ``threshold``."""
    energy = float(root.left_over[0])

    def meets(slope: float) -> bool:
        error = sum(float(node.left_over[count]) for node, count in root.best(slope)[1])
        return error <= threshold**2 * energy

    low, high = -14.0, 2.0  # powers of ten, of the leaf's energy
    if not meets(10.0**low * energy):
        return 0.0
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if meets(10.0**middle * energy) else (low, middle)
    return float(10.0**low * energy)
