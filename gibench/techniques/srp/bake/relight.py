"""Relight samples: the texel a probe sees in each fixed direction (Bennett 2019, section 5.2.1)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats, Ints
from gibench.progress import progress
from gibench.rays.tracer import Hits, RayTracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.data import ProbeSet, RelightSamples
from gibench.techniques.srp.bake.sampling import sphere_directions, triangle_planes
from gibench.techniques.srp.bake.sh import sh_basis

ESCAPED = -1
BLACK = -2


def texels_of_hits(lightmap: Lightmap, hits: Hits) -> Ints:
    """(n,) int32 the flat texel of each hit; -1 for a miss, -2 where the atlas has no receiver."""
    triangle = np.maximum(hits.triangle, 0)
    u, v = hits.u.astype(np.float64), hits.v.astype(np.float64)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    at = np.einsum("nc,ncx->nx", weights, lightmap.triangle_uvs[triangle].astype(np.float64))
    placed = np.isfinite(at).all(axis=1)
    x, y = np.where(placed[:, None], at, 0.0).astype(np.int64).T
    x, y = np.clip(x, 0, lightmap.width - 1), np.clip(y, 0, lightmap.height - 1)
    texel = y * lightmap.width + x
    texel = np.where(placed & (lightmap.receiver_of_texel[texel] >= 0), texel, BLACK)
    return np.where(hits.triangle < 0, ESCAPED, texel).astype(np.int32)


def relight_samples(
    scene: Scene,
    lightmap: Lightmap,
    probes: ProbeSet,
    tracer: RayTracer,
    sh_order: int,
    count: int,
    seed: int = 0,
) -> RelightSamples:
    """Trace ``count`` stratified rays from every probe."""
    directions = sphere_directions(count, np.random.default_rng([seed, 3])).astype(np.float32)
    basis = sh_basis(sh_order, directions) * (4.0 * np.pi / count)
    normals = triangle_planes(scene.corners)[:, :3]
    texel = np.empty((len(probes), count), np.int32)
    with progress("Relight rays", len(probes)) as advance:
        for index, position in enumerate(probes.positions.astype(np.float32)):
            hits = tracer.closest(np.broadcast_to(position, directions.shape), directions)
            texel[index] = texels_of_hits(lightmap, hits)
            texel[index, _from_behind(hits, directions, normals)] = BLACK
            advance(1)
    return RelightSamples(directions, basis.astype(np.float32), texel)


def _from_behind(hits: Hits, directions: Floats, normals: Floats) -> npt.NDArray[np.bool_]:
    facing = np.einsum("nx,nx->n", normals[hits.triangle], directions)
    return np.asarray((hits.triangle >= 0) & (facing >= 0))
