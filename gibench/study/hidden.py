"""Receivers whose texel lies partly inside other geometry."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Bools, Doubles
from gibench.progress import progress
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.lightmap import Fragments, Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.sampling import surface_points

RAYS = 64
"""Per receiver; of those that see backs with a twentieth of their rays, 96 % are found."""

_CHUNK = 16_384  # receivers at once: a million rays


def open_receivers(scene: Scene, lightmap: Lightmap, seed: int = 0) -> Bools:
    """Which receivers (n,) see the front of surfaces, or the sky, alone.

    The others lie in part inside of walls, or look at the back of something that has none. There
    truth, the mean over all of a texel's surface with black backs, is darker than what is to be
    seen of the texel; SRP leaves such rays out (Bennett 2019, section 5.6.5 and figure 5.6), and
    DDGI and GIBS look at its centroid. That they differ there is no error of any of them.

    Args:
        scene: the scene.
        lightmap: its receivers.
        seed: of the rays: cosine-weighted, from points all over each texel's surface.
    """
    rng, tracer = np.random.default_rng(seed), scene_tracer(scene)
    offset = surface_offset(scene)
    edges = scene.corners[:, 1:].astype(np.float64) - scene.corners[:, :1]
    facing = np.cross(edges[:, 0], edges[:, 1])
    found = np.ones(len(lightmap.receivers), bool)
    with progress("looking for receivers inside of geometry", len(found)) as advance:
        for begin in range(0, len(found), _CHUNK):
            part = slice(begin, min(begin + _CHUNK, len(found)))
            origins, _ = surface_points(_fragments_of(lightmap.fragments, part), RAYS, rng)
            normals = lightmap.receivers.normal[part].astype(np.float64)
            directions = _cosine_weighted(normals, rng)
            starts = origins + np.float32(offset) * normals[:, None].astype(np.float32)
            rays = directions.reshape(-1, 3).astype(np.float32)
            hit = tracer.closest(starts.reshape(-1, 3), rays).triangle
            struck = np.maximum(hit, 0)
            backs = (hit >= 0) & (np.einsum("rx,rx->r", facing[struck], rays) > 0)
            found[part] = ~backs.reshape(-1, RAYS).any(axis=1)
            advance(part.stop - part.start)
    return found


def _cosine_weighted(normals: Doubles, rng: np.random.Generator) -> Doubles:
    """Directions (n, RAYS, 3): a point of the unit sphere about the tip of each normal."""
    sphere = rng.normal(size=(len(normals), RAYS, 3))
    sphere /= np.linalg.norm(sphere, axis=2, keepdims=True)
    towards = normals[:, None] + sphere
    length = np.linalg.norm(towards, axis=2, keepdims=True)
    return np.asarray(towards / np.maximum(length, 1e-12), np.float64)


def _fragments_of(fragments: Fragments, part: slice) -> Fragments:
    """Those of the receivers ``part``."""
    start = fragments.start[part.start : part.stop + 1]
    own = slice(int(start[0]), int(start[-1]))
    return Fragments(
        start - start[0], fragments.corners[own], fragments.triangle[own], fragments.area[own]
    )
