"""The hierarchy: a binary tree over all surfels, and the order in which clusters are merged."""

import numpy as np
import pytest
from support.tiny_scenes import room

from gibench.techniques.surfel_cache.bake.data import SurfelSet
from gibench.techniques.surfel_cache.bake.hierarchy import (
    HIERARCHIES,
    agglomerative,
    hierarchy_of,
    kd_tree,
)
from gibench.techniques.surfel_cache.bake.surfels import sample_surface, surface_areas


def random_surfels(rng, count):
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return SurfelSet(
        rng.uniform(-1, 1, (count, 3)).astype(np.float32),
        normal.astype(np.float32), normal.astype(np.float32),
        np.zeros(count, np.int32), np.zeros((count, 2), np.float32), 0.01,
    )  # fmt: skip


def leaves_of(tree):
    """The set of surfels beneath every node."""
    return {frozenset(tree.leaf[b:e].tolist()) for b, e in zip(tree.begin, tree.end, strict=True)}


def check(tree, n):
    """Binary, every leaf once, siblings side by side, sizes add up, levels in order."""
    assert len(tree.child) == 2 * n - 1
    assert sorted(tree.leaf.tolist()) == list(range(n))
    assert (tree.begin[0], tree.end[0]) == (0, n)
    inner = np.flatnonzero(tree.child >= 0)
    assert len(inner) == n - 1
    assert (tree.end - tree.begin == 1)[tree.child < 0].all()
    first = tree.child[inner]
    assert sorted([*first, *(first + 1)]) == list(range(1, 2 * n - 1))
    assert (tree.begin[first] == tree.begin[inner]).all()
    assert (tree.end[first] == tree.begin[first + 1]).all()
    assert (tree.end[first + 1] == tree.end[inner]).all()
    assert tree.level[0] == 0 and tree.level[-1] == 2 * n - 1
    depth = np.searchsorted(tree.level, np.arange(2 * n - 1), side="right")
    assert (depth[first] == depth[inner] + 1).all()
    sizes = tree.end - tree.begin
    assert (sizes[first] + sizes[first + 1] == sizes[inner]).all()
    assert (np.sort(tree.leaf) == np.arange(n)).all()


@pytest.mark.parametrize("kind", HIERARCHIES)
@pytest.mark.parametrize("count", [1, 2, 3, 7, 600])
def test_it_is_a_tree_over_all_surfels(rng, kind, count):
    check(hierarchy_of(random_surfels(rng, count), kind), count)


def test_many_clusters_by_the_neighbour_graph(rng):
    check(agglomerative(random_surfels(rng, 3000), all_pairs=50), 3000)


def plain_clustering(surfels):
    """All pairs looked at anew in every step, straight from section 4.3."""
    x = surfels.position.astype(np.float64)
    extent2 = ((x.max(axis=0) - x.min(axis=0)) ** 2).sum()
    clusters = [([i], x[i], surfels.normal[i].astype(np.float64)) for i in range(len(x))]
    sets = {frozenset([i]) for i in range(len(x))}

    def apart(a, b):
        (i, xa, na), (j, xb, nb) = a, b
        ua, ub = na / np.linalg.norm(na), nb / np.linalg.norm(nb)
        balance = abs(len(i) - len(j)) / max(len(i), len(j))
        return ((xa - xb) ** 2).sum() / extent2 + 0.1 * (1 - ua @ ub) + 0.02 * balance

    while len(clusters) > 1:
        pairs = [(apart(a, b), i, j) for j, b in enumerate(clusters) for i, a in
                 enumerate(clusters[:j])]  # fmt: skip
        _, i, j = min(pairs)
        (ia, xa, na), (ib, xb, nb) = clusters[i], clusters[j]
        both = (ia + ib, (xa * len(ia) + xb * len(ib)) / len(ia + ib), na + nb)
        clusters = [c for k, c in enumerate(clusters) if k not in (i, j)] + [both]
        sets.add(frozenset(both[0]))
    return sets


def test_all_pairs_merge_the_nearest_first(rng):
    surfels = random_surfels(rng, 24)
    assert leaves_of(hierarchy_of(surfels, "exact")) == plain_clustering(surfels)


def test_opposite_faces_are_kept_apart_for_long():
    """The two sides of a thin wall merge last, though they touch (C_n)."""
    scene, lightmap = room()
    surfels = sample_surface(scene, surface_areas(scene, lightmap), 256)
    wall = np.stack([surfels.position, surfels.position]).reshape(-1, 3)[:, :2]
    position = np.concatenate([np.c_[wall[:128], np.zeros(128)], np.c_[wall[:128], np.zeros(128)]])
    normal = np.repeat([[0, 0, 1.0], [0, 0, -1.0]], 128, axis=0)
    sides = SurfelSet(
        position.astype(np.float32), normal.astype(np.float32), normal.astype(np.float32),
        np.zeros(256, np.int32), np.zeros((256, 2), np.float32), 0.01,
    )  # fmt: skip
    tree = hierarchy_of(sides, "clustering")
    upper = [set(tree.leaf[tree.begin[n] : tree.end[n]] < 128) for n in range(len(tree.child))]
    mixed = sum(len(one) == 2 for one in upper)
    kd = kd_tree(sides.position)
    mixed_kd = sum(
        len(set(kd.leaf[kd.begin[n] : kd.end[n]] < 128)) == 2 for n in range(len(kd.child))
    )
    assert mixed <= 15 < mixed_kd
