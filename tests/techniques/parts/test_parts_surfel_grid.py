"""Surfels in the grid's cells: every list equals NumPy's, for both variants and both grids."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.gibs_surfels import (
    frame_words,
    geometry,
    neighbour_lists,
    run,
    sort_launches,
    surfel_grid,
    uniform_coordinates,
    unit_vectors,
)
from support.pairwise import few

from gibench.device import SIMT, WIDE, Device
from gibench.profiles import load_profile
from gibench.techniques.parts.surfel_grid import PerspectiveGrid, UniformGrid

STRETCH = 4.0
BOUNDS = (np.array([-1.0, 0.0, 2.0]), np.array([1.0, 1.5, 3.0]))
UNIFORM = UniformGrid.around(BOUNDS, 9)
CAPACITY = 801  # one program for all of them


def any_size_device(layout=None):
    profile = replace(load_profile("vega56"), simd_width=1, max_workgroup_size=4096)
    return Device(profile, layout=layout)


def random_positions(kind, rng):
    low, high = BOUNDS
    within = rng.uniform(low, high, (250, 3))
    lower, cell = np.array(UNIFORM.lower), UNIFORM.cell
    return {
        "random": within,
        "few, most cells empty": within[:5],
        "none": within[:0],
        "one cell": lower + (np.array([4, 3, 2]) + rng.uniform(0.4, 0.6, (300, 3))) * cell,
        "on borders": lower + rng.integers(0, np.array(UNIFORM.shape) + 1, (400, 3)) * cell,
        "on the bounds": np.where(rng.random((300, 3)) < 0.5, low, high),
        "outside": within + rng.choice([-5.0, 0.0, 7.0], (250, 3)),
    }[kind]


KINDS = ("random", "few, most cells empty", "none", "one cell", "on borders", "on the bounds",
         "outside")  # fmt: skip


def kinds_and_sizes(*sizes):
    """Every kind with one of the first two work-group sizes in turn, and the first kind with both;
    the others are slow.
    """
    return [
        pytest.param(
            kind,
            size,
            marks=()
            if size in (sizes[:2] if n == 0 else sizes[n % 2 : n % 2 + 1])
            else pytest.mark.slow,
        )
        for n, kind in enumerate(KINDS)
        for size in sizes
    ]


def sorted_lists(
    rng, device, grid, position, normal, radius, published, size=64, entries=None, **frame
):
    """Every cell's list of IDs; IDs are not the places in the list of the living."""
    n = len(position)
    ids = rng.permutation(CAPACITY)[:n]
    words = frame_words(n, least=radius, most=radius, **frame)
    surfels = geometry(device, position, normal, words, ids, CAPACITY)
    sorter = surfel_grid(device, grid, surfels, published, entries, STRETCH, size)
    device.write(sorter.table, grid.table(frame.get("camera", (0, 0, 0))))
    for _ in range(2):  # the second frame must find the counts as the first did
        run(device, sort_launches(sorter, n), size)
    starts, found = sorter.read_lists()
    place = np.full(CAPACITY, -1)
    place[ids] = np.arange(n)
    lists = [found[a:b] for a, b in pairwise(starts)]
    if not published:
        assert all(np.all(np.diff(one.astype(np.int64)) > 0) for one in lists)
    return [set(place[one]) for one in lists], [len(one) for one in lists], sorter


@pytest.mark.parametrize(("kind", "size"), kinds_and_sizes(24, 256, 2))
def test_published_lists_hold_the_cell_and_all_neighbours(rng, kind, size):
    position = random_positions(kind, rng).astype(np.float32)
    normal = unit_vectors(len(position), rng)
    device = any_size_device()
    lists, lengths, _ = sorted_lists(
        rng, device, UNIFORM, position, normal, UNIFORM.cell, True, size=size
    )
    expected = neighbour_lists(UNIFORM, position)
    assert lists == expected
    assert lengths == [len(one) for one in expected]  # and none twice


def reached_lists(grid, position, normal, radius):
    """Float64: (surely in, surely out) per cell, by the box of the surfel's ellipsoid and, away
    from the border, its slab along the normal. What rounding may decide is in neither.
    """
    p, n = position.astype(np.float64), normal.astype(np.float64)
    lower, cell, shape = np.array(grid.lower), grid.cell, np.array(grid.shape)
    at = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
    index = (at[:, 2] * shape[1] + at[:, 1]) * shape[0] + at[:, 0]
    low = np.where(at == 0, -np.inf, lower + at * cell)
    high = np.where(at == shape - 1, np.inf, lower + (at + 1) * cell)
    thick = radius / STRETCH
    extent = np.sqrt(radius**2 * (1 - n**2) + (thick * n) ** 2)
    result = []
    for k in range(len(p)):
        apart = np.maximum(low - (p[k] + extent[k]), (p[k] - extent[k]) - high).max(axis=1)
        box = np.clip(np.floor((p[k] + np.outer([-1, 1], extent[k]) - lower) / cell), 0, shape - 1)
        touches_x = box[0, 0] == 0 or box[1, 0] == shape[0] - 1
        border = touches_x | (at[:, 1:] == 0).any(1) | (at[:, 1:] == shape[1:] - 1).any(1)
        centre = lower + (at + 0.5) * cell
        beyond = np.abs((centre - p[k]) @ n[k]) - thick - cell / 2 * np.abs(n[k]).sum()
        apart = np.where(border, apart, np.maximum(apart, beyond))
        result.append((set(index[apart < -2e-3 * cell]), set(index[apart > 2e-3 * cell])))
    return result


@pytest.mark.parametrize(("kind", "size"), kinds_and_sizes(24, 256, 1))
def test_tuned_lists_hold_the_cells_that_are_reached(rng, kind, size):
    position = random_positions(kind, rng).astype(np.float32)
    normal = unit_vectors(len(position), rng)
    normal[::3] = np.eye(3, dtype=np.float32)[rng.integers(0, 3, len(normal[::3]))]
    radius = 0.7 * UNIFORM.cell
    lists, lengths, _ = sorted_lists(
        rng, any_size_device(), UNIFORM, position, normal, radius, False, size=size
    )
    assert lengths == [len(one) for one in lists]
    cells_of = [set() for _ in position]
    for cell, one in enumerate(lists):
        for surfel in one:
            cells_of[surfel].add(cell)
    decided = 0
    for got, (inside, outside) in zip(
        cells_of, reached_lists(UNIFORM, position, normal, radius), strict=True
    ):
        assert inside <= got
        assert not outside & got
        decided += len(inside)
    assert decided or not len(position)


@pytest.mark.parametrize("size", few([1, 24, 256], (24, 256)))
def test_tuned_lists_hold_the_present_irradiance_beside_them(rng, size):
    """A row for each of the mean's channels and of the nearest hits follows the surfels; the others
    (place, normal, radius) stay.
    """
    position = random_positions("random", rng).astype(np.float32)
    normal, device = unit_vectors(len(position), rng), any_size_device()
    radius = 0.7 * UNIFORM.cell
    _, _, sorter = sorted_lists(rng, device, UNIFORM, position, normal, radius, False, size=size)
    surfels, (_, ids) = sorter.surfels, sorter.read_lists()
    before = device.read(sorter.packed)[:, : len(ids)]
    mean, nearest = (rng.random(one.shape, np.float32) for one in (surfels.mean, surfels.nearest))
    device.write(surfels.mean, mean)
    device.write(surfels.nearest, nearest)
    run(device, sorter.refresh_irradiance(lambda: len(position)), size)
    after = device.read(sorter.packed)[:, : len(ids)]
    changed = np.flatnonzero((after != before).any(axis=1))
    assert len(changed) == 4 and len(ids) > len(position)
    np.testing.assert_array_equal(after[changed], [*mean[:, ids], nearest[ids]])


@pytest.mark.parametrize(
    ("kind", "size"), [("random", 24), ("one cell", 256), ("none", 7), ("random", 1)]
)
def test_lists_by_entry_are_those_by_cell(rng, kind, size):
    """In the layout simt a work-item takes an entry: the same lists, and what lies beside them."""
    position = random_positions(kind, rng).astype(np.float32)
    normal, seed = unit_vectors(len(position), rng), int(rng.integers(2**32))
    starts, ids, packed = {}, {}, {}
    for layout in (WIDE, SIMT):
        device, same = any_size_device(layout), np.random.default_rng(seed)
        _, _, sorter = sorted_lists(
            same, device, UNIFORM, position, normal, 0.7 * UNIFORM.cell, False, size
        )
        surfels = sorter.surfels
        for one in (surfels.mean, surfels.nearest):
            device.write(one, same.random(one.shape, np.float32))
        run(device, sorter.refresh_irradiance(lambda: len(position)), size)
        starts[layout], ids[layout] = sorter.read_lists()
        packed[layout] = device.read(sorter.packed)[:, : len(ids[layout])]
        kept = (surfels.world_position, surfels.world_normal, surfels.mean, surfels.nearest)
        place, normals, mean, nearest = (device.read(one)[..., ids[layout]] for one in kept)
        inverse = np.float32(1) / device.read(surfels.radii)[ids[layout]]
        np.testing.assert_array_equal(packed[layout][:6], [*place, *normals])
        np.testing.assert_allclose(packed[layout][6], inverse, rtol=4e-7)  # 2.5 ulp
        np.testing.assert_array_equal(packed[layout][7:], [*mean, nearest])
    np.testing.assert_array_equal(starts[SIMT], starts[WIDE])
    np.testing.assert_array_equal(ids[SIMT], ids[WIDE])
    assert len(ids[SIMT]) > len(position) or kind in ("none", "one cell")


def test_entries_that_find_no_room_are_left_out_by_entry_too(rng):
    """Half of the room: what there is of every list is ascending and belongs there."""
    position = random_positions("random", rng).astype(np.float32)
    normal, radius = unit_vectors(len(position), rng), 0.7 * UNIFORM.cell
    whole, seed = [], int(rng.integers(2**32))
    for entries in (None, 200):
        lists, _, sorter = sorted_lists(
            np.random.default_rng(seed),
            any_size_device(SIMT),
            UNIFORM,
            position,
            normal,
            radius,
            False,
            24,
            entries,
        )
        whole.append(lists)
    assert sorter.dropped() == sum(map(len, whole[0])) - 200 > 0
    assert sum(map(len, whole[1])) == 200
    assert all(some <= one for one, some in zip(*whole, strict=True))


def perspective_cells(grid, position, camera):
    """Float64: every point's cell, and how far it is from the nearest border, in cells."""
    p = position.astype(np.float64) - camera
    depth = np.abs(p).max(axis=1)
    n, half = grid.divisions, grid.half_side
    cells, margins = np.zeros(len(p), int), np.zeros(len(p))
    for k in range(len(p)):
        if depth[k] < half:
            at = (p[k] + half) * n / (2 * half)
            base, inner = 0, abs(half - depth[k]) / half
        else:
            axis = int(np.argmax(np.abs(p[k])))
            face = 2 * axis + (p[k][axis] < 0)
            sideways = p[k][[(axis + 1) % 3, (axis + 2) % 3]] / depth[k]
            slab = np.log(depth[k] / half) / np.log1p(2 / n)
            at = np.array([*((sideways + 1) * n / 2), slab])
            base = n * n * (n + face * grid.slices)
            inner = abs(half - depth[k]) / half
        whole = np.floor(at).astype(int)
        whole = np.minimum(whole, [n - 1, n - 1, (n if base == 0 else grid.slices) - 1])
        margins[k] = min(np.abs(at - np.round(at)).min(), inner)
        cells[k] = base + (whole[2] * n + whole[1]) * n + whole[0]
    return cells, margins


@pytest.mark.parametrize("published", [True, False])
def test_perspective_lists_hold_every_surfel_that_weighs_in_the_cell(rng, published):
    """Points strewn over each surfel's disk lie in cells whose lists hold the surfel."""
    grid = PerspectiveGrid(half_side=0.5, divisions=8, slices=20)
    camera = np.array([0.3, 0.8, 2.5])
    scale = np.exp(rng.uniform(-3, 1.5, (400, 1)))
    position = (camera + unit_vectors(400, rng) * scale).astype(np.float32)
    normal = unit_vectors(400, rng)
    device = any_size_device()
    n = len(position)
    frame = frame_words(n, camera=camera, angle=0.1, least=1e-3, most=np.inf)
    surfels = geometry(device, position, normal, frame)
    sorter = surfel_grid(device, grid, surfels, published, stretch=STRETCH)
    device.write(sorter.table, grid.table(camera))
    run(device, sort_launches(sorter, n))
    starts, ids = sorter.read_lists()
    lists = [set(ids[a:b]) for a, b in pairwise(starts)]
    assert sum(map(len, lists)) == len(ids) >= n
    radius = 0.1 * np.linalg.norm(position - camera, axis=1)
    for k in range(n):
        away = rng.normal(size=(40, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        away *= rng.uniform(0, 0.999, (40, 1)) * radius[k]
        off = away @ normal[k]
        away += np.outer(off * (1 / STRETCH - 1), normal[k])  # into the ellipsoid
        cells, margins = perspective_cells(grid, (position[k] + away).astype(np.float32), camera)
        assert all(k in lists[c] for c, m in zip(cells, margins, strict=True) if m > 1e-4)
    # And the lists are worth having: a surfel goes into few of all the cells.
    assert len(ids) < 60 * n


def test_objects_carry_their_surfels(rng):
    position, normal = rng.uniform(0, 1, (300, 3)), unit_vectors(300, rng)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shift = rng.normal(size=3)
    transform = np.concatenate([turn, shift[:, None]], axis=1).reshape(1, 12).astype(np.float32)
    device = any_size_device()
    camera = np.array([0.5, -2.0, 1.0])
    words = frame_words(300, camera=camera, angle=0.05, least=0.06, most=0.11)
    surfels = geometry(device, position, normal, words, transforms=transform)
    sorter = surfel_grid(device, UNIFORM, surfels, published=False)
    run(device, sort_launches(sorter, 300))
    moved = device.read(surfels.world_position).T
    np.testing.assert_allclose(moved, position @ turn.T + shift, atol=2e-6)
    np.testing.assert_allclose(device.read(surfels.world_normal).T, normal @ turn.T, atol=2e-6)
    away = np.linalg.norm(moved - camera, axis=1)
    np.testing.assert_allclose(
        device.read(surfels.radii), np.clip(0.05 * away, 0.06, 0.11), rtol=1e-5
    )
    starts, ids = sorter.read_lists()
    at = uniform_coordinates(UNIFORM, moved)
    home = (at[:, 2] * UNIFORM.shape[1] + at[:, 1]) * UNIFORM.shape[0] + at[:, 0]
    assert all(k in ids[starts[home[k]] : starts[home[k] + 1]] for k in range(300))


def test_what_finds_no_room_is_dropped_and_nothing_else_is_touched(rng):
    position = random_positions("random", rng).astype(np.float32)
    device = any_size_device()
    n = len(position)
    surfels = geometry(device, position, unit_vectors(n, rng), frame_words(n, least=0.1, most=0.1))
    sorter = surfel_grid(device, UNIFORM, surfels, published=False, entries=n)
    run(device, sort_launches(sorter, n))
    starts, ids = device.read(sorter.starts), device.read(sorter.ids)
    assert starts[-1] > n == len(ids)
    assert sorter.dropped() == starts[-1] - n
    assert np.all(device.read(sorter.counts) == 0)
    assert set(ids) <= set(range(n))
