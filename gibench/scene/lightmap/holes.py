"""What a lightmap's texels cover of triangles with cut-outs: only what is there."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Doubles, Longs
from gibench.scene.cutouts import Cutouts, surface_texels
from gibench.scene.lightmap.raster import Pieces

# A piece with holes is cut along each side into so many equal parts.
PARTS = 4


def without_holes(cutouts: Cutouts, pieces: Pieces, triangles: int) -> Pieces:
    """The pieces without what is cut away.

    A piece within whose bounds the mask has no surface is dropped, one with nothing else stays. Any
    other is cut into equal parts, of which those with surface at their middle stay; where none has,
    the last part does: there may be surface for a ray to meet, whose texel must be a receiver.

    Args:
        cutouts: of the scene.
        pieces: of its triangles.
        triangles: how many the scene has.
    """
    row = cutouts.rows(triangles)[pieces.triangle]
    holed = np.flatnonzero(row >= 0)
    if not len(holed):
        return pieces
    own, corners = row[holed], pieces.barycentric[holed]
    uvs = corners @ cutouts.uvs[own].astype(np.float64)
    found, of = np.zeros(len(own), np.int64), np.ones(len(own), np.int64)
    for number, image in enumerate(cutouts.images):
        mine = np.flatnonzero(cutouts.image[own] == number)
        found[mine], of[mine] = surface_texels(image, uvs[mine])
    keep = np.ones(len(row), np.bool_)
    keep[holed] = found == of
    mine = np.flatnonzero((found > 0) & (found < of))
    cut = _parts(corners[mine])
    centre = cut.mean(axis=2).astype(np.float32)
    there = cutouts.there(
        np.repeat(own[mine], PARTS**2), centre[..., 1].reshape(-1), centre[..., 2].reshape(-1)
    ).reshape(len(mine), PARTS**2)
    there[~there.any(axis=1), -1] = True
    piece, part = np.nonzero(there)
    owner = [np.flatnonzero(keep), holed[mine][piece]]
    parts = [pieces.barycentric[keep], cut[piece, part]]
    whose = np.concatenate(owner)
    order = np.argsort(whose, kind="stable")
    whose = whose[order]
    return Pieces(
        pieces.triangle[whose], pieces.x[whose], pieces.y[whose], np.concatenate(parts)[order]
    )


def _parts(corners: Doubles) -> Doubles:
    """PARTS squared equal parts of triangles (m, 3, 3) of weights, (m, PARTS squared, 3, 3)."""
    a, e, f = corners[:, :1], corners[:, 1:2] - corners[:, :1], corners[:, 2:] - corners[:, :1]
    places: list[list[tuple[int, int]]] = []
    for i in range(PARTS):
        for j in range(PARTS - i):
            places.append([(i, j), (i + 1, j), (i, j + 1)])
            if i + j < PARTS - 1:
                places.append([(i + 1, j + 1), (i, j + 1), (i + 1, j)])
    at = np.array(places, np.float64).reshape(1, -1, 3, 2, 1) / PARTS
    found = a[:, None] + e[:, None] * at[..., 0, :] + f[:, None] * at[..., 1, :]
    return np.asarray(found)


def kept_texels(pieces: list[Pieces], width: int) -> Longs:
    """The texels, flat, that pieces lie in."""
    return np.unique(np.concatenate([p.y * width + p.x for p in pieces]))
