"""The baked data laid out for kernels in which neighbouring work-items read neighbouring addresses
(kernels_cl/srp/simt_projection.cl, simt_transport.cl).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Ints
from gibench.profiles import DeviceProfile
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.pack import Stored, _by_texel, _joined, padded
from gibench.techniques.srp.storage import storage_bytes, storage_dtype, store_cluster

_STEP_WORDS: Final = 8
"""A step of the projection is a multiple: steps of 32 bytes and more begin no more cache lines of
64 than they fill."""
_TEAM: Final = 32
"""Rows of a tile: a cluster has up to 32 (its coefficients)."""
_PIECE_COLUMNS: Final = 128
"""Columns of a piece: of a full tile 8 KB, which a work-item's loop takes 64 steps for."""
_TILE: Final = 64
"""Receivers of a tile: a multiple of every SIMD width there is; a cluster's last one is half empty
on average."""


@dataclass(frozen=True)
class SimtShape:
    """Sizes that the kernels are compiled for.

    Attributes:
        team: rows of a tile, and work-items of a group of the projection.
        tile: receivers of a tile, and work-items of a group of the transport.
    """

    team: int
    tile: int

    @staticmethod
    def of(profile: DeviceProfile, workgroup_size: int) -> SimtShape:
        """What suits a profile, with groups no larger than asked."""
        team, tile = max(_TEAM, profile.simd_width), max(_TILE, profile.simd_width)
        return SimtShape(min(workgroup_size, team), min(workgroup_size, tile))

    def stride(self, rows: int) -> int:
        """Words of a step of so many rows of a tile."""
        return padded(rows, min(_STEP_WORDS, self.team))


@dataclass(frozen=True)
class SimtTransport:
    """What the kernels read.

    Attributes:
        pieces: (pieces, 4) int32 first word, first probe, probes, words of a step.
        probes: the clusters' probes, int32.
        projection: stored values: per tile of rows, per probe, per pair of its coefficients, the
            rows' pairs (of 32 bits: the rows' first values, then their second ones).
        row_tiles: (row tiles, 4) int32 first row, rows, first piece, pieces.
        scale: (rows,) float32.
        tiles: (tiles, 3) int32 first word in tiles' rows, first row, rows.
        texel: (tiles * tile,) int32, -1 where there is no receiver.
        reconstruction: stored values: per tile, per component, per pair of light basis vectors,
            its receivers' pairs.
    """

    pieces: Ints = field(repr=False)
    probes: Ints = field(repr=False)
    projection: Stored = field(repr=False)
    row_tiles: Ints = field(repr=False)
    scale: npt.NDArray[np.float32] = field(repr=False)
    tiles: Ints = field(repr=False)
    texel: Ints = field(repr=False)
    reconstruction: Stored = field(repr=False)


@dataclass(frozen=True)
class SimtSizes:
    """How large :class:`SimtTransport` is; as long as nothing is baked, all are 0.

    Attributes:
        pieces: pieces of columns of all tiles of rows.
        probes: probes of all clusters that are not dark.
        projection: values with their padding.
        row_tiles: tiles of rows.
        tiles: tiles of receivers.
        reconstruction: values with their padding.
    """

    pieces: int = 0
    probes: int = 0
    projection: int = 0
    row_tiles: int = 0
    tiles: int = 0
    reconstruction: int = 0

    @staticmethod
    def of(bake: SrpBake, shape: SimtShape) -> SimtSizes:
        """The sizes of what :func:`pack_simt` makes of ``bake``."""
        lit = [cluster for cluster in bake.clusters if len(cluster.projection)]
        columns, at_once = padded(bake.coefficients, 2), piece_probes(bake.coefficients)
        found = SimtSizes()
        for cluster in lit:
            rows, probes = len(cluster.projection), len(cluster.probes)
            row_tiles = _row_tiles(rows, shape)
            tiles = -(-len(cluster.receivers) // shape.tile)
            parts = len(cluster.reconstruction) // len(cluster.receivers)
            found = SimtSizes(
                pieces=found.pieces + len(row_tiles) * -(-probes // at_once),
                probes=found.probes + probes,
                projection=found.projection
                + sum(shape.stride(count) for _, count in row_tiles) * probes * columns,
                row_tiles=found.row_tiles + len(row_tiles),
                tiles=found.tiles + tiles,
                reconstruction=found.reconstruction + padded(rows, 2) * tiles * shape.tile * parts,
            )
        return found


def piece_probes(coefficients: int) -> int:
    """Probes of a piece: those of a cluster, a piece's share at a time."""
    return max(1, _PIECE_COLUMNS // coefficients)


def _row_tiles(rows: int, shape: SimtShape) -> list[tuple[int, int]]:
    """First row and rows of each tile of a cluster's rows."""
    return [(first, min(shape.team, rows - first)) for first in range(0, rows, shape.team)]


def pack_simt(bake: SrpBake, texel: Ints, storage: str, shape: SimtShape) -> SimtTransport:
    """Lay the transport out for neighbouring work-items.

    Args:
        bake: the baked data.
        texel: (n,) int32 of the receivers.
        storage: ``fp32``, ``fp16`` or ``snorm16``.
        shape: sizes that the kernels are compiled for.
    """
    at_once, pair_words = piece_probes(bake.coefficients), storage_bytes(storage) // 2
    pieces: list[tuple[int, int, int, int]] = []
    row_tiles: list[tuple[int, int, int, int]] = []
    tiles: list[npt.NDArray[Any]] = []
    probes: list[npt.NDArray[Any]] = []
    projections: list[npt.NDArray[Any]] = []
    reconstructions: list[npt.NDArray[Any]] = []
    scales: list[npt.NDArray[Any]] = []
    texels: list[npt.NDArray[Any]] = []
    first_row = first_probe = words = tile_rows = 0
    for cluster in bake.clusters:
        rows, of_cluster = len(cluster.projection), len(cluster.probes)
        if rows == 0:  # dark: its receivers keep the black they start with
            continue
        stored = store_cluster(cluster, storage)
        by_probe = stored.projection.reshape(rows, of_cluster, bake.coefficients)
        for first, count in _row_tiles(rows, shape):
            stride = shape.stride(count)
            values = _paired(by_probe[first : first + count].transpose(1, 2, 0), stride, storage)
            projections.append(values)
            of_probe = padded(bake.coefficients, 2) // 2 * pair_words * stride
            starts = range(0, of_cluster, at_once)
            row_tiles.append((first_row + first, count, len(pieces), len(starts)))
            for start in starts:
                share = min(at_once, of_cluster - start)
                pieces.append((words + start * of_probe, first_probe + start, share, stride))
            words += of_cluster * of_probe
        order = _by_texel(stored, texel)
        parts = len(stored.reconstruction) // len(order)
        of_receivers = stored.reconstruction.reshape(len(order), parts, rows)[order]
        values = _tiles(of_receivers, shape.tile, storage)
        count = -(-len(order) // shape.tile)
        of_tile = parts * padded(rows, 2) // 2 * pair_words
        at = tile_rows + np.arange(count) * of_tile
        tiles.append(np.stack([at, np.full_like(at, first_row), np.full_like(at, rows)], axis=1))
        slots = np.full(count * shape.tile, -1, np.int32)
        slots[: len(order)] = texel[cluster.receivers[order]]
        reconstructions.append(values)
        texels.append(slots)
        tile_rows += count * of_tile
        probes.append(cluster.probes)
        scales.append(stored.scale)
        first_row += rows
        first_probe += of_cluster
    dtype = storage_dtype(storage)
    return SimtTransport(
        pieces=np.array(pieces, np.int32).reshape(-1, 4),
        probes=_joined(probes, np.int32),
        projection=_joined(projections, dtype),
        row_tiles=np.array(row_tiles, np.int32).reshape(-1, 4),
        scale=_joined(scales, np.float32),
        tiles=_joined(tiles, np.int32).reshape(-1, 3),
        texel=_joined(texels, np.int32),
        reconstruction=_joined(reconstructions, dtype),
    )


def _paired(values: Stored, width: int, storage: str) -> Stored:
    """Values (m, columns, n) as pairs of columns, n side by side, zero-padded to ``width``:
    (m, pairs, width, 2), or of 32 bits (m, pairs, 2, width).
    """
    count, columns, beside = values.shape
    full = np.pad(values, ((0, 0), (0, columns % 2), (0, width - beside)))
    pairs = full.reshape(count, -1, 2, width)
    return np.ascontiguousarray(pairs if storage == "fp32" else pairs.swapaxes(2, 3))


def _tiles(rows: Stored, tile: int, storage: str) -> Stored:
    """Pairs (:func:`_paired`) of the light basis vectors of receivers' rows (m, components, n), for
    each tile and component.
    """
    count, parts, vectors = rows.shape
    full = np.pad(rows, ((0, padded(count, tile) - count), (0, 0), (0, 0)))
    of_tiles = full.reshape(-1, tile, parts, vectors).transpose(0, 2, 3, 1)
    return _paired(of_tiles.reshape(-1, vectors, tile), tile, storage)
