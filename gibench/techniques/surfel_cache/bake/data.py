"""What a bake of surfel caches consists of."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Bools, Doubles, Floats, Ints
from gibench.techniques.parts.probe_volume import Volume

LINK_SCALE: Final = 1024.0
"""A link's coefficients are stored times this, so that far senders' are no subnormal halves."""

Halves = npt.NDArray[np.float16]


@dataclass(frozen=True)
class SurfelSet:
    """The n surfels, all of one area.

    Attributes:
        position: (n, 3) float32 on the surface, m.
        normal: (n, 3) float32 unit, of the triangle.
        shading: (n, 3) float32 unit shading normal.
        triangle: (n,) int32 scene triangle each lies on.
        barycentric: (n, 2) float32 weights of its corners 1 and 2.
        area: of one, m2; n times it is the scene's.
    """

    position: Floats = field(repr=False)
    normal: Floats = field(repr=False)
    shading: Floats = field(repr=False)
    triangle: Ints = field(repr=False)
    barycentric: Floats = field(repr=False)
    area: float

    def __len__(self) -> int:
        return len(self.position)

    def taken(self, rows: npt.NDArray[Any]) -> SurfelSet:
        """The surfels ``rows`` (k,), in that order."""
        return SurfelSet(
            self.position[rows],
            self.normal[rows],
            self.shading[rows],
            self.triangle[rows],
            self.barycentric[rows],
            self.area,
        )


@dataclass(frozen=True)
class Hierarchy:
    """A binary tree over n surfels: 2 n - 1 nodes, level by level from the root, siblings side by
    side.

    Attributes:
        leaf: (n,) int32 the surfels in the order of the leaves from left to right.
        begin: (2 n - 1,) int32 first leaf beneath each node.
        end: (2 n - 1,) int32 one past its last leaf.
        child: (2 n - 1,) int32 its first child, the other stands behind it; -1 of a leaf.
        level: (levels + 1,) int32 first node of each level, then 2 n - 1.
    """

    leaf: Ints = field(repr=False)
    begin: Ints = field(repr=False)
    end: Ints = field(repr=False)
    child: Ints = field(repr=False)
    level: Ints = field(repr=False)


@dataclass(frozen=True)
class Atlas:
    """The caches' own light map over the scene's charts.

    Attributes:
        width: texels.
        height: texels.
        triangle_uvs: (t, 3, 2) float32 corners in texels; NaN where a triangle has no place.
        texel: (m,) int32 flat texel of each cache, ascending.
        position: (m, 3) float32 of the caches, m.
        normal: (m, 3) float32 unit.
    """

    width: int
    height: int
    triangle_uvs: Floats = field(repr=False)
    texel: Ints = field(repr=False)
    position: Floats = field(repr=False)
    normal: Floats = field(repr=False)


@dataclass(frozen=True)
class Caches:
    """The caches that are lit: those of the map, then those of the grid.

    Attributes:
        atlas: the map.
        volume: the grid; cells in the order of its data.
        map_kept: (m,) bool the atlas' caches that do not lie inside geometry.
        grid_kept: (cells,) bool the grid's.
        environment: (caches, 16, 3) float16 what each sees of the environment, W/m2/sr projected;
            None where that is black.
    """

    atlas: Atlas
    volume: Volume
    map_kept: Bools = field(repr=False)
    grid_kept: Bools = field(repr=False)
    environment: Halves | None = field(default=None, repr=False)

    @property
    def on_map(self) -> int:
        """Caches of the map that are lit."""
        return int(np.count_nonzero(self.map_kept))

    @property
    def in_grid(self) -> int:
        """Caches of the grid that are lit."""
        return int(np.count_nonzero(self.grid_kept))

    @property
    def left_out(self) -> int:
        """Caches that lie inside geometry."""
        return len(self.map_kept) + len(self.grid_kept) - self.on_map - self.in_grid

    @property
    def positions(self) -> Doubles:
        """Of the caches that are lit, (n, 3) m."""
        grid = self.volume.positions[self.grid_kept]
        return np.concatenate([self.atlas.position[self.map_kept].astype(np.float64), grid])


@dataclass(frozen=True)
class Links:
    """Links of some caches: the cut of the hierarchy that lights each.

    Attributes:
        node: (caches, links) int32 the sender of each; 0 where there are fewer.
        coefficients: (caches, links, 16) float16 of four bands, over the sender's number of
            surfels and times LINK_SCALE; 0 where there are fewer links.
        rays: that were traced for them.
    """

    node: Ints = field(repr=False)
    coefficients: Halves = field(repr=False)
    rays: int = 0


@dataclass(frozen=True)
class SurfelBake:
    """All that frames need.

    Attributes:
        surfels: in the order of the hierarchy's leaves.
        albedo: (n, 3) float32 of the surfels.
        emission: (n, 3) float32 of the surfels, W/m2/sr.
        hierarchy: over them.
        caches: that are lit.
        links: of every cache that is lit.
    """

    surfels: SurfelSet
    albedo: Floats = field(repr=False)
    emission: Floats = field(repr=False)
    hierarchy: Hierarchy
    caches: Caches
    links: Links
