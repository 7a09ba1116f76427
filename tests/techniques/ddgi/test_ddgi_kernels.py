"""Every pass of DDGI against float64 NumPy on random inputs, at several work-group sizes."""

from dataclasses import replace

import numpy as np
import pyopencl as cl
import pytest
from support.ddgi_oracle import (
    FAR,
    SIZES,
    SMALL,
    VARIANTS,
    blended_distance,
    blended_irradiance,
    bordered,
    create,
    decode,
    encode,
    lookup,
    randomise,
    shade,
    state_of,
    texel_directions,
)
from support.launches import run_pass
from support.pairwise import few, pairwise
from support.synthetic_bake import random_scene, random_unit

from gibench.device import SIMT, WIDE, kernel_source, local
from gibench.rays.embree import EmbreeTracer
from gibench.techniques.ddgi.blending import Tuned
from gibench.techniques.ddgi.conform import rays_of, store_rays
from gibench.techniques.ddgi.conform_oracle import DISTANCE, IRRADIANCE, VARIATION


@pytest.fixture(scope="module")
def scene():
    return random_scene(np.random.default_rng(7), 80)


def random_rays(technique, rng):
    """Radiance over two powers of ten; one ray in four on a back, in some probes more."""
    s = state_of(technique)
    shape = (len(s.state), s.settings.blended)
    radiance = 10.0 ** rng.uniform(-1, 1, (*shape, 3)).astype(np.float32)
    distance = rng.uniform(0.01, 1.3, shape) * s.longest
    distance[rng.random(shape) < 0.1] = FAR
    distance *= np.where(rng.random(shape) < rng.uniform(0, 0.4, (shape[0], 1)), -1, 1)
    return radiance.astype(np.float64), distance.astype(np.float32).astype(np.float64)


def inner(maps):
    return maps[:, 1:-1, 1:-1].reshape(len(maps), -1, maps.shape[-1]).astype(np.float64)


# -- octahedral maps and borders ---------------------------------------------------------------

ROUND_TRIP = """
__kernel void there_and_back(__global const float *square, __global const float *direction,
                             __global float *squares, __global float *directions, int count)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    vstore2(octahedral_encode(octahedral_decode(vload2(i, square))), i, squares);
    store3(directions, i, octahedral_decode(octahedral_encode(load3(direction, i))));
}
"""


def test_octahedral_round_trip(rng, scene):
    technique = create(scene, SMALL)
    device, count = technique.device, 20_000
    square = rng.uniform(-1, 1, (count, 2)).astype(np.float32)
    direction = random_unit(rng, count)
    direction[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    a, b = device.upload("square", square), device.upload("direction", direction)
    c, d = device.upload("squares", square), device.upload("back", direction)
    source = kernel_source("common/vec.cl") + kernel_source("common/octahedral.cl") + ROUND_TRIP
    program = cl.Program(device.context, source).build()
    arguments = (a.mem, b.mem, c.mem, d.mem, np.int32(count))
    program.there_and_back(device.queue, (count,), None, *arguments)
    np.testing.assert_allclose(device.read(c), square, atol=1e-6)
    np.testing.assert_allclose(device.read(d), direction, atol=1e-6)
    # And the maps agree with the definition in float64.
    np.testing.assert_allclose(encode(decode(square)), square, atol=1e-12)


@pytest.mark.parametrize(
    ("storage", "side"),
    [
        # Each side in one format, and each parity in both: 4 in fp16, 6 in fp32, 8 in fp16 ...
        pytest.param(s, n, marks=() if (n // 2 % 2 == 0) == (s == "fp16") else pytest.mark.slow)
        for s in ("fp16", "fp32")
        for n in range(4, 17)
    ],
)
def test_borders_are_exact(scene, side, storage):
    settings = {**SMALL, "irradiance_texels": side, "distance_texels": 20 - side,
                "storage": storage}  # fmt: skip
    technique = create(scene, settings)
    rng, device = np.random.default_rng(side), technique.device
    for size in (1 + 6 * (side % 2), 64):
        expected = []
        for maps in (technique.probes.irradiance, technique.probes.distance):
            values = rng.uniform(0, 2, maps.shape).astype(maps.dtype)
            device.write(maps, values)
            expected.append(bordered(values))
        run_pass(technique, "border_copy", size)
        np.testing.assert_array_equal(device.read(technique.probes.irradiance), expected[0])
        np.testing.assert_array_equal(device.read(technique.probes.distance), expected[1])


@pytest.mark.parametrize("side", [4, 5, 9])
def test_bordered_maps_are_continuous(side):
    """Across the fold of the octahedral map a bilinear lookup does not jump."""
    rng = np.random.default_rng(side)
    map_ = bordered(rng.uniform(0, 1, (1, side + 2, side + 2, 1)))[0]
    down = rng.uniform(-1, -0.05, 500)
    r = np.sqrt(1 - down**2)
    on_fold = np.stack([np.zeros(500), r * rng.choice([-1, 1], 500), down], axis=1)
    aside = np.array([1e-9, 0.0, 0.0])
    for order in ([0, 1, 2], [1, 0, 2]):
        sides = [lookup(map_, (on_fold + sign * aside)[:, order]) for sign in (1, -1)]
        assert np.abs(sides[0] - sides[1]).max() < 1e-6


# -- tracing and shading -----------------------------------------------------------------------


@pytest.mark.parametrize("size", few(SIZES))
def test_probe_trace(scene, size):
    rng = np.random.default_rng(size)
    technique = create(scene, SMALL)
    randomise(technique, rng)
    technique.begin_frame(size)
    untouched = technique.device.read(technique.probes.hits)
    run_pass(technique, "probe_trace", size)
    s, device = state_of(technique), technique.device
    origin = np.repeat(s.position, s.settings.rays, axis=0)
    direction = np.tile(s.directions, (len(s.state), 1))
    tracer = EmbreeTracer(scene.corners)
    hits = tracer.closest(origin.astype(np.float32), direction.astype(np.float32))
    certain = np.ones(len(origin), bool)
    for _ in range(4):
        near = direction + rng.uniform(-1, 1, direction.shape) * 2e-4
        certain &= tracer.closest(origin.astype(np.float32), near.astype(np.float32)).triangle == (
            hits.triangle
        )
    shape = (len(s.state), s.settings.rays)
    fixed = s.settings.fixed
    triangle, distance, certain = (
        a.reshape(shape) for a in (hits.triangle, hits.distance, certain)
    )
    assert certain.mean() > 0.95
    c = scene.corners[triangle].astype(np.float64)
    normal = np.cross(c[..., 1, :] - c[..., 0, :], c[..., 2, :] - c[..., 0, :])
    back = np.einsum("prc,rc->pr", normal, s.directions) > 0
    signed = np.where(triangle < 0, FAR, np.where(back, -distance, distance))
    found = device.read(technique.probes.fixed_distance)
    np.testing.assert_allclose(
        found[certain[:, :fixed]], signed[:, :fixed][certain[:, :fixed]], rtol=2e-4
    )
    assert (found < 0).any()
    hit = device.read(technique.probes.hits)
    active = (s.state & 1).astype(bool)
    np.testing.assert_array_equal(hit[~active], untouched[~active])
    which = certain[:, fixed:] & active[:, None]
    ids = np.ascontiguousarray(hit[..., 3]).view(np.int32)
    np.testing.assert_array_equal(ids[which], triangle[:, fixed:][which])
    met = which & (triangle[:, fixed:] >= 0)
    np.testing.assert_allclose(hit[..., 0][met], distance[:, fixed:][met], rtol=2e-4)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("size", few(SIZES))
def test_probe_shade(scene, size, variant):
    rng = np.random.default_rng(size)
    technique = create(scene, SMALL, variant)
    randomise(technique, rng, states=(0, 1, 3, 3))
    frame = 17 + size
    technique.begin_frame(frame)
    run_pass(technique, "probe_trace", 64)
    run_pass(technique, "probe_shade", size)
    s = state_of(technique)
    active = (s.state & 1).astype(bool)
    hit = technique.device.read(technique.probes.hits)[active].reshape(-1, 4)
    triangle = np.ascontiguousarray(hit[:, 3]).view(np.int32)
    direction = np.tile(s.directions[s.settings.fixed :], (active.sum(), 1))
    chosen = rng.choice(len(hit), 300, replace=False)
    radiance, distance, certain = shade(
        scene,
        frame,
        s,
        direction[chosen],
        (*hit[chosen, :3].astype(np.float64).T, triangle[chosen]),
    )
    assert certain.mean() > 0.85
    found, kept = rays_of(technique)
    found = found[active].reshape(-1, 3)[chosen]
    np.testing.assert_allclose(found[certain], radiance[certain], rtol=5e-4, atol=1e-5)
    kept = kept[active].reshape(len(hit), -1)[chosen]
    if variant == "published":
        np.testing.assert_allclose(kept[certain, 0], distance[certain], rtol=1e-6)
    else:
        d = np.minimum(np.where(distance < 0, -0.2 * distance, distance), s.longest) / s.longest
        expected = np.stack([distance >= 0, d, d**2], axis=1)
        np.testing.assert_allclose(kept[certain], expected[certain], rtol=1e-5)


# -- blending ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "size", "shape"),
    pairwise(
        [
            {},
            {"gamma": 2.5, "distance_exponent": 7.5},
            {"average": "encoded"},
            {"average": "encoded", "gamma": 2.5},
        ],
        (7, 64, 100),
        ("published", WIDE, SIMT),
        more={1: (1,)},
    ),
)
def test_blending(scene, size, shape, more):
    rng = np.random.default_rng(size)
    settings = {**SMALL, "storage": "fp32", **more}
    if shape == "published":
        # 700 bytes of local memory hold 25 of 41 rays for irradiance, 43 for distance.
        technique = create(scene, settings, shape, local_memory=700)
    else:  # blocks of 16 or 32 probes
        technique = create(scene, settings, layout=shape, simd_width=1 if size % 32 else 32)
    randomise(technique, rng, states=(0, 1, 3, 3))
    technique.begin_frame(3)
    radiance, distance = random_rays(technique, rng)
    store_rays(technique, state_of(technique), radiance, distance)
    s, device, probes = state_of(technique), technique.device, technique.probes
    device.write(probes.accepted, np.full(len(s.state), -1))
    run_pass(technique, "blend_irradiance", size)
    run_pass(technique, "blend_distance", size)
    maps, variation, accepted, certain = blended_irradiance(s, radiance, distance)
    active = (s.state & 1).astype(bool)
    assert 3 < accepted[active].sum() < active.sum()
    expected = np.where(active, accepted, -1)
    np.testing.assert_array_equal(device.read(probes.accepted), expected)
    taken = active & accepted
    before, found = inner(s.irradiance)[..., :3], inner(device.read(probes.irradiance))[..., :3]
    np.testing.assert_array_equal(found[~taken], before[~taken])
    assert certain.mean() > 0.98
    which = taken[:, None] & certain
    np.testing.assert_allclose(found[which], maps[which], rtol=IRRADIANCE.relative)
    cv = device.read(probes.variability)
    np.testing.assert_allclose(
        cv[which], variation[which], rtol=VARIATION.relative, atol=VARIATION.absolute
    )
    # Falls and rises beyond the thresholds both occur.
    fall, rise = (before - found)[which].max(), (found - before)[which].max()
    assert fall > 0.05
    assert rise > 0.01
    distances = inner(device.read(probes.distance))
    expected = np.where(active[:, None, None], blended_distance(s, distance), inner(s.distance))
    np.testing.assert_allclose(distances, expected, rtol=DISTANCE.relative, atol=DISTANCE.absolute)


@pytest.mark.parametrize("size", few([1, 7, 24, 64]))
@pytest.mark.parametrize("sharp", [False, True])
def test_lists_of_rays_by_groups(rng, scene, sharp, size):
    """Those that one work-item per texel makes, in the same order, whatever the group."""
    technique = create(scene, SMALL, layout=SIMT)
    technique.begin_frame(int(rng.integers(100)))
    device, blending = technique.device, technique.blending
    size = max(size, device.lanes_together)  # where work-items take a texel each, a vector of them
    side, least = (7, 0.6) if sharp else (5, 0.0)
    s, found = state_of(technique), []
    names = ("lengths", "list_rays", "list_weights")
    by_group = blending._weights("distance", side, sharp, least)
    args = (*by_group.args[:-1], local("counted", 4 * size))
    alone = Tuned._weights(blending, "distance", side, sharp, least)
    for launch in (replace(by_group, args=args, workgroup_size=size), alone):
        held = {a.name: a.value for a in launch.args if a.name in names}
        for buffer in held.values():
            device.write(buffer, np.zeros(buffer.shape, buffer.dtype))
        device.enqueue(launch, 64)
        found.append([device.read(held[name])[: side**2] for name in names])
    (lengths, rays, weights), (lengths_alone, rays_alone, weights_alone) = found
    np.testing.assert_array_equal(lengths, lengths_alone)
    np.testing.assert_array_equal(rays, rays_alone)
    np.testing.assert_allclose(weights, weights_alone, rtol=1e-6)
    cosine = texel_directions(side) @ s.directions[s.settings.fixed :].T
    assert np.all(lengths % 4 == 0)
    for texel, row in enumerate(cosine):
        kept = set(rays[texel, : lengths[texel]][weights[texel, : lengths[texel]] > 0])
        expected = set(np.flatnonzero(row > least))
        assert kept ^ expected <= set(np.flatnonzero(np.abs(row - least) < 1e-6))


@pytest.mark.parametrize("variant", VARIANTS)
def test_fp16_rounding_keeps_the_mean(scene, variant):
    """Stored values lie one step of fp16 from the exact ones at most, and not to one side."""
    rng = np.random.default_rng(0)
    technique = create(scene, {**SMALL, "distance_texels": 14}, variant)
    randomise(technique, rng, states=(3,))
    technique.begin_frame(5)
    radiance, distance = random_rays(technique, rng)
    distance = np.abs(distance)
    store_rays(technique, state_of(technique), radiance, distance)
    s = state_of(technique)
    run_pass(technique, "blend_irradiance", 64)
    run_pass(technique, "blend_distance", 64)
    read, probes = technique.device.read, technique.probes
    maps, _, _, certain = blended_irradiance(s, radiance, distance)
    pairs = (
        (inner(read(probes.irradiance))[..., :3][certain], maps[certain]),
        (inner(read(probes.distance)), blended_distance(s, distance)),
    )
    for found, exact in pairs:
        step = np.spacing(exact.astype(np.float16)).astype(np.float64)
        error = ((found - exact) / step).ravel()
        assert np.abs(error).max() < 1.02
        assert np.abs(error.mean()) < 4 * error.std() / np.sqrt(len(error))
        assert error.std() > 0.3
