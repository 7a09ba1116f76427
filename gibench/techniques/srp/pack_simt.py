"""The baked data laid out for kernels in which neighbouring work-items read neighbouring addresses
(kernels_cl/srp/simt_projection.cl, simt_transport.cl).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Ints
from gibench.profiles import DeviceProfile
from gibench.techniques.srp.bake.data import Cluster, SrpBake
from gibench.techniques.srp.pack import Stored, _by_texel, _joined, padded
from gibench.techniques.srp.storage import storage_bytes, storage_dtype, store_cluster

_TILE_WORDS: Final = 8
"""A step of the transport is a multiple: steps of 32 bytes and more seldom begin more lines of
64 than they fill. The projection's steps, of which there is far more to read, have no padding."""
_TEAM: Final = 32
"""Rows of a tile: a cluster has up to 32 (its coefficients)."""
_EACH: Final = 2  # the most that kernels_cl/srp/simt_projection.cl has
_LEAST_COLUMNS: Final = 32
"""Columns of a piece at least: a work-item's loop takes 16 steps for them."""
_PIECES: Final = 4096
"""Pieces that tiles are cut for: 56 units (Vega 56) with four SIMD units of ten waves hold 2240."""
_UPDATE_TEAM: Final = 64
"""Work-items of a group of the probe update: the coefficients of order 7, and a multiple of every
SIMD width there is."""
_SAMPLES: Final = 512
"""Samples of a part of the probe update at most, in 6 KB of local memory: a unit of 64 KB holds ten
groups."""
_TILE: Final = 64
"""Receivers of a tile: a multiple of every SIMD width there is."""
_TILES_TOGETHER: Final = 64
"""Tiles of a group of the transport where a group is one vector of a CPU: 7590 groups, one each, of
Sponza's 246,325 receivers take 1.2 times as long."""
WHOLE: Final = -1
"""Stands for the slot of a piece that is all of its tile, whose sums no other is added to."""
_ROOM: Final = 16
"""Work-items of the widest vector there is: what those behind a tile's last row or receiver read
behind the matrix, and texels of whole vectors."""


@dataclass(frozen=True)
class SimtShape:
    """Sizes that the kernels are compiled for.

    Attributes:
        group: work-items of a group of the projection.
        team: those of them that compute.
        each: rows of one of them.
        tile: receivers of a tile, and work-items of a group of the transport.
        tile_team: those of them that compute.
        tiles: tiles of a group of the transport.
        together: work-items that are computed in whole vectors only (``Device.lanes_together``).
        update_team: work-items of a group of the probe update.
        samples: of a part of the probe update at most; 0 where local memory holds not even the
            group's sums.
    """

    group: int
    team: int
    each: int
    tile: int
    tile_team: int
    tiles: int
    together: int
    update_team: int
    samples: int

    @staticmethod
    def of(profile: DeviceProfile, workgroup_size: int, together: int = 1) -> SimtShape:
        """What suits a profile, with groups no larger than asked. On a CPU that vectorises over
        work-items one vector of a group projects, whose work-items have two rows each: what all
        read of the probes' light serves both. The others end at once. So it is in the probe
        update and the transport, where such a group takes several tiles.
        """
        group = min(workgroup_size, max(_TEAM, profile.simd_width))
        update = min(workgroup_size, max(_UPDATE_TEAM, profile.simd_width))
        room = profile.local_memory_bytes // 12 - update
        tile = min(workgroup_size, max(_TILE, profile.simd_width))
        return SimtShape(
            group=group,
            team=min(group, together) if together > 1 else group,
            each=_EACH if together > 1 else 1,
            tile=tile,
            tile_team=min(tile, together) if together > 1 else tile,
            tiles=_TILES_TOGETHER if together > 1 else 1,
            together=together,
            update_team=update,
            samples=max(0, min(_SAMPLES, room)),
        )

    @property
    def rows(self) -> int:
        """Rows of a tile at most."""
        return self.team * self.each

    def probe_team(self, coefficients: int) -> int:
        """Work-items of a group of the probe update that compute: one vector where only whole ones
        do and coefficients fill it, of which each then sums several; else all.
        """
        whole = self.together > 1 and coefficients % self.together == 0
        return self.together if whole and self.together <= self.update_team else self.update_team

    def chunk(self, samples: int) -> int:
        """Samples of a part of a probe's, two parts at least."""
        return max(1, min(self.samples, -(-samples // 2)))

    def items(self, count: int, most: int) -> int:
        """Work-items that compute for ``count`` rows or receivers, of a group of ``most``."""
        return min(most, padded(count, self.together))

    def slots(self, receivers: int) -> int:
        """Texels kept of a tile, -1 behind its last receiver."""
        return padded(
            min(self.tile, padded(receivers, _ROOM)), self.tile_team if self.together > 1 else 1
        )


@dataclass(frozen=True)
class SimtTransport:
    """What the kernels read.

    Attributes:
        pieces: (pieces, 8) int32 first word, first probe, probes, words of a step, work-items that
            compute, first row, rows, slot (-1: the piece is its whole tile).
        probes: the clusters' probes, int32.
        projection: stored values: per tile of rows, per probe, per pair of its coefficients, the
            rows' pairs (of 32 bits: the rows' first values, then their second ones).
        row_tiles: (row tiles, 4) int32 first row, rows, first slot, slots; of tiles of
            several pieces.
        scale: (rows,) float32.
        tiles: (tiles, 6) int32 first word, first row, rows, words of a step, work-items that
            compute, first texel; of whole groups, 0 behind the last.
        texel: int32 of the tiles' receivers, each tile's in whole vectors; -1 where there is none.
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
        slots: pieces that are not whole tiles.
        probes: probes of all clusters that are not dark.
        projection: values with their padding.
        row_tiles: tiles of rows that are several pieces.
        tiles: tiles of receivers, of whole groups.
        texels: of tiles, in whole vectors.
        reconstruction: values with their padding.
    """

    pieces: int = 0
    slots: int = 0
    probes: int = 0
    projection: int = 0
    row_tiles: int = 0
    tiles: int = 0
    texels: int = 0
    reconstruction: int = 0

    @staticmethod
    def of(bake: SrpBake, shape: SimtShape) -> SimtSizes:
        """The sizes of what :func:`pack_simt` makes of ``bake``."""
        at_once, columns = piece_probes(bake, shape), padded(bake.coefficients, 2)
        found = SimtSizes()
        for cluster in _lit(bake):
            rows, probes = len(cluster.projection), len(cluster.probes)
            row_tiles = _tiles_of(rows, shape.rows)
            tiles = _tiles_of(len(cluster.receivers), shape.tile)
            parts = len(cluster.reconstruction) // len(cluster.receivers)
            cuts = -(-probes // at_once)
            cut = len(row_tiles) if cuts > 1 else 0
            beside = sum(padded(count, _TILE_WORDS) for _, count in tiles)
            found = SimtSizes(
                pieces=found.pieces + len(row_tiles) * cuts,
                slots=found.slots + cut * cuts,
                probes=found.probes + probes,
                projection=found.projection + rows * probes * columns,
                row_tiles=found.row_tiles + cut,
                tiles=found.tiles + len(tiles),
                texels=found.texels + sum(shape.slots(count) for _, count in tiles),
                reconstruction=found.reconstruction + padded(rows, 2) * beside * parts,
            )
        return replace(
            found,
            tiles=padded(found.tiles, shape.tiles),
            projection=found.projection + 2 * _ROOM,
            reconstruction=found.reconstruction + 2 * _ROOM,
        )


def piece_probes(bake: SrpBake, shape: SimtShape) -> int:
    """Probes of a piece: those of its cluster, or a share where there are too few tiles."""
    of_tiles = sum(
        len(cluster.probes) * len(_tiles_of(len(cluster.projection), shape.rows))
        for cluster in _lit(bake)
    )
    return max(1, _LEAST_COLUMNS // bake.coefficients, of_tiles // _PIECES)


def _lit(bake: SrpBake) -> list[Cluster]:
    """Clusters that are not dark: a dark one's receivers keep the black they start with."""
    return [cluster for cluster in bake.clusters if len(cluster.projection)]


def _tiles_of(count: int, most: int) -> list[tuple[int, int]]:
    """First one and number of each tile of so many rows or receivers."""
    return [(first, min(most, count - first)) for first in range(0, count, most)]


def pack_simt(bake: SrpBake, texel: Ints, storage: str, shape: SimtShape) -> SimtTransport:
    """Lay the transport out for neighbouring work-items.

    Args:
        bake: the baked data.
        texel: (n,) int32 of the receivers.
        storage: ``fp32``, ``fp16`` or ``snorm16``.
        shape: sizes that the kernels are compiled for.
    """
    at_once, pair_words = piece_probes(bake, shape), storage_bytes(storage) // 2
    pieces: list[tuple[int, ...]] = []
    row_tiles: list[tuple[int, int, int, int]] = []
    tiles: list[tuple[int, ...]] = []
    probes: list[npt.NDArray[Any]] = []
    projections: list[npt.NDArray[Any]] = []
    reconstructions: list[npt.NDArray[Any]] = []
    scales: list[npt.NDArray[Any]] = []
    texels: list[npt.NDArray[Any]] = []
    first_row = first_probe = words = tile_words = slots = first_texel = 0
    of_columns = padded(bake.coefficients, 2) // 2 * pair_words
    for cluster in _lit(bake):
        rows, of_cluster = len(cluster.projection), len(cluster.probes)
        stored = store_cluster(cluster, storage)
        by_probe = stored.projection.reshape(rows, of_cluster, bake.coefficients)
        starts = range(0, of_cluster, at_once)
        for first, count in _tiles_of(rows, shape.rows):
            values = by_probe[first : first + count].transpose(1, 2, 0)
            projections.append(_paired(values, count, storage))
            of_probe = of_columns * count
            of_rows = (count, shape.items(count, shape.team), first_row + first, count)
            cut = len(starts) > 1
            if cut:
                row_tiles.append((first_row + first, count, slots, len(starts)))
            for start in starts:
                share = min(at_once, of_cluster - start)
                at = words + start * of_probe, first_probe + start, share
                pieces.append((*at, *of_rows, slots if cut else WHOLE))
                slots += cut
            words += of_cluster * of_probe
        order = _by_texel(stored, texel)
        parts = len(stored.reconstruction) // len(order)
        of_receivers = stored.reconstruction.reshape(len(order), parts, rows)[order]
        of_tile = parts * padded(rows, 2) // 2 * pair_words
        for first, count in _tiles_of(len(order), shape.tile):
            stride = padded(count, _TILE_WORDS)
            values = of_receivers[first : first + count].transpose(1, 2, 0)
            reconstructions.append(_paired(values, stride, storage))
            items = shape.items(count, shape.tile)
            tiles.append((tile_words, first_row, rows, stride, items, first_texel))
            own = np.full(shape.slots(count), -1, np.int32)
            own[:count] = texel[cluster.receivers[order[first : first + count]]]
            texels.append(own)
            tile_words += of_tile * stride
            first_texel += len(own)
        probes.append(cluster.probes)
        scales.append(stored.scale)
        first_row += rows
        first_probe += of_cluster
    room = np.zeros(2 * _ROOM, storage_dtype(storage))
    projections.append(room)
    reconstructions.append(room)
    tiles += [(0,) * 6] * (padded(len(tiles), shape.tiles) - len(tiles))
    dtype = storage_dtype(storage)
    return SimtTransport(
        pieces=np.array(pieces, np.int32).reshape(-1, 8),
        probes=_joined(probes, np.int32),
        projection=_joined(projections, dtype),
        row_tiles=np.array(row_tiles, np.int32).reshape(-1, 4),
        scale=_joined(scales, np.float32),
        tiles=np.array(tiles, np.int32).reshape(-1, 6),
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
