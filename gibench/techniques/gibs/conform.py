"""GIBS's kernels against float64 NumPy, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.device import (
    SIMT,
    WIDE,
    Device,
    Launch,
    Layout,
    ProgramSpec,
    integer,
    reads,
    updates,
    writes,
)
from gibench.techniques.gibs import conform_life, conform_rays
from gibench.techniques.gibs.conform_oracle import (
    STRETCH,
    frame_words,
    gathered,
    geometry,
    neighbour_lists,
    random_rays,
    requested,
    updated,
)
from gibench.techniques.gibs.macros import GIBS_MACROS
from gibench.techniques.parts.conformance.case import Bench, Case, at_least, off, run
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.surfel_grid import NEIGHBOURS, SurfelGrid, UniformGrid

SURFELS, POINTS = 500, 60
BOUNDS = (np.zeros(3), np.array([1.0, 0.7, 0.9]))


def _placed(
    device: Device, rng: np.random.Generator, grid: UniformGrid, published: bool, size: int
) -> tuple[Any, SurfelGrid, Array, Array]:
    """Surfels on a few planes, facing a few ways, sorted into the grid; positions and normals."""
    position = rng.uniform(*BOUNDS, (SURFELS, 3))
    axis, rows = rng.integers(0, 3, SURFELS), np.arange(SURFELS)
    position[rows, axis] = BOUNDS[1][axis] * rng.integers(0, 4, SURFELS) / 3
    normal = 0.2 * rng.normal(size=(SURFELS, 3))
    normal[rows, axis] += rng.choice([-1, 1], SURFELS)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    camera = np.array([0.4, 0.3, 0.5])
    most = min(grid.largest_radius, 9.0)
    frame = frame_words(SURFELS, camera=camera.tolist(), angle=0.15, least=0.04, most=most)
    surfels = geometry(device, position, normal, frame)
    entries = NEIGHBOURS * surfels.capacity
    sorter = SurfelGrid(device, grid, surfels, published, entries, STRETCH, size)
    device.write(sorter.table, grid.table(camera.tolist()))
    for _ in range(2):  # the second frame must find the counts as the first did
        run(device, sorter.transform_and_count(lambda: SURFELS), size)
        run(device, sorter.prefix_sum(), size)
        run(device, sorter.finalise(lambda: SURFELS), size)
    return surfels, sorter, position, normal


def _sorted(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Every cell's list is NumPy's."""
    grid = UniformGrid.around(BOUNDS, 8)
    _, sorter, position, _ = _placed(bench.open(), rng, grid, True, size)
    starts, found = sorter.read_lists()
    expected = neighbour_lists(grid, position.astype(np.float32))
    lengths = np.diff(starts.astype(np.int64))
    yield off(lengths, np.array([len(one) for one in expected]))
    if lengths.sum() == sum(map(len, expected)):
        wanted = np.concatenate([sorted(one) for one in expected])
        got = [np.sort(found[a:b]) for a, b in pairwise(starts)]
        yield off(np.concatenate(got).astype(np.int64), wanted.astype(np.int64))


def _gather(
    bench: Bench, rng: np.random.Generator, size: int, layout: Layout | None
) -> Iterator[float]:
    """Irradiance and coverage of points: the sum over all surfels there are. ``layout``: of the
    tuned variant; None of the published one.
    """
    published = layout is None
    device, grid = bench.open(layout=layout), UniformGrid.around(BOUNDS, 8)
    surfels, sorter, position, normal = _placed(device, rng, grid, published, size)
    near = rng.integers(0, SURFELS, POINTS)
    x = (position[near] + rng.normal(scale=0.02, size=(POINTS, 3))).astype(np.float32)
    facing = normal[near] + 0.3 * rng.normal(size=(POINTS, 3))
    facing = (facing / np.linalg.norm(facing, axis=1, keepdims=True)).astype(np.float32)
    vec = 1 if published else min(8, device.vector_width)
    macros = {**SCENE_MACROS, **GIBS_MACROS, **sorter.defines}
    macros |= {"VEC": vec, "DEPTH": False, "GUIDING": False}
    out = device.empty("out", (POINTS, 4), np.float32)
    values = {
        "grid": sorter.table,
        "starts": sorter.starts,
        "ends": sorter.counts,
        "ids": sorter.ids,
        "packed": sorter.packed or sorter.ids,
        "world_position": surfels.world_position,
        "world_normal": surfels.world_normal,
        "radii": surfels.radii,
        "mean": surfels.mean,
        "moments": device.upload("moments", np.zeros((SURFELS, 48), np.float32)),
        "position": device.upload("x", x),
        "normal": device.upload("n", facing),
    }
    spec = ProgramSpec("gibs/application.cl", macros)
    args = [reads(name, value) for name, value in values.items() if value is not None]
    args += [integer("count", POINTS), writes("indirect", out)]
    launch = Launch(spec, "gather_points", args, items=POINTS)
    # What the irradiance pass changes after the sort must be what is looked up.
    mean = rng.random(surfels.mean.shape, np.float32)
    device.write(surfels.mean, mean)
    run(device, sorter.refresh_irradiance(lambda: SURFELS), size)
    run(device, [launch], size)
    radius, mean = device.read(surfels.radii), mean.T
    p, m = (
        device.read(b).T.astype(np.float64) for b in (surfels.world_position, surfels.world_normal)
    )
    yield off(p, position, absolute=1e-6)
    expected = np.array(
        [
            gathered(a.astype(np.float64), b.astype(np.float64), p, m, radius, mean, None)
            for a, b in zip(x, facing, strict=True)
        ]
    )
    yield at_least(float(np.mean(expected[:, 3] > 0.1)), 0.2)
    yield off(device.read(out), expected, absolute=2e-5)


def _irradiance_program(surfels: int, floored: bool = True) -> ProgramSpec:
    macros = {**SCENE_MACROS, **GIBS_MACROS, **UniformGrid.around(BOUNDS, 4).defines}
    macros |= {"CAPACITY": surfels, "ENTRIES": 27 * surfels, "PUBLISHED": False, "VEC": 1}
    macros |= {"ALL_NEIGHBOURS": False, "NORMAL_STRETCH": STRETCH, "DEPTH": True, "GUIDING": True}
    return ProgramSpec("gibs/irradiance.cl", {**macros, "FLOORED": floored})


def _requests(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Rays asked for, and the frame's shared out in proportion, exactly."""
    device, n, rays, now = bench.open(), 313, 501, 101
    estimator = rng.uniform(0, 6, (12, n)).astype(np.float32)
    seen = rng.integers(now - 40, now + 1, n).astype(np.uint32)
    asked = requested(estimator[10].astype(np.float64), now - seen.astype(np.int64))
    ids = device.upload("ids", rng.permutation(n).astype(np.uint32))
    frame = device.upload("frame", frame_words(n, frame=now, rays=rays))
    requests = device.empty("requests", n, np.uint32)
    args = (
        reads("frame", frame),
        reads("alive_ids", ids),
        reads("estimator", device.upload("estimator", estimator)),
        reads("seen", device.upload("seen", seen)),
        writes("requests", requests),
    )
    program = _irradiance_program(n)
    run(device, [Launch(program, "request_rays", args, items=n)], size)
    order = device.read(ids)
    expected, share = asked[order], estimator[10, order].astype(np.float64)
    # What float32 may round across a whole number of units is left out.
    units = 256 * np.where(now - seen[order].astype(np.int64) <= 16, 1, 0.25) * (0.125 + share)
    certain = (np.abs(units - np.rint(units)) > 1e-3) | (share > 4)
    yield at_least(float(certain.mean()), 0.9)
    yield off(device.read(requests)[certain].astype(np.float64), expected[certain])
    before = np.concatenate([[0], np.cumsum(expected)]).astype(np.uint32)
    first, owner = device.empty("first", n + 1, np.uint32), device.empty("owner", rays, np.uint32)
    shared = (
        reads("frame", frame),
        reads("before", device.upload("before", before)),
        writes("ray_first", first),
        writes("ray_owner", owner),
    )
    run(device, [Launch(program, "assign_rays", shared, items=n)], size)
    got: Array = np.diff(device.read(first).astype(np.int64))
    yield off(np.array(got.sum()), np.array(rays))
    yield off(device.read(owner).astype(np.int64), np.repeat(np.arange(n), got))
    yield off(got.astype(np.float64), expected * rays / expected.sum(), absolute=1.0)


def _update(bench: Bench, rng: np.random.Generator, size: int, floored: bool) -> Iterator[float]:
    """Surfels take in their rays: estimator, depth moments, guide."""
    n, device = 37, bench.open()
    rays, before = random_rays(rng, n, floored)
    expected = updated(rays, before.estimator, before.moments, before.guides, floored)
    estimator = device.upload("estimator", before.estimator)
    moments = device.upload("moments", before.moments)
    guides = device.upload("guides", before.guides)
    nearest = device.empty("nearest", n, np.float32)
    args = (
        reads("frame", device.upload("frame", frame_words(n))),
        reads("alive_ids", device.upload("ids", rays.ids)),
        reads("ray_first", device.upload("first", rays.first)),
        reads("ray_light", device.upload("light", rays.light)),
        reads("ray_choice", device.upload("choice", rays.choice)),
        reads("radii", device.upload("radii", rays.radii)),
        updates("estimator", estimator),
        updates("moments", moments),
        writes("nearest", nearest),
        updates("guides", guides),
    )
    program = _irradiance_program(n, floored)
    run(device, [Launch(program, "update_surfels", args, items=n)], size)
    # A step from m to a sample near 0 leaves the rounding of m, which is of order 1.
    rounding = 4 * float(np.finfo(np.float32).eps)
    yield at_least(float(expected.certain.mean()), 0.5)
    found = device.read(estimator)[:, expected.certain]
    yield off(found, expected.estimator[:, expected.certain], 2e-4, 1e-5)
    yield off(device.read(moments), expected.moments, 1e-5, rounding)
    yield off(device.read(guides), expected.guides, 1e-5, rounding)
    yield off(device.read(nearest), expected.moments[:, :16].min(axis=1), 1e-5, rounding)


def _coverage(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Every tile's least covered pixel."""
    device, width, height = bench.open(), 50, 37
    covered = rng.choice([0.0, 0.25, 0.9999, 1.0, 3.7, 1e9], (height, width))
    surface = rng.random((height, width)) < 0.8
    g = np.zeros((height, width, 4), np.float32)
    g[..., 3] = np.where(surface, 3, 0).astype(np.int32).view(np.float32)
    indirect = np.zeros((height, width, 4), np.float32)
    indirect[..., 3] = covered
    across, down = -(-width // 16), -(-height // 16)
    least = device.empty("least", across * down, np.uint32)
    args = (
        reads("g_position", device.upload("g", g)),
        reads("indirect", device.upload("indirect", indirect)),
        integer("width", width),
        integer("height", height),
        writes("least", least),
    )
    macros = {**SCENE_MACROS, **GIBS_MACROS, **UniformGrid.around(BOUNDS, 4).defines}
    macros |= {"CAPACITY": 10}
    macros |= {"ENTRIES": 270, "PUBLISHED": False, "ALL_NEIGHBOURS": False, "VEC": 1}
    macros |= {"NORMAL_STRETCH": STRETCH, "DEPTH": True, "GUIDING": True, "FLOORED": True}
    launch = Launch(ProgramSpec("gibs/life.cl", macros), "coverage", args, groups=across * down)
    run(device, [launch], size)
    expected = np.full(across * down, 0xFFFFFFFF, np.int64)
    steps = np.minimum(np.rint(np.float32(covered) * np.float32(4096)), 2**24 - 1)
    for y, x in np.argwhere(surface):
        tile = y // 16 * across + x // 16
        expected[tile] = min(expected[tile], int(steps[y, x]) << 8 | (y % 16) * 16 + x % 16)
    yield off(device.read(least).astype(np.int64), expected)


_SORT = "parts/surfel_sort.cl"
_TUNED_LISTS: tuple[tuple[Layout, str, tuple[str, ...]], ...] = (
    (WIDE, _SORT, ("sort_lists", "pack_lists", "pack_irradiance")),
    (SIMT, "parts/simt_surfel_lists.cl", ("order_lists", "pack_irradiance")),
)
CASES = [
    Case(
        "Surfels sorted into cells (published)",
        tuple(
            f"{_SORT}:{name}"
            for name in ("clear_counts", "transform_and_count", "begin_lists", "finalise")
        ),
        _sorted,
    ),
    Case(
        "GIBS's gather (published)",
        ("gibs/application.cl:gather_points", f"{_SORT}:finalise"),
        partial(_gather, layout=None),
        (7, 64),
    ),
    *(
        Case(
            f"GIBS's gather ({layout})",
            ("gibs/application.cl:gather_points", *(f"{file}:{name}" for name in kernels)),
            partial(_gather, layout=layout),
            (7, 64),
        )
        for layout, file, kernels in _TUNED_LISTS
    ),
    Case(
        "GIBS's rays asked for and shared out",
        ("gibs/irradiance.cl:request_rays", "gibs/irradiance.cl:assign_rays"),
        _requests,
    ),
    *(
        Case(
            f"GIBS's estimator ({'floored' if floored else 'as published'})",
            ("gibs/irradiance.cl:update_surfels",),
            partial(_update, floored=floored),
        )
        for floored in (True, False)
    ),
    Case("GIBS's coverage of tiles", ("gibs/life.cl:coverage",), _coverage),
    *conform_rays.CASES,
    *conform_life.CASES,
]
