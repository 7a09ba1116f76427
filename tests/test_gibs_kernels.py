"""GIBS kernels against independent float64 NumPy on random inputs."""

from dataclasses import replace

import numpy as np
import pyopencl as cl
import pytest
from gibs_surfels import (
    frame_words,
    geometry,
    run,
    sort_launches,
    surfel_grid,
    unit_vectors,
)
from vector_widths import widths

from gibench.device import Device, kernel_source
from gibench.profiles import load_profile
from gibench.techniques.gibs.grid import PerspectiveGrid, UniformGrid
from gibench.techniques.technique import Launch

STRETCH = 4.0
VARIANTS = widths((1, True), *((width, False) for width in (1, 2, 4, 8, 16)))
BOUNDS = (np.zeros(3), np.array([1.0, 0.7, 0.9]))
LUMA = np.array([0.299, 0.587, 0.114])
SIZES = (1, 24, 64, 256)


def any_size_device():
    return Device(replace(load_profile("vega56"), simd_width=1, max_workgroup_size=4096))


def defines(capacity, grid=None, **others):
    grid = grid or UniformGrid.around(BOUNDS, 4)
    return {**grid.defines, "CAPACITY": capacity, "ENTRIES": 27 * capacity, "PUBLISHED": False,
            "ALL_NEIGHBOURS": False, "NORMAL_STRETCH": STRETCH, "VEC": 8, "DEPTH": True,
            "GUIDING": True, "FLOORED": True, **others}  # fmt: skip


# -- estimator --------------------------------------------------------------------------------


def estimator_step(e, y, floored):
    """FIELD-NOTES' formulas; e: mean, short mean, variance (3,), blend, inconsistency, rays.

    Floored: no clamp, and each of the three means weighs a ray like a plain mean at least.
    """
    m, s, v, b, i, n = e
    n = min(n + 1, 256)
    least = 1 / n if floored else 0
    if floored and n == 1:
        m = y
    if not floored:
        y = np.minimum(y, 0.1 + s + 8 * np.sqrt(np.maximum(1e-5, v)))
    s2 = s + max(0.08, least) * (y - s)
    v2 = v + max(0.04, least) * ((y - s) * (y - s2) - v)
    sigma = np.sqrt(np.maximum(1e-5, v2))
    r = LUMA @ np.abs((m - s2) / sigma)
    i2 = i + 0.08 * (r - i)
    x = np.clip(r * max(0.02, i2 - 0.2), 0, 1)
    k = b * np.clip(x * x * (3 - 2 * x), 1 / 256, 1)
    b2 = b + 0.1 * (np.clip(LUMA @ (0.5 * s2 / sigma), 1 / 32, 1) - b)
    return m + max(k, least) * (y - m), s2, v2, b2, i2, n


@pytest.mark.parametrize("floored", [True, False])
@pytest.mark.parametrize("size", SIZES)
def test_update_surfels_equals_numpy(size, floored):
    rng = np.random.default_rng()
    n = 37
    rays = rng.integers(0, 6, n)
    first = np.concatenate([[0], np.cumsum(rays)]).astype(np.uint32)
    total = int(first[-1])
    ids = rng.permutation(n).astype(np.uint32)
    light = rng.exponential(1.0, (total, 4)).astype(np.float32)
    choice = np.stack([rng.uniform(0.5, 2, total), rng.integers(0, 16, total)], 1)
    radii = rng.uniform(0.1, 1, n).astype(np.float32)
    estimator = rng.uniform(0.05, 1, (12, n)).astype(np.float32)
    estimator[11] = rng.choice([0, 1, 2, 40, 254, 255, 256], n)
    moments = rng.uniform(0.1, 1, (n, 48)).astype(np.float32)
    moments[:, 32:] = rng.integers(0, 21, (n, 16))
    guides = rng.uniform(0, 1, (n, 16)).astype(np.float32)

    device = any_size_device()
    program = device.program("gibs/irradiance.cl", defines(n, FLOORED=floored))
    state = [device.upload(f"s{k}", a) for k, a in enumerate((estimator, moments, guides))]
    nearest = device.empty("nearest", n, np.float32)
    args = (
        device.upload("frame", frame_words(n)),
        device.upload("ids", ids),
        device.upload("first", first),
        device.upload("light", light),
        device.upload("choice", choice.astype(np.float32)),
        device.upload("radii", radii),
        state[0],
        state[1],
        nearest,
        state[2],
    )
    run(device, [Launch(program, "update_surfels", args, items=n)], size)

    e64, m64, g64 = (a.astype(np.float64) for a in (estimator, moments, guides))
    for place, surfel in enumerate(ids):
        e = (e64[0:3, surfel], e64[3:6, surfel], e64[6:9, surfel], *e64[9:, surfel])
        for ray in range(first[place], first[place + 1]):
            weight, texel = np.float32(choice[ray, 0]), int(choice[ray, 1])
            e = estimator_step(e, np.pi * weight * light[ray, :3].astype(np.float64), floored)
            d = min(float(light[ray, 3]), 2.0 * float(radii[surfel]))
            count = m64[surfel, 32 + texel] + 1
            rate = max(1 / count, 0.05)
            m64[surfel, texel] += rate * (d - m64[surfel, texel])
            m64[surfel, 16 + texel] += rate * (d * d - m64[surfel, 16 + texel])
            m64[surfel, 32 + texel] = min(count, 20)
            g64[surfel, texel] += 0.1 * (LUMA @ light[ray, :3] - g64[surfel, texel])
        e64[:, surfel] = np.concatenate([*e[:3], e[3:]])
    np.testing.assert_allclose(device.read(state[0]), e64, rtol=2e-4, atol=1e-5)
    # A step from m to a sample near 0 leaves the rounding of m, which is of order 1.
    rounding = 4 * np.finfo(np.float32).eps
    np.testing.assert_allclose(device.read(state[1]), m64, rtol=1e-5, atol=rounding)
    np.testing.assert_allclose(device.read(state[2]), g64, rtol=1e-5, atol=rounding)
    np.testing.assert_allclose(device.read(nearest), m64[:, :16].min(1), rtol=1e-5, atol=rounding)


def few_bright_rays(n, rays, share, rng):
    """Radiance (n * rays, 4) of mean 1 / pi that comes with a ``share`` of the rays only."""
    light = np.zeros((n * rays, 4), np.float32)
    light[:, :3] = ((rng.random(n * rays) < share) / (np.pi * share))[:, None]
    return light


@pytest.mark.parametrize("share", [0.5, 0.1, 0.05])
def test_the_floored_estimator_is_right_on_average_however_few_rays_are_bright(share):
    """The chapter's own is too dark the fewer they are: what ``floored`` is for."""
    rng = np.random.default_rng()
    n, rays = 2000, 1500
    light = few_bright_rays(n, rays, share, rng)
    found = {}
    for floored in (True, False):
        device = any_size_device()
        program = device.program("gibs/irradiance.cl", defines(n, FLOORED=floored))
        state = [
            device.upload("estimator", np.zeros((12, n), np.float32)),
            device.upload("moments", np.zeros((n, 48), np.float32)),
            device.empty("nearest", n, np.float32),
            device.upload("guides", np.zeros((n, 16), np.float32)),
        ]
        args = (
            device.upload("frame", frame_words(n)),
            device.upload("ids", np.arange(n, dtype=np.uint32)),
            device.upload("first", (np.arange(n + 1) * rays).astype(np.uint32)),
            device.upload("light", light),
            device.upload("choice", np.ones((n * rays, 2), np.float32)),
            device.upload("radii", np.ones(n, np.float32)),
            *state,
        )
        run(device, [Launch(program, "update_surfels", args, items=n)])
        found[floored] = device.read(state[0])[0].astype(np.float64)
    # A mean over 256 rays of variance 1 / share - 1; four standard errors of n of them, and what
    # catching up with the short mean leaves (measured 1.8 % at a share of 1 in 20).
    error = 4 * np.sqrt((1 / share - 1) / 256 / n)
    assert abs(found[True].mean() - 1) < error + 0.02
    assert found[True].std() < 1.5 * np.sqrt((1 / share - 1) / 256) + 0.02
    assert found[False].mean() < {0.5: 1.02, 0.1: 0.95, 0.05: 0.75}[share]


# -- rays -------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("rays", [1, 50, 513, 3000])
def test_rays_are_shared_out_exactly_and_in_proportion(size, rays):
    rng = np.random.default_rng()
    n = 513
    requests = rng.integers(1, 1000, n).astype(np.uint64)
    before = np.concatenate([[0], np.cumsum(requests)]).astype(np.uint32)
    device = any_size_device()
    program = device.program("gibs/irradiance.cl", defines(n))
    first = device.empty("first", n + 1, np.uint32)
    owner = device.empty("owner", rays, np.uint32)
    frame = device.upload("frame", frame_words(n))
    args = (frame, device.upload("before", before), first, owner)
    total = np.zeros(n)
    for number in range(1, 21):
        device.write(frame, frame_words(n, frame=number, rays=rays))
        run(device, [Launch(program, "assign_rays", args, items=n)], size)
        got = np.diff(device.read(first).astype(np.int64))
        assert got.sum() == rays
        np.testing.assert_array_equal(device.read(owner), np.repeat(np.arange(n), got))
        share = requests * rays / requests.sum()
        assert np.all(np.abs(got - share) < 1)
        total += got
    assert len(np.unique(total)) > 1  # the phase moves: who asks for half a ray gets some


def test_visible_and_inconsistent_surfels_ask_for_more():
    device = any_size_device()
    n = 5
    program = device.program("gibs/irradiance.cl", defines(n))
    estimator = np.zeros((12, n), np.float32)
    estimator[10] = 0.1, 1.0, 0.1, 1.0, 1000.0
    seen = np.array([100, 100, 50, 50, 100], np.uint32)
    requests = device.empty("requests", n, np.uint32)
    args = (
        device.upload("frame", frame_words(n, frame=101)),
        device.upload("ids", np.arange(n, dtype=np.uint32)),
        device.upload("estimator", estimator),
        device.upload("seen", seen),
        requests,
    )
    run(device, [Launch(program, "request_rays", args, items=n)])
    # (0.125 + inconsistency, at most 4) in 1/256, a quarter of it out of sight.
    np.testing.assert_array_equal(device.read(requests), [57, 288, 14, 72, 1056])


# -- gathering --------------------------------------------------------------------------------


def disk_to_square(x, y):
    """Shirley and Chiu 1997 by polar angle, float64; the inverse of the concentric map."""
    r, phi = np.hypot(x, y), np.arctan2(y, x)
    phi = np.where(phi < -np.pi / 4, phi + 2 * np.pi, phi)
    quarter = np.floor((phi + np.pi / 4) / (np.pi / 2)).astype(int) % 4
    t = phi * 4 / np.pi
    a = np.select([quarter == 0, quarter == 1, quarter == 2], [r, -r * (t - 2), -r], r * (t - 6))
    b = np.select([quarter == 0, quarter == 1, quarter == 2], [r * t, r, -r * (t - 4)], -r)
    return a, b


def basis(n):
    """Duff et al. 2017 for (k, 3) normals."""
    sign = np.copysign(1.0, n[:, 2])
    a = -1 / (sign + n[:, 2])
    b = n[:, 0] * n[:, 1] * a
    t = np.stack([1 + sign * n[:, 0] ** 2 * a, sign * b, -sign * n[:, 0]], 1)
    return t, np.stack([b, sign + n[:, 1] ** 2 * a, -n[:, 1]], 1)


def visibility(moments, normal, offset):
    """(k,) for k surfels and the offsets of one point from them, float64."""
    distance = np.linalg.norm(offset, axis=1)
    direction = offset / distance[:, None]
    t, b = basis(normal)
    x, y = (direction * t).sum(1), (direction * b).sum(1)
    below = (direction * normal).sum(1) < 0
    size = np.where(below, np.hypot(x, y), 1.0)
    at = np.stack(disk_to_square(x / size, y / size), 1)
    at = np.clip((at + 1) * 2 - 0.5, 0, 3)
    low = np.floor(at).astype(int)
    high = np.minimum(low + 1, 3)
    f = at - low
    k = np.arange(len(normal))
    m = moments.reshape(-1, 3, 4, 4)

    def mixed(which):
        v = m[:, which]
        top = v[k, low[:, 1], low[:, 0]] * (1 - f[:, 0]) + v[k, low[:, 1], high[:, 0]] * f[:, 0]
        end = v[k, high[:, 1], low[:, 0]] * (1 - f[:, 0]) + v[k, high[:, 1], high[:, 0]] * f[:, 0]
        return top * (1 - f[:, 1]) + end * f[:, 1]

    mean, square = mixed(0), mixed(1)
    variance, beyond = np.maximum(square - mean**2, 0), distance - mean
    bound = variance / (variance + beyond**2)
    return np.where(beyond <= 0, 1.0, bound**3)


def gathered(x, n, position, normal, radius, irradiance, moments):
    """Irradiance and coverage of one point from all surfels there are, float64."""
    o = x - position
    h = (o * normal).sum(1)
    d = np.sqrt((o * o).sum(1) + (STRETCH**2 - 1) * h * h)
    t = np.clip(1 - d / radius, 0, 1)
    w = t * t * (3 - 2 * t) * np.maximum(normal @ n, 0)
    if moments is not None:
        w = w * visibility(moments, normal, o)
    return np.append(
        (w[:, None] * irradiance).sum(0) / w.sum() if w.sum() else np.zeros(3), w.sum()
    )


@pytest.mark.parametrize("depth", [False, True])
@pytest.mark.parametrize(
    ("vec", "published"), widths((1, True), *((v, False) for v in (1, 2, 4, 8, 16)))
)
@pytest.mark.parametrize("kind", ["uniform", "perspective"])
def test_gathering_equals_the_sum_over_all_surfels(kind, published, vec, depth):
    rng = np.random.default_rng()
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
        "gibs/application.cl", {**sorter.defines, "VEC": vec, "DEPTH": depth, "GUIDING": False}
    )
    out = device.empty("out", (points, 4), np.float32)
    args = (
        sorter.table,
        *sorter.list_bounds,
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
    run(device, [Launch(program, "gather_points", args, items=points)])
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


def test_hemisphere_texels_are_equally_likely_and_found_again():
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
    rng = np.random.default_rng()
    n = 4096
    normal = unit_vectors(n, rng)
    square = rng.uniform(-1, 1, (n, 2)).astype(np.float32)
    out = device.empty("direction", (n, 3), np.float32), device.empty("back", (n, 2), np.float32)
    built = cl.Program(device.context, source).build()
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


@pytest.mark.parametrize("size", [1, 24, 64, 256, 512])
@pytest.mark.parametrize(("width", "height"), [(16, 16), (50, 37), (7, 3)])
def test_every_tile_finds_its_least_covered_pixel(size, width, height):
    rng = np.random.default_rng()
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
    run(device, [Launch(program, "coverage", args, groups=across * down)], size)
    expected = np.full(across * down, 0xFFFFFFFF, np.uint64)
    steps = np.minimum(np.rint(np.float32(covered) * np.float32(4096)), 2**24 - 1)
    for y in range(height):
        for x in range(width):
            if surface[y, x]:
                tile = y // 16 * across + x // 16
                word = int(steps[y, x]) << 8 | (y % 16) * 16 + x % 16
                expected[tile] = min(expected[tile], word)
    np.testing.assert_array_equal(device.read(least), expected)
