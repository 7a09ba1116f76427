"""Links against closed forms, brute force and a plain refinement; caches inside geometry."""

import heapq

import numpy as np
import pytest
from support.surfel_scenes import ceiling, linker_of, polygon
from support.tiny_scenes import empty_room, room

from gibench.rays.embree import EmbreeTracer, scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.environment import Environment
from gibench.techniques.parts.probe_volume import fit_volume
from gibench.techniques.surfel_cache.bake.caches import place_caches
from gibench.techniques.surfel_cache.bake.data import LINK_SCALE, Atlas
from gibench.techniques.surfel_cache.sh import basis

ORIGIN, UP = np.zeros(3, np.float32), np.float32([0, 1, 0])


def form_factor(seen):
    """Of what a patch at the origin that faces up sees: cosines over solid angles, over pi."""
    return float((seen.solid * seen.direction[:, 1]).sum() / np.pi)


def over_a_corner(width, depth, height):
    """Of a rectangle, from a point beneath its corner (Howell's catalogue, configuration B-4)."""
    a, b = width / height, depth / height
    return (
        a / np.hypot(1, a) * np.arctan(b / np.hypot(1, a))
        + b / np.hypot(1, b) * np.arctan(a / np.hypot(1, b))
    ) / (2 * np.pi)


@pytest.mark.parametrize("height", [0.05, 0.4, 3.0])
def test_a_rectangle_over_a_plane(rng, height):
    """From a point beneath: the four rectangles that meet above it."""
    width, depth = 1.0, 0.7
    linker = linker_of(*ceiling(width, depth, height), surfels=2000)
    ratios = []
    for x, z in rng.uniform((0.1, 0.1), (0.9, 0.6), (24, 2)):
        exact = sum(over_a_corner(a, b, height) for a in (x, width - x) for b in (z, depth - z))
        seen = linker.visible(np.float32([x, 0, z]), UP)
        ratios.append(form_factor(seen) / exact)
    # Close by, short rays in fixed directions find it: 0.7 % of spread from point to point.
    assert np.mean(ratios) == pytest.approx(1, abs=0.0125)
    assert np.max(np.abs(np.array(ratios) - 1)) < (0.04 if height < 0.1 else 0.005)


@pytest.mark.parametrize("height", [0.05, 0.4, 3.0])
def test_a_disc_over_a_plane(height):
    """From a point beneath its middle: r^2 / (r^2 + h^2); its solid angle, too."""
    scene, lightmap = ceiling(1, 1, height)
    linker = linker_of(polygon(scene, 0.5, height, 256), lightmap, surfels=2000)
    seen = linker.visible(ORIGIN, UP)
    assert form_factor(seen) == pytest.approx(0.25 / (0.25 + height**2), rel=0.015)
    solid = 2 * np.pi * (1 - height / np.hypot(0.5, height))
    assert float(seen.solid.sum()) == pytest.approx(solid, rel=0.015)


def test_walls_fill_the_sphere(rng):
    """A closed room without anything in it: 4 pi from inside, 2 pi from its walls."""
    scene, lightmap = empty_room()
    linker = linker_of(scene, lightmap, 3000)
    for _ in range(4):
        inside = rng.uniform((-0.8, 0.3, -0.8), (0.8, 2.0, 0.8)).astype(np.float32)
        assert linker.visible(inside, None).solid.sum() == pytest.approx(4 * np.pi, rel=0.02)
        floor = inside * np.float32([1, 0, 1])
        assert linker.visible(floor, UP).solid.sum() == pytest.approx(2 * np.pi, rel=0.02)
    corner = np.float32([-0.99, 0, -1.09])  # a hundredth off both walls, a tenth of a spacing
    assert linker.visible(corner, UP).solid.sum() == pytest.approx(2 * np.pi, rel=0.02)


def brute_force(scene, linker, position):
    """Equation 3 of every surfel that is far from ``position``, (n, 16), and which those are."""
    s = linker.surfels
    towards = s.position.astype(np.float64) - position
    distance = np.linalg.norm(towards, axis=1)
    direction = towards / distance[:, None]
    cosine = -np.einsum("ij,ij->i", direction, s.normal)
    target = s.position + linker.offset * s.normal
    free = ~EmbreeTracer(scene.corners).occluded(
        np.broadcast_to(position, target.shape).astype(np.float32),
        (target - position).astype(np.float32),
        np.float32(0.9999),
    )
    solid = np.where(free & (cosine > 1e-4), s.area * cosine / distance**2, 0.0)
    return basis(direction) * solid[:, None] / np.pi, distance > 4 * np.sqrt(s.area)


def test_as_many_links_as_surfels_are_the_sum_over_all(rng):
    """Equation 4 with n_L = n_S, but for halves; what is close is tested by the walls above."""
    scene, lightmap = room()
    linker = linker_of(scene, lightmap, 500)
    n, tree = 500, linker.tree
    position = np.float32([0.1, 1.5, 0.2])
    links = linker.links(position[None], None, n)
    expected, far = brute_force(scene, linker, position)
    radiosity = rng.uniform(0, 1, n)
    own = np.flatnonzero(links.coefficients[0, :, 0] > 0)
    nodes = links.node[0, own]
    assert (tree.end[nodes] - tree.begin[nodes] == 1).all()  # surfels alone
    found = np.zeros((n, 16))
    found[tree.begin[nodes]] = links.coefficients[0, own] / LINK_SCALE
    assert far.sum() > 300
    np.testing.assert_allclose(found[far], expected[far], rtol=2e-3, atol=2e-6)
    light, exact = (radiosity[far] @ part[far] for part in (found, expected))
    np.testing.assert_allclose(light, exact, rtol=1e-3, atol=1e-3 * exact[0])


def plain_cut(tree, each, most):
    """The paper's refinement: the largest first, those that are not seen not counted."""

    def worth(node):
        return each[tree.begin[node] : tree.end[node]].sum()

    cut = [(-worth(0), 0)]
    done = []
    while cut:
        _, node = heapq.heappop(cut)
        child = tree.child[node]
        parts = [c for c in (child, child + 1) if worth(c) > 0] if child >= 0 else []
        if child < 0:
            done.append(node)
        elif len(done) + len(cut) + len(parts) > most:
            done.append(node)
            break
        else:
            for part in parts:
                heapq.heappush(cut, (-worth(part), part))
    return sorted([*done, *(node for _, node in cut)])


@pytest.mark.parametrize("most", [1, 2, 9, 40])
def test_the_cut_is_refined_by_the_largest(rng, most):
    scene, lightmap = room()
    linker = linker_of(scene, lightmap, 700)
    position = np.float32([0.5, 1.2, 0.6])
    seen = linker.visible(position, None)
    nodes, coefficients = linker.cut(seen, most)
    each = np.bincount(seen.slot, seen.solid.astype(np.float64), minlength=700)
    assert sorted(nodes.tolist()) == plain_cut(linker.tree, each, most)
    assert len(nodes) == most
    # It covers all that is seen, once.
    tree = linker.tree
    covered = np.zeros(700, int)
    for node in nodes:
        covered[tree.begin[node] : tree.end[node]] += 1
    assert covered.max() == 1 and (covered[each > 0] == 1).all()
    sums = (coefficients[:, 0].astype(float) * (tree.end - tree.begin)[nodes]).sum() / LINK_SCALE
    assert sums == pytest.approx(0.28209479 * each.sum() / np.pi, rel=2e-3)


def test_a_cache_that_sees_nothing_has_no_links():
    linker = linker_of(*ceiling(1, 1, 1.0), surfels=50)
    links = linker.links(np.float32([[0, 2, 0]]), None, 8)  # behind the only surface
    assert links.rays == 0 and not links.coefficients.any() and not links.node.any()


def atlas_of(lightmap):
    r = lightmap.receivers
    return Atlas(
        lightmap.width, lightmap.height, lightmap.triangle_uvs, r.texel, r.position, r.normal
    )


def test_caches_inside_geometry_are_left_out():
    """Under and inside the room's block, which has no bottom."""
    scene, lightmap = room(12)
    low, high = scene.bounds
    volume = fit_volume(low, high, (9, 9, 9))
    tracer, offset = scene_tracer(scene), surface_offset(scene)
    caches = place_caches(scene, atlas_of(lightmap), volume, tracer, offset)
    lower, upper = np.array([-0.3, 0.0, -0.5]), np.array([0.4, 0.9, 0.2])

    def within(position, margin):
        return ((position > lower - margin) & (position < upper + margin)).all(axis=1)

    r, grid = lightmap.receivers, volume.positions
    floor = (r.position[:, 1] == 0) & (r.normal[:, 1] > 0.5)
    above = r.position + np.float32([0, 0.05, 0])
    under, beside = floor & within(above, -0.02), floor & ~within(above, 0.02)
    assert under.sum() >= 4 and beside.sum() > 50
    assert not caches.map_kept[under].any() and caches.map_kept[beside].all()
    inside, outside = within(grid, -0.02), ~within(grid, 0.02)
    assert inside.sum() >= 4
    assert not caches.grid_kept[inside].any() and caches.grid_kept[outside].all()
    assert caches.left_out == (~caches.map_kept).sum() + (~caches.grid_kept).sum()
    assert caches.environment is None
    assert len(caches.positions) == caches.on_map + caches.in_grid


def test_the_environment_is_projected(rng):
    """Of one colour all around a floor: half the sphere from it, all of it from above, less what
    the floor hides."""
    scene, lightmap = ceiling(2, 2, 0)
    sky = tuple(rng.uniform(0.2, 1, 3))
    scene = type(scene)(**{**vars(scene), "environment": Environment.constant(sky)})
    volume = fit_volume(np.array([0.0, -4.0, 0.0]), np.array([2.0, -2.0, 2.0]), (1, 1, 1))
    caches = place_caches(scene, atlas_of(lightmap), volume, scene_tracer(scene), 1e-5)
    assert caches.environment is not None
    flux = caches.environment[:, 0].astype(float) / 0.28209479 / np.array(sky)
    np.testing.assert_allclose(flux[: caches.on_map], 2 * np.pi, rtol=0.01)
    # A square of side 2 seen from 3 m over its middle: 4 asin(sin^2 of half its angle).
    square = 4 * np.arcsin(1 / (1 + 9))
    np.testing.assert_allclose(flux[caches.on_map :], 4 * np.pi - square, rtol=0.01)
