"""Buildings cut out of blocks: a lattice of cells, each solid, air or open sky.

Faces lie between a solid cell and air and look into the air. Neighbouring faces share their
corners, so that no ray passes between them, and nothing is hidden inside a solid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.scene.builtin.pieces import Piece

AIR, SKY = 0, -1
"""A cell that faces look into, and one around the scene that none does."""

Edges = tuple[Doubles, Doubles, Doubles]


@dataclass(frozen=True)
class Blocks:
    """A lattice of cells.

    Attributes:
        edges: where cells begin and end along x, y and z, m, ascending.
        materials: of solid cells, numbered from 1.
        cells: (nx, ny, nz) AIR, SKY or a material's number; all around the lattice is SKY.
    """

    edges: Edges
    materials: tuple[str, ...]
    cells: npt.NDArray[np.int64] = field(repr=False)

    @staticmethod
    def of(edges: Sequence[Sequence[float]], materials: Sequence[str]) -> Blocks:
        """A lattice of air; edges may come in any order and more than once."""
        x, y, z = (_ascending(e) for e in edges)
        cells = np.full((len(x) - 1, len(y) - 1, len(z) - 1), AIR, np.int64)
        return Blocks((x, y, z), tuple(materials), cells)

    def fill(self, low: Sequence[float], high: Sequence[float], what: str | int) -> None:
        """Set the cells whose middles lie between two corners, m."""
        kind = self.materials.index(what) + 1 if isinstance(what, str) else what
        inside = []
        for edge, a, b in zip(self.edges, low, high, strict=True):
            middle = (edge[1:] + edge[:-1]) / 2
            inside.append((middle > a) & (middle < b))
        self.cells[np.ix_(*inside)] = kind

    def pieces(self) -> list[Piece]:
        """The faces, a piece for each material and direction."""
        padded = np.pad(self.cells, 1, constant_values=SKY)
        made = []
        for axis in range(3):
            for step in (-1, 1):
                beside = np.roll(padded, step, axis)[1:-1, 1:-1, 1:-1]
                # A face of the air cell on the side of the solid one, which lies at -step.
                faces = np.where((self.cells == AIR) & (beside > 0), beside, 0)
                for kind in np.unique(faces[faces > 0]):
                    name = self.materials[kind - 1]
                    made.append(self._faces(name, np.argwhere(faces == kind), axis, step))
        return made

    def _faces(self, name: str, cells: npt.NDArray[np.int64], axis: int, step: int) -> Piece:
        """Quads of air ``cells`` (n, 3), their fronts along ``step`` times the axis."""
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ring = [(0, 0), (1, 0), (1, 1), (0, 1)] if step > 0 else [(0, 0), (0, 1), (1, 1), (1, 0)]
        corners = np.empty((len(cells), 4, 3))
        for i, (a, b) in enumerate(ring):
            corners[:, i, axis] = self.edges[axis][cells[:, axis] + (0 if step > 0 else 1)]
            corners[:, i, u] = self.edges[u][cells[:, u] + a]
            corners[:, i, v] = self.edges[v][cells[:, v] + b]
        normal = np.zeros(3)
        normal[axis] = step
        first = 4 * np.arange(len(cells))[:, None]
        triangles = (first[:, :, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        positions = corners.reshape(-1, 3)
        return Piece(
            name,
            name,
            positions,
            np.broadcast_to(normal, positions.shape),
            positions[:, [u, v]],
            triangles,
        )


def _ascending(edges: Sequence[float]) -> Doubles:
    """Each once; what sums of widths differ by in their last digits is the same."""
    return np.asarray(np.unique(np.round(np.asarray(edges, np.float64), 9)), np.float64)


def lines(*spans: float, start: float = 0.0) -> list[float]:
    """Edges one after the other, given the widths between them."""
    return [start, *(start + np.cumsum(spans)).tolist()]
