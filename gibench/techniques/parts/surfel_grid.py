"""A grid over surfels: its shape, and the passes that sort surfels into it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.device import (
    SIMT,
    BufferSpec,
    Device,
    Launch,
    Layout,
    ProgramSpec,
    reads,
    updates,
    writes,
)
from gibench.techniques.parts.scan import BlockScan, WaveScan, wave_of
from gibench.techniques.parts.surfels import SurfelGeometry

SCAN = "grid_scan"
"""Its scratch begins with this in the ledger."""

TABLE_FLOATS = 8  # kernels_cl/parts/surfel_grid.cl
PACKED_ROWS = 11
"""Numbers of an entry of the lists: position, normal, 1 / radius, irradiance, least mean depth."""
PACKED_PADDING = 16
"""Entries behind the lists: room for one vector."""
LIST_MACROS = {"PACKED_PADDING": PACKED_PADDING}
"""Of every program that includes kernels_cl/parts/surfel_grid.cl."""
NEIGHBOURS = 27  # cells a surfel goes into as published (Ekberg 2022, section 4.2.1)
PERSPECTIVE_NEAR = 0.1  # half the inner cube's side, share of the scene's diagonal; our choice


@dataclass(frozen=True)
class UniformGrid:
    """Cubic cells over a box (Ekberg 2022, section 4.2).

    Attributes:
        lower: lower corner, m.
        cell: a cell's side, m.
        shape: number of cells in x, y and z.
    """

    lower: tuple[float, float, float]
    cell: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(
        bounds: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]], cells: int
    ) -> UniformGrid:
        """``cells`` cells along the longest side of ``bounds``, and one more all around, so that
        nothing in the scene lies in a cell at the border.
        """
        low, high = bounds
        side = float(np.max(high - low)) / cells
        shape = np.maximum(np.ceil((high - low) / side - 1e-6).astype(int), 1) + 2
        x, y, z = (low + high) / 2 - shape * side / 2
        return UniformGrid(
            (float(x), float(y), float(z)), side, (int(shape[0]), int(shape[1]), int(shape[2]))
        )

    @property
    def cells(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    @property
    def largest_radius(self) -> float:
        """The largest radius of a surfel that reaches no further than the neighbours, m."""
        return self.cell

    @property
    def defines(self) -> dict[str, int]:
        """Macros of kernels_cl/parts/surfel_grid.cl."""
        x, y, z = self.shape
        return {"GRID_PERSPECTIVE": 0, "GRID_X": x, "GRID_Y": y, "GRID_Z": z}

    def table(self, camera: Sequence[float]) -> Floats:
        """What kernels_cl/parts/surfel_grid.cl reads, (8,) float32; the same for every camera."""
        return np.array([*self.lower, self.cell, 1 / self.cell, 0, 0, 0], np.float32)


@dataclass(frozen=True)
class PerspectiveGrid:
    """A cube of cubic cells around the camera and six pyramids whose cells grow with the distance
    (Brinck et al. 2021; Ekberg 2022, section 3.1.2).

    Attributes:
        half_side: half the cube's side, m.
        divisions: cells along the cube's side and across a pyramid.
        slices: cells along a pyramid's depth.
    """

    half_side: float
    divisions: int
    slices: int

    @staticmethod
    def around(
        bounds: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]], divisions: int
    ) -> PerspectiveGrid:
        """A grid that reaches a scene's diagonal away from a camera anywhere."""
        diagonal = float(np.linalg.norm(bounds[1] - bounds[0]))
        slices = math.ceil(math.log(1 / PERSPECTIVE_NEAR) / math.log1p(2 / divisions))
        return PerspectiveGrid(PERSPECTIVE_NEAR * diagonal, divisions, slices)

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.divisions**2 * (self.divisions + 6 * self.slices)

    @property
    def largest_radius(self) -> float:
        """The largest radius of a surfel, m: unbounded."""
        return math.inf

    @property
    def defines(self) -> dict[str, int]:
        """Macros of kernels_cl/parts/surfel_grid.cl."""
        return {"GRID_PERSPECTIVE": 1, "GRID_N": self.divisions, "GRID_SLICES": self.slices}

    def table(self, camera: Sequence[float]) -> Floats:
        """What kernels_cl/parts/surfel_grid.cl reads, (8,) float32.

        Args:
            camera: where it is (3,), m.
        """
        cells_per_metre = self.divisions / (2 * self.half_side)
        slices = 1 / math.log1p(2 / self.divisions)
        return np.array([*camera, self.half_side, cells_per_metre, slices, 0, 0], np.float32)


Grid = UniformGrid | PerspectiveGrid


class SurfelGrid:
    """Lists of the surfels in every cell, rebuilt every frame: count, prefix sum, finalise.

    Args:
        device: where it lies.
        grid: its shape.
        surfels: what is sorted.
        published: as in Ekberg 2022: every surfel in its cell and all neighbours, wave-wise scan,
            lists in any order. Otherwise only in the cells it reaches, blocked scan, lists in
            ascending order with what a lookup reads beside them, by work-items that take a cell
            each or, in the layout ``simt``, an entry each.
        entries: room in all lists together.
        normal_stretch: how much further than sideways a step along the normal counts.
        workgroup_size: work-items per group.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    def __init__(
        self,
        device: Device,
        grid: Grid,
        surfels: SurfelGeometry,
        published: bool,
        entries: int,
        normal_stretch: float,
        workgroup_size: int,
    ) -> None:
        self.device, self.grid, self.surfels = device, grid, surfels
        self.published, self.entries = published, entries
        cells = grid.cells
        data: dict[str, npt.NDArray[Any]] = {"grid_table": grid.table((0.0, 0.0, 0.0))}
        if not published:
            data["grid_cells"] = np.array([cells], np.uint32)
        held = device.allocate(self.lists(grid, published, entries, device.layout), data)
        self.table = held["grid_table"]
        # Tuned, they count back to zero every frame and are never cleared.
        # As published they become the lists' ends (kernels_cl/gibs/gather.cl).
        self.counts = held["grid_counts"]
        self.starts = held["grid_starts"]
        self.ids = held["grid_ids"]
        self.packed = held.get("grid_packed")
        self._entries = held.get("grid_entries")
        self._scan: WaveScan | BlockScan
        if published:
            self._scan = WaveScan.create(device, SCAN, cells, workgroup_size)
        else:
            self._length = held["grid_cells"]
            self._scan = BlockScan.create(device, SCAN, cells, workgroup_size)
        self.defines: Mapping[str, Any] = {
            **grid.defines,
            **LIST_MACROS,
            "CAPACITY": surfels.capacity,
            "ENTRIES": entries,
            "PUBLISHED": published,
            "BY_ENTRY": self._entries is not None,
            "ALL_NEIGHBOURS": published,
            "NORMAL_STRETCH": float(normal_stretch),
        }

    @staticmethod
    def lists(grid: Grid, published: bool, entries: int, layout: Layout) -> list[BufferSpec]:
        """The buffers of the grid and its lists, without the scan's."""
        of = BufferSpec.of
        common = [
            of("grid_table", TABLE_FLOATS, np.float32),
            of("grid_counts", grid.cells, np.uint32),
            of("grid_starts", grid.cells + 1, np.uint32),
            of("grid_ids", max(entries, 1), np.uint32),
        ]
        if published:
            return common
        packed = (PACKED_ROWS, entries + PACKED_PADDING)
        tuned = [of("grid_cells", 1, np.uint32), of("grid_packed", packed, np.float32)]
        if layout == SIMT:
            tuned.append(of("grid_entries", (max(entries, 1), 2), np.uint32))
        return [*common, *tuned]

    @staticmethod
    def buffers(
        grid: Grid,
        published: bool,
        entries: int,
        layout: Layout,
        simd_width: int,
        workgroup_size: int,
    ) -> list[BufferSpec]:
        """All its buffers.

        Args:
            grid: its shape.
            published: as the class has it.
            entries: room in all lists together.
            layout: of the tuned kernels.
            simd_width: of the profile.
            workgroup_size: work-items per group.

        Raises:
            CannotRun: the published scan cannot work with such groups.
        """
        own = SurfelGrid.lists(grid, published, entries, layout)
        if published:
            wave = wave_of(simd_width, workgroup_size)
            return [*own, *WaveScan.buffers(SCAN, grid.cells, wave)]
        return [*own, BlockScan.buffer(SCAN, grid.cells, workgroup_size)]

    def transform_and_count(self, alive: Callable[[], int]) -> list[Launch]:
        """Surfels to world space, and counted into their cells."""
        s = self.surfels
        program = self._program()
        args = (
            reads("frame", s.frame),
            reads("grid", self.table),
            reads("alive_ids", s.alive_ids),
            reads("object_ids", s.object_ids),
            reads("transforms", s.transforms),
            reads("local_position", s.local_position),
            reads("local_normal", s.local_normal),
            updates("world_position", s.world_position),
            updates("world_normal", s.world_normal),
            updates("radii", s.radii),
            updates("counts", self.counts),
        )
        count = Launch(program, "transform_and_count", args, items=alive)
        if not self.published:
            return [count]
        cells = self.grid.cells
        clear = Launch(program, "clear_counts", (writes("ends", self.counts),), items=cells)
        return [clear, count]

    def prefix_sum(self) -> list[Launch]:
        """Counts to the lists' starts."""
        if isinstance(self._scan, BlockScan):
            cells = self.grid.cells
            return self._scan.launches(self.counts, self._length, self.starts, cells)
        args = (reads("starts", self.starts), writes("ends", self.counts))
        begin = Launch(self._program(), "begin_lists", args, items=self.grid.cells)
        return [*self._scan.launches(self.counts, self.starts), begin]

    def finalise(self, alive: Callable[[], int]) -> list[Launch]:
        """IDs into the lists."""
        s = self.surfels
        program = self._program()
        args = (
            reads("frame", s.frame),
            reads("grid", self.table),
            reads("alive_ids", s.alive_ids),
            reads("world_position", s.world_position),
            reads("world_normal", s.world_normal),
            reads("radii", s.radii),
            reads("starts", self.starts),
            updates("cursors", self.counts),
            updates("ids", self.ids if self._entries is None else self._entries),
        )
        write = Launch(program, "finalise", args, items=alive)
        if self.packed is None:
            return [write]
        geometry = (
            reads("world_position", s.world_position),
            reads("world_normal", s.world_normal),
            reads("radii", s.radii),
            reads("mean", s.mean),
            reads("nearest", s.nearest),
        )
        starts, packed = reads("starts", self.starts), updates("packed", self.packed)
        if self._entries is not None:
            entries, ids = reads("entries", self._entries), updates("ids", self.ids)
            order = (starts, entries, *geometry, ids, packed)
            return [write, Launch(self._lists(), "order_lists", order, items=alive)]
        sort = (starts, updates("ids", self.ids))
        pack = (starts, reads("ids", self.ids), *geometry, packed)
        cells = self.grid.cells
        return [
            write,
            Launch(program, "sort_lists", sort, items=cells),
            Launch(program, "pack_lists", pack, items=cells),
        ]

    def refresh_irradiance(self, alive: Callable[[], int]) -> list[Launch]:
        """The present irradiance of the surfels in the lists beside these; nothing to do as
        published.
        """
        if self.packed is None:
            return []
        args = (
            reads("starts", self.starts),
            reads("ids", self.ids),
            reads("mean", self.surfels.mean),
            reads("nearest", self.surfels.nearest),
            updates("packed", self.packed),
        )
        items = self.grid.cells if self._entries is None else alive
        return [Launch(self._lists(), "pack_irradiance", args, items=items)]

    def _program(self) -> ProgramSpec:
        return ProgramSpec("parts/surfel_sort.cl", self.defines)

    def _lists(self) -> ProgramSpec:
        """What brings the lists into order and refreshes them."""
        if self._entries is None:
            return self._program()
        return ProgramSpec("parts/simt_surfel_lists.cl", self.defines)

    def entered(self) -> int:
        """Entries that surfels have in the lists, those that found no room included."""
        return int(self.device.read(self.counts if self.published else self.starts)[-1])

    def dropped(self) -> int:
        """Entries that found no room in the lists; none ever as published."""
        return 0 if self.published else max(self.entered() - self.entries, 0)

    def read_lists(self) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:
        """Bounds (cells + 1,) of every cell's list and the IDs, read back."""
        starts = self.device.read(self.starts)
        if self.published:
            ends = self.device.read(self.counts)
            starts[-1] = ends[-1]
            if not np.array_equal(starts[1:], ends):
                raise AssertionError("the lists' ends are not their successors' starts")
        return starts, self.device.read(self.ids)[: min(int(starts[-1]), self.entries)]
