"""The baked data laid out for kernels in which neighbouring work-items read neighbouring addresses
(kernels_cl/srp/simt_projection.cl, simt_transport.cl).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Ints
from gibench.errors import CannotRun
from gibench.profiles import DeviceProfile
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.pack import Stored, _by_texel, _joined, padded
from gibench.techniques.srp.storage import storage_bytes, storage_dtype, store_cluster

ROW_BYTES: Final = 128
"""A row of a projection matrix begins at a multiple: the longest cache line of a GPU."""
_BLOCK_ROWS: Final = 4
"""Rows that share what is read of the probes' light: three channels of four rows are twelve sums,
which leave a work-item's registers to the operands even where a unit holds 32 for each.
"""
_TEAM: Final = 32
_TILE: Final = 64
"""Receivers of a tile: a multiple of every SIMD width there is; a cluster's last one is half empty
on average."""


@dataclass(frozen=True)
class SimtShape:
    """Sizes that the kernels are compiled for.

    Attributes:
        team: work-items of a group of the projection.
        block_rows: rows that it takes at once.
        tile: receivers of a tile, and work-items of a group of the transport.
    """

    team: int
    block_rows: int
    tile: int

    @staticmethod
    def of(profile: DeviceProfile, workgroup_size: int) -> SimtShape:
        """What suits a profile, with groups no larger than asked.

        Raises:
            CannotRun: the sums of one row do not fit its local memory.
        """
        team = min(workgroup_size, max(_TEAM, profile.simd_width))
        rows = min(_BLOCK_ROWS, profile.local_memory_bytes // (12 * team))
        if rows == 0:
            raise CannotRun(f"profile {profile.name} has too little local memory")
        return SimtShape(team, rows, min(workgroup_size, max(_TILE, profile.simd_width)))


@dataclass(frozen=True)
class SimtTransport:
    """What the kernels read.

    Attributes:
        row_blocks: (blocks, 5) int32 first unit of values, first row, rows, first probe, probes.
        probes: the clusters' probes, int32.
        projection: stored values, row-major, each row padded to ``ROW_BYTES``.
        scale: (rows,) float32.
        tiles: (tiles, 3) int32 first value in tiles' rows, first row, rows.
        texel: (tiles * tile,) int32, -1 where there is no receiver.
        reconstruction: stored values: per tile, per light basis vector, per component, its
            receivers.
    """

    row_blocks: Ints = field(repr=False)
    probes: Ints = field(repr=False)
    projection: Stored = field(repr=False)
    scale: npt.NDArray[np.float32] = field(repr=False)
    tiles: Ints = field(repr=False)
    texel: Ints = field(repr=False)
    reconstruction: Stored = field(repr=False)


@dataclass(frozen=True)
class SimtSizes:
    """How large :class:`SimtTransport` is; as long as nothing is baked, all are 0.

    Attributes:
        row_blocks: blocks of rows.
        probes: probes of all clusters that are not dark.
        projection: values with their padding.
        tiles: tiles of receivers.
        reconstruction: values with their padding.
    """

    row_blocks: int = 0
    probes: int = 0
    projection: int = 0
    tiles: int = 0
    reconstruction: int = 0

    @staticmethod
    def of(bake: SrpBake, storage: str, shape: SimtShape) -> SimtSizes:
        """The sizes of what :func:`pack_simt` makes of ``bake``."""
        unit = row_unit(storage)
        lit = [
            (
                len(cluster.projection),
                len(cluster.probes),
                -(-len(cluster.receivers) // shape.tile),
                len(cluster.reconstruction) // len(cluster.receivers),
            )
            for cluster in bake.clusters
            if len(cluster.projection)
        ]
        return SimtSizes(
            row_blocks=sum(-(-rows // shape.block_rows) for rows, *_ in lit),
            probes=sum(probes for _, probes, *_ in lit),
            projection=sum(
                rows * padded(probes * bake.coefficients, unit) for rows, probes, *_ in lit
            ),
            tiles=sum(tiles for _, _, tiles, _ in lit),
            reconstruction=sum(rows * tiles * shape.tile * parts for rows, _, tiles, parts in lit),
        )


def row_unit(storage: str) -> int:
    """Stored values in ``ROW_BYTES``."""
    return ROW_BYTES // storage_bytes(storage)


def pack_simt(bake: SrpBake, texel: Ints, storage: str, shape: SimtShape) -> SimtTransport:
    """Lay the transport out for neighbouring work-items.

    Args:
        bake: the baked data.
        texel: (n,) int32 of the receivers.
        storage: ``fp32``, ``fp16`` or ``snorm16``.
        shape: sizes that the kernels are compiled for.
    """
    unit = row_unit(storage)
    row_blocks: list[tuple[int, int, int, int, int]] = []
    tiles: list[npt.NDArray[Any]] = []
    probes: list[npt.NDArray[Any]] = []
    projections: list[npt.NDArray[Any]] = []
    reconstructions: list[npt.NDArray[Any]] = []
    scales: list[npt.NDArray[Any]] = []
    texels: list[npt.NDArray[Any]] = []
    first_row = first_probe = units = tile_rows = 0
    for cluster in bake.clusters:
        rows = len(cluster.projection)
        if rows == 0:  # dark: its receivers keep the black they start with
            continue
        stored = store_cluster(cluster, storage)
        columns = stored.projection.shape[1]
        stride = padded(columns, unit)
        projections.append(np.pad(stored.projection, ((0, 0), (0, stride - columns))))
        for start in range(0, rows, shape.block_rows):
            count = min(shape.block_rows, rows - start)
            first = units + start * (stride // unit)
            row_blocks.append((first, first_row + start, count, first_probe, len(cluster.probes)))
        units += rows * (stride // unit)
        order = _by_texel(stored, texel)
        parts = len(stored.reconstruction) // len(order)
        of_receivers = stored.reconstruction.reshape(len(order), parts, rows)[order]
        values = _tiles(of_receivers, shape.tile)
        at = tile_rows + np.arange(len(values)) * rows * parts
        tiles.append(np.stack([at, np.full_like(at, first_row), np.full_like(at, rows)], axis=1))
        slots = np.full(len(values) * shape.tile, -1, np.int32)
        slots[: len(order)] = texel[cluster.receivers[order]]
        reconstructions.append(values)
        texels.append(slots)
        tile_rows += len(values) * rows * parts
        probes.append(cluster.probes)
        scales.append(stored.scale)
        first_row += rows
        first_probe += len(cluster.probes)
    dtype = storage_dtype(storage)
    return SimtTransport(
        row_blocks=np.array(row_blocks, np.int32).reshape(-1, 5),
        probes=_joined(probes, np.int32),
        projection=_joined(projections, dtype),
        scale=_joined(scales, np.float32),
        tiles=_joined(tiles, np.int32).reshape(-1, 3),
        texel=_joined(texels, np.int32),
        reconstruction=_joined(reconstructions, dtype),
    )


def _tiles(rows: Stored, tile: int) -> Stored:
    """(tiles, light basis vectors, components, tile) of receivers' rows (m, components, n),
    zero-padded.
    """
    count, parts, vectors = rows.shape
    full = np.pad(rows, ((0, padded(count, tile) - count), (0, 0), (0, 0)))
    return np.ascontiguousarray(full.reshape(-1, tile, parts, vectors).transpose(0, 3, 2, 1))
