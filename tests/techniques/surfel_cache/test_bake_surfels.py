"""Surfels: their number, area and place, and how even they are."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.cut_scenes import cut_at_random
from support.surfel_scenes import triangle_areas
from support.tiny_scenes import quad_scene, room

from gibench.errors import BadInput
from gibench.rays.embree import scene_tracer
from gibench.techniques.surfel_cache.bake.surfels import (
    relax,
    sample_surface,
    spacing_of,
    surface_areas,
    surfels_at,
)


def barycentric_points(scene, surfels):
    corners = scene.corners[surfels.triangle].astype(np.float64)
    u, v = surfels.barycentric.astype(np.float64).T[:, :, None]
    assert (u >= 0).all() and (v >= 0).all() and (u + v <= 1 + 1e-6).all()
    return corners[:, 0] * (1 - u - v) + corners[:, 1] * u + corners[:, 2] * v


def test_their_areas_add_up_and_triangles_get_their_share(rng):
    scene, lightmap = room()
    count = int(rng.integers(200, 3000))
    surfels = sample_surface(scene, surface_areas(scene, lightmap), count)
    assert len(surfels) == count
    areas = triangle_areas(scene)
    assert surfels.area * count == pytest.approx(areas.sum(), rel=1e-9)
    got = np.bincount(surfels.triangle, minlength=len(areas))
    assert (np.abs(got - areas / surfels.area) < 1 + 1e-6).all()
    np.testing.assert_allclose(barycentric_points(scene, surfels), surfels.position, atol=1e-6)
    corners = scene.corners.astype(np.float64)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    np.testing.assert_allclose(surfels.normal, facing[surfels.triangle], atol=1e-6)


def test_small_triangles_share_a_surfel(rng):
    """A strip of slivers, none of which is worth a surfel, is worth four."""
    slivers = 40
    edges = np.sort(rng.uniform(0, 1, slivers - 1))
    edges = np.concatenate([[0], edges, [1]])
    quads = [((a, 0, 0), (0, 0, 1), (b - a, 0, 0)) for a, b in pairwise(edges)]
    scene, lightmap = quad_scene(quads, 1)
    surfels = sample_surface(scene, surface_areas(scene, lightmap), 4)
    assert len(surfels) == 4 and surfels.area == pytest.approx(0.25)
    # One in each quarter, to a sliver's width.
    widest = np.diff(edges).max()
    np.testing.assert_allclose(
        np.sort(surfels.position[:, 0]), np.arange(4) / 4 + 1 / 8, atol=widest
    )


def test_a_scene_without_area_is_refused():
    scene, lightmap = room()
    flat = replace(scene, positions=np.zeros_like(scene.positions))
    with pytest.raises(BadInput, match="the scene has no area"):
        sample_surface(flat, surface_areas(flat, lightmap), 10)


def test_halton_is_more_even_than_chance_and_relaxation_than_both(rng):
    """Against points at random (Clark and Evans 1954) and Poisson discs (Lagae and Dutre 2008)."""
    scene, lightmap = room()
    areas = surface_areas(scene, lightmap)
    halton = sample_surface(scene, areas, 3000)
    weights = rng.dirichlet((1, 1, 1), 3000)[:, 1:]
    triangle = rng.choice(len(areas), 3000, p=areas / areas.sum()).astype(np.int32)
    chance = spacing_of(surfels_at(scene, triangle, weights, halton.area))
    relaxed = relax(scene, halton, scene_tracer(scene), 10)
    before, after = spacing_of(halton), spacing_of(relaxed)
    assert chance.mean == pytest.approx(0.5, abs=0.06)
    assert chance.variation == pytest.approx(0.52, abs=0.06)
    assert before.mean > chance.mean + 0.05 and before.variation < chance.variation - 0.05
    assert after.mean > before.mean + 0.1 and after.variation < before.variation - 0.1
    assert after.relative_radius > 0.5
    # Still on the surface, on the side they were, and all of them.
    assert len(relaxed) == 3000 and relaxed.area == halton.area
    np.testing.assert_allclose(barycentric_points(scene, relaxed), relaxed.position, atol=1e-6)
    assert (np.einsum("ij,ij->i", relaxed.normal, halton.normal) > 0.99).all()


def test_none_lies_where_a_surface_is_cut_away(rng):
    scene, lightmap = room()
    scene = cut_at_random(scene, rng)
    areas = surface_areas(scene, lightmap)
    surfels = sample_surface(scene, areas, 1500)
    rows = scene.cutouts.rows(len(scene.triangles))[surfels.triangle]
    cut = np.flatnonzero(rows >= 0)
    assert len(cut) > 50
    u, v = surfels.barycentric[cut].T
    there = scene.cutouts.there(rows[cut], u, v)
    assert there.mean() > 0.99  # but of triangles of which next to nothing is left


def test_surfels_stay_with_their_object(rng):
    """A panel a finger off a wall keeps its share, however coarse the surfels are."""
    wall = ((-1, 0, 0), (2, 0, 0), (0, 2, 0))
    panel = ((-0.2, 0.8, 0.03), (0.4, 0, 0), (0, 0.4, 0))
    scene, lightmap = quad_scene([wall, panel], 4)
    surfels = sample_surface(scene, surface_areas(scene, lightmap), 300)
    relaxed = relax(scene, surfels, scene_tracer(scene), 10)
    counts = [np.bincount(scene.object_ids[s.triangle], minlength=2) for s in (surfels, relaxed)]
    assert (counts[0] == counts[1]).all() and counts[0][1] == pytest.approx(300 / 26, abs=1)
    assert (relaxed.position != surfels.position).any()
