"""Links: which senders light a cache, and by how much (Jendersie et al. 2016, section 4.5).

Rays are the cost, and these are not cast: to surfels that face away from the cache, to those below
the horizon of a cache on a surface, and to those in whose plane it lies. Of what is left each
surfel takes one. Surfels close by are too coarse for that: there short rays in all directions tell
how much of the view each surfel's own piece of surface fills.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gibench.arrays import Doubles, Floats, Ints
from gibench.rays.offset import SHORT_OF_TARGET
from gibench.rays.tracer import NO_HIT, RayTracer
from gibench.techniques.parts.directions import spherical_fibonacci
from gibench.techniques.surfel_cache.bake.data import (
    LINK_SCALE,
    Halves,
    Hierarchy,
    Links,
    SurfelSet,
)
from gibench.techniques.surfel_cache.sh import COEFFICIENTS, basis

CLOSE: Final = 4.0
"""Up to so many spacings (square roots of a surfel's area) a cache is close."""
CLOSE_RAYS: Final = 4096
"""Short rays over the whole sphere: a surfel that is just not close any more fills twenty."""
# Cosines below this are those of a surface in whose plane the other lies.
_GRAZING = 1e-4


@dataclass(frozen=True)
class Linker:
    """What the links of any cache are made from.

    Attributes:
        surfels: in the order of the hierarchy's leaves.
        tree: over them.
        tracer: of the scene.
        corners: (t, 3, 3) float32 of its triangles, m.
        offset: that rays start and end off surfaces by, m.
    """

    surfels: SurfelSet
    tree: Hierarchy
    tracer: RayTracer
    corners: Floats
    offset: float

    def __post_init__(self) -> None:
        columns = np.concatenate([self.surfels.position, self.surfels.normal], axis=1).T
        inner = np.flatnonzero(self.tree.child >= 0).astype(np.int32)
        object.__setattr__(self, "_columns", np.ascontiguousarray(columns))
        object.__setattr__(self, "_inner", inner)
        object.__setattr__(self, "_sphere", spherical_fibonacci(CLOSE_RAYS).astype(np.float32))
        object.__setattr__(self, "_owners", cKDTree(self._place(*self._points)))

    @property
    def _points(self) -> tuple[Floats, Floats]:
        return self.surfels.position, self.surfels.normal

    def _place(self, position: npt.NDArray[Any], normal: npt.NDArray[Any]) -> Doubles:
        """Where points lie, (n, 6): normals at right angles count as two spacings."""
        apart = np.sqrt(2.0) * np.sqrt(self.surfels.area)
        return np.concatenate([position, apart * normal], axis=1).astype(np.float64)

    def links(self, positions: Floats, normals: Floats | None, most: int) -> Links:
        """Links of caches at ``positions`` (n, 3), ``most`` of each at most.

        Args:
            positions: m.
            normals: (n, 3) of caches on surfaces, which see one side; None of caches that see all.
            most: links.
        """
        node = np.zeros((len(positions), most), np.int32)
        coefficients = np.zeros((len(positions), most, COEFFICIENTS), np.float16)
        rays = 0
        for i, position in enumerate(positions):
            normal = None if normals is None else normals[i]
            seen = self.visible(position, normal)
            rays += seen.rays
            own, found = self.cut(seen, most)
            node[i, : len(own)] = own
            coefficients[i, : len(own)] = found
        return Links(node, coefficients, rays)

    def visible(self, position: Floats, normal: Floats | None) -> Seen:
        """What a cache at ``position`` (3,) sees of the surfels."""
        x, y, z, nx, ny, nz = self._columns  # type: ignore[attr-defined]
        dx, dy, dz = x - position[0], y - position[1], z - position[2]
        squared = dx * dx + dy * dy + dz * dz
        facing = -(dx * nx + dy * ny + dz * nz)
        least = _GRAZING * np.sqrt(squared)
        meant = facing > least
        close = squared < CLOSE**2 * self.surfels.area
        if normal is not None:
            meant &= dx * normal[0] + dy * normal[1] + dz * normal[2] > least
        origin = position if normal is None else position + np.float32(self.offset) * normal
        parts = [
            self._far(np.flatnonzero(meant & ~close), position, origin),
            self._close(close, origin, normal),
        ]
        slot = np.concatenate([part.slot for part in parts])
        order = np.argsort(slot, kind="stable")
        return Seen(
            slot[order],
            np.concatenate([part.direction for part in parts])[order],
            np.concatenate([part.solid for part in parts])[order],
            sum(part.rays for part in parts),
        )

    def _far(self, slot: npt.NDArray[Any], position: Floats, origin: Floats) -> Seen:
        """Surfels ``slot`` of which a ray reaches the middle (equation 3)."""
        target, facing = self.surfels.position[slot], self.surfels.normal[slot]
        along = target + np.float32(self.offset) * facing - origin
        starts = np.broadcast_to(origin.astype(np.float32), along.shape)
        free = np.flatnonzero(~self.tracer.occluded(starts, along, 1 - SHORT_OF_TARGET))
        towards = target[free] - position
        squared = np.einsum("ij,ij->i", towards, towards)
        direction = towards / np.sqrt(squared)[:, None]
        cosine = -np.einsum("ij,ij->i", direction, facing[free])
        solid = np.float32(self.surfels.area) * cosine / squared
        return Seen(slot[free], direction, solid, len(slot))

    def _close(self, close: npt.NDArray[np.bool_], origin: Floats, normal: Floats | None) -> Seen:
        """What short rays find of the ``close`` surfels: each stands for an equal solid angle."""
        sphere: Floats = self._sphere  # type: ignore[attr-defined]
        rays = sphere if normal is None else sphere[sphere @ normal > 0]
        if not close.any():
            return Seen(np.zeros(0, np.int64), rays[:0], rays[:0, 0], 0)
        starts = np.broadcast_to(origin.astype(np.float32), rays.shape)
        reach = (CLOSE + 2) * float(np.sqrt(self.surfels.area))
        hits = self.tracer.closest(starts, rays, reach)
        found = np.flatnonzero(hits.triangle != NO_HIT)
        direction = rays[found]
        a, b, c = (self.corners[hits.triangle[found], k] for k in range(3))
        facing = np.cross(b - a, c - a)
        facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-30)
        point = origin + hits.distance[found][:, None] * direction
        front = np.flatnonzero(np.einsum("ij,ij->i", facing, direction) < 0)
        place = self._place(point[front], facing[front])
        owner = self._owners.query(place)[1]  # type: ignore[attr-defined]
        mine = close[owner]
        solid = np.full(int(mine.sum()), 4 * np.pi / len(sphere), np.float32)
        return Seen(owner[mine], direction[front][mine], solid, len(rays))

    def cut(self, seen: Seen, most: int) -> tuple[Ints, Halves]:
        """The cut of at most ``most`` senders that covers what is seen: nodes (k,), and their
        coefficients (k, 16) over the number of surfels and times LINK_SCALE.

        Refining the most important first refines a node before its children, which are no more
        important than it: the refined nodes are the most important inner nodes, in their order.
        Senders that are not seen are not counted.
        """
        if not len(seen.slot):
            return np.zeros(0, np.int32), np.zeros((0, COEFFICIENTS), np.float16)
        tree, inner = self.tree, self._inner  # type: ignore[attr-defined]
        each = np.bincount(seen.slot, seen.solid, minlength=len(self.surfels))
        sums = np.concatenate([[0.0], np.cumsum(each)])
        important = sums[tree.end[inner]] - sums[tree.begin[inner]]
        some = np.flatnonzero(important > 0)
        ranked = inner[some[np.argsort(-important[some], kind="stable")]]
        first = tree.child[ranked]
        shows = [sums[tree.end[c]] - sums[tree.begin[c]] > 0 for c in (first, first + 1)]
        count = 1 + np.cumsum(shows[0] & shows[1])
        refined = ranked[: int(np.searchsorted(count, most, side="right"))]
        is_refined = np.zeros(len(tree.child), np.bool_)
        is_refined[refined] = True
        below = tree.child[refined]
        nodes = np.concatenate([below, below + 1, [] if len(refined) else [0]]).astype(np.int32)
        nodes = nodes[~is_refined[nodes]]
        nodes = nodes[sums[tree.end[nodes]] - sums[tree.begin[nodes]] > 0]
        nodes = nodes[np.argsort(tree.begin[nodes])]
        starts = np.searchsorted(seen.slot, tree.begin[nodes])
        terms = basis(seen.direction) * (seen.solid / np.float32(np.pi))[:, None]
        summed = np.add.reduceat(terms, starts, axis=0)
        surfels = (tree.end[nodes] - tree.begin[nodes])[:, None]
        return nodes, (summed * (LINK_SCALE / surfels)).astype(np.float16)


@dataclass(frozen=True)
class Seen:
    """Samples of surfels that a cache sees, by surfel.

    Attributes:
        slot: (m,) surfel of each, ascending.
        direction: (m, 3) float32 unit, from the cache.
        solid: (m,) float32 solid angle, sr.
        rays: that were traced.
    """

    slot: npt.NDArray[Any]
    direction: Floats
    solid: Floats
    rays: int
