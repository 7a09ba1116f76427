"""Sorting surfels into the grid (count, scan, finalise) against what is there to buy.

Run with ``pytest tests/benchmarks/bench_gibs_sort.py --benchmark-enable -s``. One job: from the
positions, normals and radii of surfels on the walls of a box to the list of surfels of every cell
they reach. In alternating rounds of one run:

  gibs       transform_and_count, prefix_sum and finalise of the tuned variant, lists in ID order
  numpy      the cells by NumPy, then argsort (its default: AVX-512 where there is)
  radix      the cells by ListOfListsBuilder, then pyopencl.algorithm.RadixSort of (cell, surfel)
  argsort    np.argsort alone, of cells that are already known (no job of its own, for reference)

The last one is given for free what the first two must work out: which cells a surfel reaches.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))  # the tests' helpers
from support.gibs_surfels import STRETCH, frame_words, geometry, surfel_grid

from gibench.device import Device, kernel_source
from gibench.profiles import load_profile
from gibench.techniques.parts.surfel_grid import UniformGrid

WORKGROUP = 256
ROUNDS = 7
FACTOR = 2.0


def walls(n, rng):
    """Points on eight planes across each axis of the unit cube, in the order of 16 x 16 tiles that
    placement visits: by plane, then by patch.
    """
    axis, plane = rng.integers(0, 3, n), rng.integers(0, 8, n)
    position = rng.random((n, 3))
    patch = np.floor(position[:, [0, 1]] * 40) @ [40, 1]
    order = np.lexsort((patch, plane, axis))
    axis, plane, position = axis[order], plane[order], position[order]
    position[np.arange(n), axis] = plane / 7
    normal = np.zeros((n, 3))
    normal[np.arange(n), axis] = 1
    return position.astype(np.float32), normal.astype(np.float32)


def numpy_entries(grid, position, normal, radius):
    """The cells (e,) every surfel reaches and the surfel of each, by NumPy in float32."""
    table = grid.table((0, 0, 0))
    lower, cell, inverse = table[:3], table[3], table[4]
    thick = np.float32(radius / STRETCH)
    extent = np.sqrt(np.float32(radius**2) * (1 - normal * normal) + (thick * normal) ** 2)
    extent *= np.float32(1.0001)
    first = np.floor((position - extent - lower) * inverse).astype(np.int32)
    last = np.floor((position + extent - lower) * inverse).astype(np.int32)
    reach = (thick + cell / 2 * np.abs(normal).sum(1)) * np.float32(1.0001)
    surfels = np.arange(len(position), dtype=np.int32)
    cells, owners = [], []
    nx, ny, _ = grid.shape
    for z in range(3):
        for y in range(3):
            for x in range(3):
                at = first + np.array([x, y, z], np.int32)
                inside = (at <= last).all(1)
                centre = lower + (at + np.float32(0.5)) * cell
                inside &= np.abs(((centre - position) * normal).sum(1)) <= reach
                cells.append(((at[:, 2] * ny + at[:, 1]) * nx + at[:, 0])[inside])
                owners.append(surfels[inside])
    return np.concatenate(cells), np.concatenate(owners)


def numpy_lists(cells, owners, count):
    order = np.argsort(cells)
    starts = np.zeros(count + 1, np.int64)
    np.cumsum(np.bincount(cells, minlength=count), out=starts[1:])
    return starts, owners[order]


class PyOpenCL:
    """ListOfListsBuilder for the cells of every surfel, RadixSort of the pairs."""

    def __init__(self, device, sorter, n):
        from pyopencl import array
        from pyopencl.algorithm import ListOfListsBuilder, RadixSort

        self.queue, self.n = device.queue, n
        s = sorter.surfels
        self.inputs = [
            array.Array(self.queue, (int(np.prod(b.shape)),), b.dtype, data=b.mem)
            for b in (sorter.table, s.world_position, s.world_normal, s.radii)
        ]
        macros = {**sorter.defines, "ALL_NEIGHBOURS": 0, "PUBLISHED": 0}
        macros["NORMAL_STRETCH"] = f"{STRETCH}f"
        preamble = "".join(f"#define {k} {v}\n" for k, v in macros.items())
        preamble += kernel_source("parts/surfels.cl") + kernel_source("parts/surfel_grid.cl")
        template = r"""//CL//
            void generate(LIST_ARG_DECL USER_ARG_DECL index_type i)
            {
                const float3 p = surfel_load3(position, i), n = surfel_load3(normal, i);
                GRID_FOR_EACH(grid, p, n, radii[i], cell, APPEND_cells((uint)cell);
                              APPEND_owners(i))
            }
        """
        self.build = ListOfListsBuilder(
            device.context,
            [("cells", np.uint32), ("owners", np.uint32)],
            template,
            arg_decls="__global float *grid, __global float *position, __global float *normal, "
            "__global float *radii",
            preamble=preamble,
            count_sharing={"owners": "cells"},
        )
        self.sort = RadixSort(
            device.context,
            "uint *cells, uint *owners",
            key_expr="cells[i]",
            sort_arg_names=["cells", "owners"],
        )
        self.bits = int(np.ceil(np.log2(sorter.grid.cells)))

    def run(self):
        lists, _ = self.build(self.queue, self.n, *self.inputs)
        (cells, owners), _ = self.sort(
            lists["cells"].lists, lists["owners"].lists, key_bits=self.bits
        )
        self.queue.finish()
        return cells, owners


@pytest.mark.slow
@pytest.mark.parametrize(("n", "divisions"), [(50_000, 32), (1_000_000, 96)])
def test_sorting_is_twice_as_fast_as_the_best_of_the_others(request, n, divisions):
    if not request.config.getoption("--benchmark-enable"):
        pytest.skip("a benchmark: run it with --benchmark-enable")
    pytest.importorskip("mako", reason="pyopencl.algorithm needs Mako")
    rng = np.random.default_rng(1)
    position, normal = walls(n, rng)
    grid = UniformGrid.around((np.zeros(3), np.ones(3)), divisions)
    radius = 0.5 * grid.cell
    device = Device(load_profile("vega56"))
    surfels = geometry(device, position, normal, frame_words(n, least=radius, most=radius))
    sorter = surfel_grid(device, grid, surfels, published=False, entries=16 * n)
    passes = (
        *sorter.transform_and_count(lambda: n),
        *sorter.prefix_sum(),
        # Without the copies for lookups, which none of the others makes.
        *(one for one in sorter.finalise(lambda: n) if one.kernel != "pack_lists"),
    )
    launches = [device.prepare(one, WORKGROUP) for one in passes]

    def ours():
        for launch in launches:
            launch.enqueue(device.queue)
        device.queue.finish()

    ours()
    starts, ids = sorter.read_lists()
    theirs = PyOpenCL(device, sorter, n)

    def by_numpy():
        return numpy_lists(*numpy_entries(grid, position, normal, radius), grid.cells)

    known = numpy_entries(grid, position, normal, radius)[0]
    jobs = {
        "gibs": ours,
        "numpy": by_numpy,
        "radix": theirs.run,
        "argsort": lambda: np.argsort(known),
    }
    # The same job: the same lists.
    numpy_starts, numpy_ids = by_numpy()
    assert abs(len(numpy_ids) - len(ids)) < 1e-3 * len(ids)  # rounding at cell borders
    cells, _ = theirs.run()
    np.testing.assert_array_equal(np.diff(starts), np.bincount(cells.get(), minlength=grid.cells))
    assert numpy_starts[-1] == len(numpy_ids)

    best = dict.fromkeys(jobs, np.inf)
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            begin = time.perf_counter()
            job()
            best[name] = min(best[name], time.perf_counter() - begin)
    print(f"\n{n} surfels, {len(ids) / n:.1f} cells each, {grid.cells} cells")
    for name, seconds in best.items():
        print(f"  {name:8} {seconds * 1e3:9.2f} ms")
    assert best["gibs"] * FACTOR <= min(best["numpy"], best["radix"])
