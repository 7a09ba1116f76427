"""The tree's build: complete, bounding, cheap, and safe for the kernel's stack."""

import numpy as np
import pytest
from support.rays_oracle import box, closest_float64, soup, walk

from gibench.device import Device
from gibench.errors import BadInput
from gibench.profiles import load_profile
from gibench.rays.bvh import BLOCK_FLOATS, NODE_FLOATS, STACK_ENTRIES, build_bvh
from gibench.rays.bvh_sah import build_binary
from gibench.rays.bvh_wide import WIDTH, half_area
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 33, 1000])
def test_every_triangle_is_in_one_leaf_within_its_bounds(rng, count):
    corners = soup(count, rng)
    bvh = build_bvh(corners)
    seen, depth = walk(bvh, corners)
    assert sorted(seen) == list(range(count))
    assert depth == bvh.depth
    assert bvh.triangle_count == count
    assert bvh.nodes.shape == (bvh.node_count, NODE_FLOATS)
    assert bvh.blocks.shape == (bvh.block_count, BLOCK_FLOATS)
    assert bvh.nbytes == 4 * (NODE_FLOATS * bvh.node_count + BLOCK_FLOATS * bvh.block_count)


def brute_force_split(lower, upper):
    """The least surface-area cost of cutting boxes in two, sorted along any axis."""
    best = np.inf
    centre = lower.astype(np.float64) + upper
    for axis in range(3):
        order = np.argsort(centre[:, axis], kind="stable")
        for k in range(1, len(order)):
            cost = sum(
                float(half_area(lower[part].min(0)[None], upper[part].max(0)[None])[0]) * len(part)
                for part in (order[:k], order[k:])
            )
            best = min(best, cost)
    return best


def test_every_split_is_the_cheapest(rng):
    corners = soup(60, rng, size=2.0)
    lower, upper = corners.min(axis=1), corners.max(axis=1)
    tree = build_binary(lower, upper)
    area = half_area(tree.lower, tree.upper)
    for node in np.flatnonzero(tree.left >= 0):
        child = tree.left[node]
        cost = area[child] * tree.count[child] + area[child + 1] * tree.count[child + 1]
        mine = tree.order[tree.start[node] : tree.start[node] + tree.count[node]]
        assert cost <= brute_force_split(lower[mine], upper[mine]) * (1 + 1e-5)


def test_the_expected_visits_are_those_of_random_lines(rng):
    """Cauchy: a line that meets a convex body meets one inside it with the areas' ratio."""
    corners = soup(400, rng, size=0.5)
    bvh = build_bvh(corners)
    nodes = bvh.nodes.reshape(-1, 7, WIDTH)
    used = nodes[:, 0] < np.inf
    children = nodes[:, 6].copy().view(np.int32)
    inner = used & (children >= 0)
    low, high = corners.min((0, 1)), corners.max((0, 1))
    root = half_area(low[None], high[None])[0]
    area = half_area(
        nodes[:, 0:6:2].transpose(0, 2, 1).reshape(-1, 3),
        nodes[:, 1:6:2].transpose(0, 2, 1).reshape(-1, 3),
    ).reshape(used.shape)
    assert bvh.node_visits == pytest.approx(1 + area[inner].sum() / root, rel=1e-4)
    # Lines uniform in a sphere around the scene, clipped by slabs against every inner box.
    centre, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    a, b = (p / np.linalg.norm(p, axis=1, keepdims=True) for p in rng.normal(size=(2, 20000, 3)))
    o, d = centre + radius * a, radius * (b - a)

    def met(lower, upper):
        t0, t1 = (lower - o) / d, (upper - o) / d
        return np.minimum(t0, t1).max(1) <= np.maximum(t0, t1).min(1)

    in_root = met(low, high)
    boxes = zip(
        nodes[:, 0:6:2].transpose(0, 2, 1)[inner],
        nodes[:, 1:6:2].transpose(0, 2, 1)[inner],
        strict=True,
    )
    visits = in_root.sum() + sum(met(lo, up).sum() for lo, up in boxes)
    assert visits / in_root.sum() == pytest.approx(bvh.node_visits, rel=0.05)


def test_triangles_on_top_of_each_other_make_a_shallow_tree(rng):
    corners = np.repeat(soup(1, rng), 20_000, axis=0)
    bvh = build_bvh(corners)
    seen, _ = walk(bvh, corners)
    assert len(seen) == 20_000
    assert bvh.depth <= 8


def test_a_tree_never_overflows_the_kernels_stack(rng):
    """Boxes that halve in size towards a corner make surface-area splits as lopsided as can be."""
    size = (2.0 ** -np.arange(0, 100, 1.0))[:, None, None]
    corners = (soup(1, rng) * size).astype(np.float32)
    bvh = build_bvh(corners)
    seen, _ = walk(bvh, corners)
    assert len(seen) == 100
    assert (WIDTH - 1) * bvh.depth + 1 <= STACK_ENTRIES


def test_overlapping_leaves_use_all_their_blocks(rng):
    """Thirty-two and more triangles in one place: leaves of several blocks, all of them tested."""
    corners = (soup(70, rng, extent=1e-3, size=4.0)).astype(np.float32)
    device = Device(load_profile("iphone7"))
    tracer = DeviceTracer(device, DeviceBvh.upload(device, build_bvh(corners)))
    o = rng.normal(0, 3.0, (2000, 3)).astype(np.float32)
    d = (-o + rng.normal(0, 1.0, o.shape)).astype(np.float32)
    triangle, t, _, _ = closest_float64(corners, o, d)
    hits = tracer.closest(o, d)
    assert (triangle >= 0).mean() > 0.3
    assert np.count_nonzero(hits.triangle != triangle) <= 2
    near = (hits.triangle == triangle) & (triangle >= 0)
    # float32 rounds corners and origins, of up to 8, to 5e-7: near the origin that is what counts.
    np.testing.assert_allclose(hits.distance[near], t[near], rtol=1e-3, atol=1e-6)


def test_corners_that_are_not_finite_are_refused():
    corners = box()
    corners[3, 1, 2] = np.nan
    corners[5] = np.inf
    with pytest.raises(BadInput, match="2 triangles have corners that are not finite"):
        build_bvh(corners)
