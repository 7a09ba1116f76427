"""GIBS's gathering, depth test and coverage against independent float64 NumPy on random inputs."""

import numpy as np
import pyopencl as cl
import pytest
from support.gibs_surfels import (
    BOUNDS,
    STRETCH,
    any_size_device,
    defines,
    frame_words,
    geometry,
    run,
    sort_launches,
    surfel_grid,
    unit_vectors,
)
from support.launches import launch_of
from support.pairwise import few, pairwise
from support.vector_widths import skip_too_wide

from gibench.device import kernel_source
from gibench.device.build import macro_options
from gibench.techniques.gibs.conform_oracle import gathered
from gibench.techniques.gibs.macros import GIBS_MACROS
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.surfel_grid import PerspectiveGrid, UniformGrid

# -- gathering --------------------------------------------------------------------------------


GATHERS = [(1, True), *((v, False) for v in (1, 8, 16))]


@pytest.mark.parametrize(
    ("kind", "vec_and_published", "depth"),
    pairwise(
        ["uniform", "perspective"], GATHERS, [False, True], more={1: [(2, False), (4, False)]}
    ),
)
def test_gathering_equals_the_sum_over_all_surfels(rng, kind, vec_and_published, depth):
    vec, published = vec_and_published
    skip_too_wide(vec)
    n, points = 1200, 200
    # Surfels on a few planes, facing a few ways, as in a scene.
    position = rng.uniform(*BOUNDS, (n, 3))
    axis = rng.integers(0, 3, n)
    position[np.arange(n), axis] = BOUNDS[1][axis] * rng.integers(0, 4, n) / 3
    normal = 0.2 * rng.normal(size=(n, 3))
    normal[np.arange(n), axis] += rng.choice([-1, 1], n)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    camera = np.array([0.4, 0.3, 0.5])
    grid = UniformGrid.around(BOUNDS, 8) if kind == "uniform" else PerspectiveGrid(0.2, 8, 12)
    device = any_size_device()
    frame = frame_words(n, camera=camera, angle=0.15, least=0.04, most=min(grid.largest_radius, 9))
    surfels = geometry(device, position, normal, frame)
    moments = np.zeros((n, 48), np.float32)
    moments[:, :16] = rng.uniform(0.02, 0.3, (n, 16))
    moments[:, 16:32] = moments[:, :16] ** 2 + rng.uniform(1e-4, 1e-2, (n, 16))
    device.write(surfels.nearest, moments[:, :16].min(1))
    sorter = surfel_grid(device, grid, surfels, published, stretch=STRETCH)
    device.write(sorter.table, grid.table(camera))
    run(device, sort_launches(sorter, n))

    near = rng.integers(0, n, points)
    x = (position[near] + rng.normal(scale=0.02, size=(points, 3))).astype(np.float32)
    facing = (normal[near] + 0.3 * rng.normal(size=(points, 3))).astype(np.float32)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    program = device.program(
        "gibs/application.cl",
        {**SCENE_MACROS, **GIBS_MACROS, **sorter.defines}
        | {"VEC": vec, "DEPTH": depth, "GUIDING": False},
    )
    out = device.empty("out", (points, 4), np.float32)
    args = (
        sorter.table,
        sorter.starts,
        sorter.counts,
        sorter.ids,
        sorter.packed or sorter.ids,
        surfels.world_position,
        surfels.world_normal,
        surfels.radii,
        surfels.mean,
        device.upload("moments", moments),
        device.upload("x", x),
        device.upload("n", facing),
        np.int32(points),
        out,
    )
    run(device, [launch_of(program, "gather_points", args, items=points)])
    radius, mean = device.read(surfels.radii), device.read(surfels.mean).T
    p, m = (device.read(b).T.astype(np.float64) for b in (surfels.world_position,
                                                         surfels.world_normal))  # fmt: skip
    expected = [
        gathered(a.astype(np.float64), b.astype(np.float64), p, m, radius, mean,
                 moments.astype(np.float64) if depth else None)
        for a, b in zip(x, facing, strict=True)
    ]  # fmt: skip
    # The depth test's arc tangent is good to 0.002 (kernels_cl/gibs/depth.cl), moments differ by
    # 0.3 m from texel to texel, and the bound's cube is steep.
    tolerance = 0.02 if depth else 2e-5
    np.testing.assert_allclose(device.read(out), expected, atol=tolerance)
    assert np.mean(np.array(expected)[:, 3] > 0.1) > 0.2


def test_hemisphere_texels_are_equally_likely_and_found_again(rng):
    """16 texels, area-preserving: directions through the centres and random ones come back."""
    device = any_size_device()
    source = (
        kernel_source("gibs/depth.cl")
        + """
    __kernel void round_trip(__global const float *normal, __global const float2 *square,
                             __global float *direction, __global float2 *back)
    {
        const int i = get_global_id(0);
        const float3 d = hemisphere_direction(load3(normal, i), square[i]);
        store3(direction, i, d);
        back[i] = hemisphere_square(load3(normal, i), d);
    }"""
    )
    n = 4096
    normal = unit_vectors(n, rng)
    square = rng.uniform(-1, 1, (n, 2)).astype(np.float32)
    out = device.empty("direction", (n, 3), np.float32), device.empty("back", (n, 2), np.float32)
    built = cl.Program(device.context, source).build([*macro_options(GIBS_MACROS)])
    built.round_trip(device.queue, (n,), (64,), device.upload("n", normal).mem,
                     device.upload("s", square).mem, out[0].mem, out[1].mem)  # fmt: skip
    direction, back = map(device.read, out)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(back, square, atol=4e-3)
    cosine = (direction.astype(np.float64) * normal).sum(1)
    # Cosine-distributed: cos^2 is uniform in [0, 1]; 4096 samples, 5 standard errors.
    assert abs(np.mean(cosine**2) - 0.5) < 5 * np.sqrt(1 / 12 / n)
    assert np.all(cosine >= 0)


# -- coverage ---------------------------------------------------------------------------------


@pytest.mark.parametrize("size", few([1, 24, 64, 256, 512], (24, 64, 512)))
@pytest.mark.parametrize(("width", "height"), [(16, 16), (50, 37), (7, 3)])
def test_every_tile_finds_its_least_covered_pixel(rng, size, width, height):
    covered = rng.choice([0.0, 0.25, 0.9999, 1.0, 3.7, 1e9], (height, width))
    surface = rng.random((height, width)) < 0.8
    g = np.zeros((height, width, 4), np.float32)
    g[..., 3] = np.where(surface, 3, 0).astype(np.int32).view(np.float32)
    indirect = np.zeros((height, width, 4), np.float32)
    indirect[..., 3] = covered
    across, down = -(-width // 16), -(-height // 16)
    device = any_size_device()
    least = device.empty("least", across * down, np.uint32)
    args = (
        device.upload("g", g),
        device.upload("indirect", indirect),
        np.int32(width),
        np.int32(height),
        least,
    )
    program = device.program("gibs/life.cl", defines(10))
    run(device, [launch_of(program, "coverage", args, groups=across * down)], size)
    expected = np.full(across * down, 0xFFFFFFFF, np.uint64)
    steps = np.minimum(np.rint(np.float32(covered) * np.float32(4096)), 2**24 - 1)
    for y in range(height):
        for x in range(width):
            if surface[y, x]:
                tile = y // 16 * across + x // 16
                word = int(steps[y, x]) << 8 | (y % 16) * 16 + x % 16
                expected[tile] = min(expected[tile], word)
    np.testing.assert_array_equal(device.read(least), expected)
