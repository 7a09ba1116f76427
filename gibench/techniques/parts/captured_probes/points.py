"""Where on surfaces the texels of a probe's map look."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.scene.model import Scene
from gibench.techniques.parts.captured_probes.resample import ProbeMaps


@dataclass(frozen=True)
class Points:
    """Points of surfaces.

    Attributes:
        position: (n, 3) m.
        geometric: (n, 3) unit normals of their fronts.
        normal: (n, 3) unit shading normals.
    """

    position: Doubles = field(repr=False)
    geometric: Doubles = field(repr=False)
    normal: Doubles = field(repr=False)


def points_of(scene: Scene, maps: ProbeMaps) -> tuple[npt.NDArray[np.int64], Points]:
    """The texels (n,) that show fronts, and where."""
    shown = np.flatnonzero(maps.triangle >= 0)
    triangle = maps.triangle[shown]
    u, v = maps.barycentric[shown].astype(np.float64).T
    weights = np.stack([1 - u - v, u, v], axis=1)
    corners = scene.corners[triangle].astype(np.float64)
    normals = scene.normals[scene.triangles[triangle]].astype(np.float64)
    geometric = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return shown, Points(
        np.einsum("nk,nkx->nx", weights, corners),
        _unit(geometric),
        _unit(np.einsum("nk,nkx->nx", weights, normals)),
    )


def _unit(vectors: Doubles) -> Doubles:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
