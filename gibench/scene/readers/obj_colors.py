"""Colours of an OBJ file's vertices, which no specification describes: programs write three numbers
behind the position, from 0 to 1 or from 0 to 255, some with an alpha behind or a weight before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Array
from gibench.scene.readers.content import counted


def vertex_colors(
    found: Sequence[tuple[int, Array]], vertices: int
) -> tuple[Array | None, list[str]]:
    """The colours (v, 3), 0 to 1, where the file has any, white where a vertex has none; and what
    is to be said of them.

    Args:
        found: the three or four numbers (n, 3 or 4) behind positions, each with its first vertex.
        vertices: how many there are.
    """
    if not found:
        return None, []
    said: list[str] = []
    fours = [rows for _, rows in found if rows.shape[1] > 3]
    behind_weight = False
    if fours:
        # A weight is 1 but for rational curves, and so is the alpha of what cannot be seen through.
        first = all((rows[:, 0] == 1).all() for rows in fours)
        behind_weight = first and not all((rows[:, 3] == 1).all() for rows in fours)
        kind = "x y z w r g b" if behind_weight else "x y z r g b a, the alpha not used"
        count = sum(len(rows) for rows in fours)
        said.append(f"{counted(count, 'vertex', 'vertices')} of seven numbers: taken as {kind}")
    colors = np.ones((vertices, 3))
    for at, rows in found:
        skip = int(behind_weight and rows.shape[1] > 3)
        colors[at : at + len(rows)] = rows[:, skip : skip + 3]
    colors = np.nan_to_num(colors, nan=1.0)
    given = np.concatenate([colors[at : at + len(rows)] for at, rows in found])
    if given.max() > 1:
        if given.max() <= 255 and given.min() >= 0 and (given == np.round(given)).all():
            said.append("colours of vertices from 0 to 255: divided by 255")
            for at, rows in found:
                colors[at : at + len(rows)] /= 255
        else:
            over = int((given > 1).any(axis=1).sum())
            said.append(f"{counted(over, 'colour')} of vertices over 1: 1 used")
    return np.clip(colors, 0.0, 1.0), said
