"""What SRP bakes where something moves: the scene without it.

Objects that move would block the baked rays for ever where they lay. They are left out of the
bake; relight rays find them every frame (``movers.py``), and their own receivers take their light
from the probes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gibench.errors import BadInput
from gibench.scene.lightmap import Lightmap, some_receivers
from gibench.scene.model import Scene
from gibench.scene.motion.moving_objects import receiver_triangles

Moving = npt.NDArray[np.bool_]


def resting_scene(scene: Scene, moving: Moving) -> Scene:
    """``scene`` with the triangles ``moving`` (t,) shrunk to a corner of one that rests: no ray
    meets them, and every triangle keeps its number.

    Raises:
        BadInput: all of it moves.
    """
    if moving.all():
        raise BadInput(
            f"all of the scene '{scene.name}' moves",
            mend="leave something at rest, or run another technique",
        )
    positions = scene.positions.copy()
    positions[scene.triangles[moving].ravel()] = positions[scene.triangles[~moving][0, 0]]
    return replace(scene, positions=positions)


def resting_lightmap(lightmap: Lightmap, moving: Moving) -> Lightmap:
    """``lightmap`` without the receivers on what moves, and without a place for it."""
    uvs = lightmap.triangle_uvs.copy()
    uvs[moving] = np.nan
    rests = np.flatnonzero(~receivers_that_move(lightmap, moving))
    found = replace(some_receivers(lightmap, rests), triangle_uvs=uvs)
    # A receiver at rest keeps only what rests of its surface.
    fragments = found.fragments
    stays = ~moving[fragments.triangle]
    if stays.all():
        return found
    start = np.concatenate([[0], np.cumsum(stays)])[fragments.start].astype(np.int64)
    kept = replace(
        fragments,
        start=start,
        corners=fragments.corners[stays],
        triangle=fragments.triangle[stays],
        area=fragments.area[stays],
    )
    return replace(found, fragments=kept)


def receivers_that_move(lightmap: Lightmap, moving: Moving) -> npt.NDArray[np.bool_]:
    """Which receivers (n,) lie on the triangles ``moving``."""
    triangle = receiver_triangles(lightmap)
    return np.asarray((triangle >= 0) & moving[np.maximum(triangle, 0)])
