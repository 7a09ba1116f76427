"""The baked data laid out for the kernels of each variant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.techniques.srp.bake.data import RelightSamples, SrpBake
from gibench.techniques.srp.storage import StoredCluster, storage_dtype, store_cluster

Stored = npt.NDArray[Any]

MISS = -1  # RelightSamples.texel: the environment
ROW_BLOCK = 4  # kernels_cl/srp/tuned_projection.cl: rows of a work-item


def _joined(parts: list[npt.NDArray[Any]], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    return np.concatenate([p.reshape(-1) for p in parts] or [np.empty(0)]).astype(dtype, copy=False)


def _starts(lengths: list[int]) -> npt.NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])


def _by_texel(stored: StoredCluster, texel: Ints) -> npt.NDArray[np.intp]:
    """Order of a cluster's receivers in which their texels ascend, so that stores are coherent."""
    return np.argsort(texel[stored.cluster.receivers], kind="stable")


def _receiver_rows(stored: StoredCluster, components: int) -> Stored:
    """The reconstruction matrix as (receivers, components, light basis vectors)."""
    shape = len(stored.cluster.receivers), components, len(stored.projection)
    return stored.reconstruction.reshape(shape)


# -- published -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PublishedTransport:
    """What kernels_cl/srp/published_transport.cl reads.

    Attributes:
        clusters: (clusters, 5) int32 first row, rows, first column, columns, first projection.
        row_cluster: (rows,) int32.
        columns: stored column -> coefficient index probe * c + j, int32.
        projection: stored values, row-major within a cluster.
        scale: (rows,) float32.
        receiver_cluster: (n,) int32, receivers in cluster order.
        first_value: (n,) int32 of each receiver's rows in ``reconstruction``.
        texel: (n,) int32.
        reconstruction: stored values, row-major within a cluster.
    """

    clusters: Ints = field(repr=False)
    row_cluster: Ints = field(repr=False)
    columns: Ints = field(repr=False)
    projection: Stored = field(repr=False)
    scale: Floats = field(repr=False)
    receiver_cluster: Ints = field(repr=False)
    first_value: Ints = field(repr=False)
    texel: Ints = field(repr=False)
    reconstruction: Stored = field(repr=False)


def pack_published(bake: SrpBake, texel: Ints, storage: str) -> PublishedTransport:
    """Lay the transport out as published.

    Args:
        bake: the baked data.
        texel: (n,) int32 of the receivers.
        storage: ``fp32``, ``fp16`` or ``snorm16``.
    """
    c, parts = bake.coefficients, bake.components
    stored = [store_cluster(cluster, storage) for cluster in bake.clusters]
    rows = [len(s.projection) for s in stored]
    columns = [s.projection.shape[1] if len(s.projection) else 0 for s in stored]
    members = [len(s.cluster.receivers) for s in stored]
    first_row, first_column = _starts(rows), _starts(columns)
    first_projection = _starts([s.projection.size for s in stored])
    first_reconstruction = _starts([s.reconstruction.size for s in stored])
    column_index = [
        (s.cluster.probes[:, None] * c + np.arange(c)) if count else np.empty(0)
        for s, count in zip(stored, columns, strict=True)
    ]
    starts = first_row[:-1], first_column[:-1], first_projection[:-1]
    table = np.stack([starts[0], rows, starts[1], columns, starts[2]], axis=1)
    value_rows = [
        start + np.arange(m) * n * parts
        for start, m, n in zip(first_reconstruction, members, rows, strict=False)
    ]
    orders = [_by_texel(s, texel) for s in stored]
    dtype = storage_dtype(storage)
    return PublishedTransport(
        clusters=table.astype(np.int32),
        row_cluster=np.repeat(np.arange(len(stored)), rows).astype(np.int32),
        columns=_joined(column_index, np.int32),
        projection=_joined([s.projection for s in stored], dtype),
        scale=_joined([s.scale for s in stored], np.float32),
        receiver_cluster=np.repeat(np.arange(len(stored)), members).astype(np.int32),
        first_value=_joined(value_rows, np.int32),
        texel=_joined(
            [texel[s.cluster.receivers[o]] for s, o in zip(stored, orders, strict=True)], np.int32
        ),
        reconstruction=_joined(
            [_receiver_rows(s, parts)[o] for s, o in zip(stored, orders, strict=True)], dtype
        ),
    )


@dataclass(frozen=True)
class SampleLists:
    """Relight rays that hit and that miss, apart (CSR over probes), all int32.

    Attributes:
        hit_start: (p + 1,).
        hit_sample: ray of each hit.
        hit_texel: texel of each hit.
        miss_start: (p + 1,).
        miss_sample: ray of each miss.
    """

    hit_start: Ints = field(repr=False)
    hit_sample: Ints = field(repr=False)
    hit_texel: Ints = field(repr=False)
    miss_start: Ints = field(repr=False)
    miss_sample: Ints = field(repr=False)


def pack_samples(relight: RelightSamples, black: bool = False) -> SampleLists:
    """Split the relight rays into hits and misses; what hits black is in neither list, or with
    ``black`` among the hits with its texel below 0, as something may come to lie before it.
    """
    hit, miss = relight.texel >= 0, relight.texel == MISS
    if black:
        hit = ~miss
    return SampleLists(
        hit_start=_starts(hit.sum(axis=1).tolist()).astype(np.int32),
        hit_sample=np.nonzero(hit)[1].astype(np.int32),
        hit_texel=relight.texel[hit].astype(np.int32),
        miss_start=_starts(miss.sum(axis=1).tolist()).astype(np.int32),
        miss_sample=np.nonzero(miss)[1].astype(np.int32),
    )


# -- tuned -----------------------------------------------------------------------------------------


def padded(count: int, multiple: int) -> int:
    """``count`` rounded up to a multiple."""
    return -(-count // multiple) * multiple


def projection_width(coefficients: int, device_width: int) -> int:
    """Vector width of the tuned projection: the widest that pads a probe's coefficients by at most
    15 %, since padding costs memory traffic, but not under 4 where the device has that.
    """
    for width in (16, 8):
        if width <= device_width and padded(coefficients, width) <= 1.15 * coefficients:
            return width
    return min(4, device_width)


@dataclass(frozen=True)
class TunedTransport:
    """What kernels_cl/srp/tuned_projection.cl and tuned_transport.cl read.

    Attributes:
        row_blocks: (b, 5) int32 first vector, first row, rows, first probe, probes.
        probes: the clusters' probes, int32.
        projection: stored values: per block, per probe, per vector of coefficients, per row.
        scale: (rows,) float32.
        receiver_blocks: (r, 3) int32 first vector, first row, rows.
        texel: (r * width,) int32, -1 behind a cluster's last receiver.
        reconstruction: stored values: per block, per light basis vector, per component, ``width``
            receivers.
    """

    row_blocks: Ints = field(repr=False)
    probes: Ints = field(repr=False)
    projection: Stored = field(repr=False)
    scale: Floats = field(repr=False)
    receiver_blocks: Ints = field(repr=False)
    texel: Ints = field(repr=False)
    reconstruction: Stored = field(repr=False)


@dataclass(frozen=True)
class TunedSizes:
    """How large :class:`TunedTransport` is; as long as nothing is baked, all are 0.

    Attributes:
        row_blocks: blocks of rows.
        probes: probes of all clusters that are not dark.
        projection: values with their padding.
        receiver_blocks: blocks of receivers.
        reconstruction: values with their padding.
    """

    row_blocks: int = 0
    probes: int = 0
    projection: int = 0
    receiver_blocks: int = 0
    reconstruction: int = 0

    @staticmethod
    def of(bake: SrpBake, device_width: int) -> TunedSizes:
        """The sizes of what :func:`pack_tuned` makes of ``bake``."""
        values = padded(bake.coefficients, projection_width(bake.coefficients, device_width))
        lit = [
            (
                len(cluster.projection),
                len(cluster.probes),
                padded(len(cluster.receivers), device_width),
            )
            for cluster in bake.clusters
            if len(cluster.projection)
        ]
        return TunedSizes(
            row_blocks=sum(-(-rows // ROW_BLOCK) for rows, _, _ in lit),
            probes=sum(probes for _, probes, _ in lit),
            projection=sum(rows * probes * values for rows, probes, _ in lit),
            receiver_blocks=sum(slots // device_width for _, _, slots in lit),
            reconstruction=sum(rows * slots for rows, _, slots in lit) * bake.components,
        )


def pack_tuned(bake: SrpBake, texel: Ints, storage: str, device_width: int) -> TunedTransport:
    """Lay the transport out in vectors.

    Args:
        bake: the baked data.
        texel: (n,) int32 of the receivers.
        storage: ``fp32``, ``fp16`` or ``snorm16``.
        device_width: floats per vector of the executing device.
    """
    width = projection_width(bake.coefficients, device_width)
    row_blocks: list[tuple[int, int, int, int, int]] = []
    receiver_blocks: list[npt.NDArray[Any]] = []
    probes: list[npt.NDArray[Any]] = []
    projections: list[npt.NDArray[Any]] = []
    reconstructions: list[npt.NDArray[Any]] = []
    scales: list[npt.NDArray[Any]] = []
    texels: list[npt.NDArray[Any]] = []
    first_row = first_probe = projected = reconstructed = 0  # the last two in vectors
    for cluster in bake.clusters:
        rows = len(cluster.projection)
        if rows == 0:  # dark: its receivers keep the black they start with
            continue
        stored = store_cluster(cluster, storage)
        vectors = padded(bake.coefficients, width) // width * len(cluster.probes)
        for start, block in _interleaved(stored.projection, bake.coefficients, width):
            count = min(ROW_BLOCK, rows - start)
            row_blocks.append(
                (projected, first_row + start, count, first_probe, len(cluster.probes))
            )
            projections.append(block)
            projected += vectors * count
        order = _by_texel(stored, texel)
        tiles = _transposed(_receiver_rows(stored, bake.components)[order], device_width)
        vectors = rows * bake.components
        at = reconstructed + np.arange(len(tiles)) * vectors
        receiver_blocks.append(
            np.stack([at, np.full_like(at, first_row), np.full_like(at, rows)], axis=1)
        )
        slots = np.full(len(tiles) * device_width, -1, np.int32)
        slots[: len(order)] = texel[cluster.receivers[order]]
        reconstructions.append(tiles)
        texels.append(slots)
        reconstructed += len(tiles) * vectors
        probes.append(cluster.probes)
        scales.append(stored.scale)
        first_row += rows
        first_probe += len(cluster.probes)
    dtype = storage_dtype(storage)
    return TunedTransport(
        row_blocks=np.array(row_blocks, np.int32).reshape(-1, 5),
        probes=_joined(probes, np.int32),
        projection=_joined(projections, dtype),
        scale=_joined(scales, np.float32),
        receiver_blocks=_joined(receiver_blocks, np.int32).reshape(-1, 3),
        texel=_joined(texels, np.int32),
        reconstruction=_joined(reconstructions, dtype),
    )


def _interleaved(
    projection: Stored, coefficients: int, width: int
) -> list[tuple[int, npt.NDArray[Any]]]:
    """Blocks of up to four rows with their first row: (probe, vector, row, lane)."""
    rows = len(projection)
    by_probe = projection.reshape(rows, -1, coefficients)
    extra = padded(coefficients, width) - coefficients
    vectors = np.pad(by_probe, ((0, 0), (0, 0), (0, extra))).reshape(rows, -1, width)
    return [
        (start, np.ascontiguousarray(vectors[start : start + ROW_BLOCK].transpose(1, 0, 2)))
        for start in range(0, rows, ROW_BLOCK)
    ]


def _transposed(reconstruction: Stored, width: int) -> npt.NDArray[Any]:
    """(blocks, light basis vectors, components, width) of receivers' rows (m, components, n),
    zero-padded.
    """
    count, components, rows = reconstruction.shape
    full = np.pad(reconstruction, ((0, padded(count, width) - count), (0, 0), (0, 0)))
    blocks = full.reshape(-1, width, components, rows)
    return np.ascontiguousarray(blocks.transpose(0, 3, 2, 1))


def padded_basis(relight: RelightSamples, device_width: int) -> Floats:
    """The relight basis (s, stride) with zeros behind the last coefficient."""
    samples, coefficients = relight.basis.shape
    out = np.zeros((samples, padded(coefficients, device_width)), np.float32)
    out[:, :coefficients] = relight.basis
    return out


def sample_sources(relight: RelightSamples, texels: int) -> Ints:
    """(p, s) int32: entry of the extended radiance map each relight ray sees.

    Behind the ``texels`` lie the environment's radiance by sample and one black entry.
    """
    samples = relight.texel.shape[1]
    environment = texels + np.arange(samples)
    black = texels + samples
    out = np.where(relight.texel >= 0, relight.texel, black)
    return np.where(relight.texel == MISS, environment, out).astype(np.int32)
