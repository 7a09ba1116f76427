"""Surfels: where they lie, and how evenly (Jendersie et al. 2016, section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from gibench.arrays import Bools, Doubles, Ints, Longs
from gibench.errors import BadInput
from gibench.rays.tracer import NO_HIT, RayTracer
from gibench.scene.cutouts import Cutouts
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.surfel_cache.bake.data import SurfelSet

# Attempts to find a point of a triangle with cut-outs where there is surface.
_TRIES = 256
# A triangle where none of so many points is there counts for nothing.
_PROBES = 64
# Relaxation looks at so many neighbours; a point of a regular triangular lattice has six.
_NEIGHBOURS = 8
# A surfel moves by at most this share of the spacing in one step.
_STEP = 0.3
# Points from which on their neighbours are looked for by all cores.
_MANY = 10_000
# Neighbours whose normals differ by more than 60 degrees lie on another surface.
_SAME_SURFACE = 0.5


def surface_areas(scene: Scene, lightmap: Lightmap) -> Doubles:
    """Area of every triangle, (t,) m2; of one with cut-outs what is there of it."""
    a, b, c = (scene.corners[:, k].astype(np.float64) for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    if scene.cutouts is not None:
        cut = scene.cutouts.triangle
        left = np.bincount(
            lightmap.fragments.triangle, lightmap.fragments.area, minlength=len(area)
        )
        area[cut] = np.minimum(area[cut], left[cut]) * _partly_there(scene.cutouts)
    return np.asarray(area)


def _partly_there(cutouts: Cutouts) -> Bools:
    """Which triangles with cut-outs (k,) are not wholly cut away."""
    from scipy.stats import qmc  # slow to load

    u, v = _in_triangle(qmc.Halton(d=2, scramble=False).random(_PROBES + 1)[1:]).T
    found = np.zeros(len(cutouts.triangle), np.bool_)
    for one, other in zip(u.astype(np.float32), v.astype(np.float32), strict=True):
        todo = np.flatnonzero(~found)
        at = (np.full(len(todo), one), np.full(len(todo), other))
        found[todo] = cutouts.there(todo, *at)
    return found


def sample_surface(scene: Scene, areas: Doubles, count: int) -> SurfelSet:
    """``count`` points on the scene's triangles, each standing for an equal share of their area.

    A triangle gets points in proportion to its area; what is left of it over whole points is
    carried on to the next, so that small triangles share one. Within a triangle they follow the
    Halton sequence in bases 2 and 3 (Halton and Smith 1964).

    Args:
        scene: the scene.
        areas: (t,) of its triangles, m2.
        count: of points.

    Raises:
        BadInput: the scene has no area.
    """
    from scipy.stats import qmc  # slow to load

    ends = np.cumsum(areas)
    total = float(ends[-1]) if len(ends) else 0.0
    if not total > 0:
        raise BadInput("the scene has no area", where=scene.name, mend="give it triangles")
    share = total / count
    place = (np.arange(count) + 0.5) * share
    triangle = np.minimum(np.searchsorted(ends, place, side="right"), len(ends) - 1)
    pairs = qmc.Halton(d=2, scramble=False).random(count + 1)[1:]
    weights = _in_triangle(pairs)
    if scene.cutouts is not None:
        weights = _on_what_is_there(scene, triangle, weights)
    return surfels_at(scene, triangle.astype(np.int32), weights, share)


def surfels_at(scene: Scene, triangle: Ints, weights: Doubles, area: float) -> SurfelSet:
    """Surfels on triangles (n,) at barycentric weights (n, 2) of their corners 1 and 2."""
    u, v = weights[:, 0:1], weights[:, 1:2]
    corners = scene.triangles[triangle]
    a, b, c = (scene.positions[corners[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    na, nb, nc = (scene.normals[corners[:, k]].astype(np.float64) for k in range(3))
    shading = na * (1 - u - v) + nb * u + nc * v
    length = np.linalg.norm(shading, axis=1, keepdims=True)
    shading = np.where(length > 1e-6, shading / np.maximum(length, 1e-30), normal)
    # A shading normal on the other side would light the surfel from behind.
    facing = np.einsum("ij,ij->i", shading, normal)[:, None] > 0
    return SurfelSet(
        position=(a * (1 - u - v) + b * u + c * v).astype(np.float32),
        normal=normal.astype(np.float32),
        shading=np.where(facing, shading, normal).astype(np.float32),
        triangle=triangle.astype(np.int32),
        barycentric=weights.astype(np.float32),
        area=area,
    )


def _in_triangle(pairs: Doubles) -> Doubles:
    """Points of the unit square stretched onto the triangle u + v <= 1, evenly."""
    root = np.sqrt(pairs[:, 0])
    return np.stack([1 - root, root * pairs[:, 1]], axis=1)


def _on_what_is_there(scene: Scene, triangle: Ints, weights: Doubles) -> Doubles:
    """The weights, those that fall into holes drawn anew from the rest of the sequence."""
    from scipy.stats import qmc  # slow to load

    assert scene.cutouts is not None
    rows = scene.cutouts.rows(len(scene.triangles))[triangle]
    weights = weights.copy()
    more = qmc.Halton(d=2, scramble=False)
    more.fast_forward(len(weights) + 1)
    todo = np.flatnonzero(rows >= 0)
    for _ in range(_TRIES):
        u, v = weights[todo].astype(np.float32).T
        todo = todo[~scene.cutouts.there(rows[todo], u, v)]
        if not len(todo):
            break
        weights[todo] = _in_triangle(more.random(len(todo)))
    return weights


def relax(scene: Scene, surfels: SurfelSet, tracer: RayTracer, steps: int) -> SurfelSet:
    """Surfels repelled by their nearest neighbours, ``steps`` times, along the surface.

    A step moves each in its tangent plane and sets it down on the surface by a short ray; where
    there is none (beyond an edge), or that of another object or material, it stays.
    """
    spacing = float(np.sqrt(surfels.area * 2 / np.sqrt(3)))  # of a triangular lattice
    for _ in range(steps):
        position, normal = (x.astype(np.float64) for x in (surfels.position, surfels.normal))
        count = min(_NEIGHBOURS + 1, len(position))
        distance, other = _neighbours(position, count)
        away = position[:, None] - position[other]
        same = np.einsum("ij,ikj->ik", normal, normal[other]) > _SAME_SURFACE
        push = np.where(same, np.clip(1 - distance / (1.5 * spacing), 0, None), 0.0)
        moved = (away * (push / np.maximum(distance, 1e-12))[:, :, None]).sum(axis=1) * spacing
        moved -= normal * np.einsum("ij,ij->i", moved, normal)[:, None]
        length = np.linalg.norm(moved, axis=1, keepdims=True)
        moved *= np.minimum(_STEP, _STEP * spacing / np.maximum(length, 1e-12))
        surfels = _set_down(scene, surfels, position + moved, 0.5 * spacing, tracer)
    return surfels


def query_threads(points: int) -> int:
    """Threads that look for the neighbours of so many points: few are found sooner by one."""
    return -1 if points > _MANY else 1


def _neighbours(points: Doubles, count: int) -> tuple[Doubles, Longs]:
    """Distances to the ``count`` - 1 nearest others of each point, and which those are."""
    distance, other = cKDTree(points).query(points, count, workers=query_threads(len(points)))
    return np.asarray(distance)[:, 1:], np.asarray(other, np.int64)[:, 1:]


def _set_down(
    scene: Scene, surfels: SurfelSet, wanted: Doubles, height: float, tracer: RayTracer
) -> SurfelSet:
    """The surfels moved to the surface beneath ``wanted`` (n, 3), within ``height`` of it."""
    normal = surfels.normal.astype(np.float64)
    hits = tracer.closest(
        (wanted + height * normal).astype(np.float32), -surfels.normal, 2 * height
    )
    found = np.flatnonzero(hits.triangle != NO_HIT)
    weights = np.stack([hits.u[found], hits.v[found]], axis=1).astype(np.float64)
    landed = surfels_at(scene, hits.triangle[found], weights, surfels.area)
    good = np.einsum("ij,ij->i", landed.normal, surfels.normal[found]) > _SAME_SURFACE
    # Onto another object close by it would take area, and light, that is not its own.
    left = surfels.triangle[found]
    for kind in (scene.object_ids, scene.material_ids):
        good &= kind[landed.triangle] == kind[left]
    rows = found[good]
    arrays = {}
    for name in ("position", "normal", "shading", "triangle", "barycentric"):
        values = getattr(surfels, name).copy()
        values[rows] = getattr(landed, name)[good]
        arrays[name] = values
    return SurfelSet(**arrays, area=surfels.area)


@dataclass(frozen=True)
class Spacing:
    """How evenly points are spread over a surface.

    Attributes:
        mean: distance to the nearest neighbour over the square root of the area per point: 0.5 of
            points thrown at random (Clark and Evans 1954), 1.07 of a triangular lattice.
        variation: the distances' standard deviation over their mean: 0.52 at random, 0 of a
            lattice.
        relative_radius: the first percentile of the distances over the lattice's, the largest
            there can be: 0.65 to 0.85 of Poisson discs (Lagae and Dutre 2008).
    """

    mean: float
    variation: float
    relative_radius: float


def spacing_of(surfels: SurfelSet) -> Spacing:
    """The spacing of surfels, of neighbours on the same surface."""
    points, normal = surfels.position.astype(np.float64), surfels.normal
    found, other = _neighbours(points, min(_NEIGHBOURS + 1, len(points)))
    same = np.einsum("ij,ikj->ik", normal, normal[other]) > _SAME_SURFACE
    nearest = np.where(same, found, np.inf).min(axis=1)
    distance = nearest[np.isfinite(nearest)]
    mean = float(distance.mean())
    lattice = np.sqrt(surfels.area * 2 / np.sqrt(3))
    return Spacing(
        mean=mean / float(np.sqrt(surfels.area)),
        variation=float(distance.std()) / mean,
        relative_radius=float(np.quantile(distance, 0.01) / lattice),
    )
