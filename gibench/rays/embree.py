"""Embree on the host, all cores: the tracer for everything that is baked.

Embree 4 through embreex, which offers single rays only and releases the GIL while it traces, so
rays are cut into chunks for a pool of threads.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from gibench.arrays import Floats
from gibench.rays.tracer import NO_HIT, Hits
from gibench.scene.model import Scene

# Small enough to balance two threads, large enough that Python's share of a chunk is lost in it.
_CHUNK_RAYS = 65536


class EmbreeTracer:
    """A :class:`~gibench.rays.tracer.RayTracer` by Embree, in its robust mode.

    Robust mode tests triangles in Pluecker coordinates and widens boxes against rounding, so that
    no ray slips through an edge that two triangles share. Triangles are hit from both sides.

    Its interval includes 0, and embreex has no way to say otherwise: a ray that starts exactly on a
    triangle may report that triangle at distance 0. Lift origins off their surfaces.

    Args:
        corners: (t, 3, 3) float32 corner positions of every triangle, m.
        threads: threads that trace; all cores when None.
    """

    def __init__(self, corners: Floats, threads: int | None = None) -> None:
        self.corners = np.ascontiguousarray(corners, np.float32).reshape(-1, 3, 3)
        self.threads = max(1, threads or os.cpu_count() or 1)
        self._scene = EmbreeScene(robust=True)
        self._mesh = TriangleMesh(self._scene, self.corners) if len(self.corners) else None
        # The first query commits the scene (builds its tree), which must not happen twice at once.
        self._run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), 1.0, "OCCLUDED")
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None

    def closest(
        self, origins: Floats, directions: Floats, max_distance: Floats | float = np.inf
    ) -> Hits:
        """Closest hits of rays (n, 3) at distances in (0, max_distance).

        ``max_distance`` is one number or (n,), in units of each direction's length.
        """
        o, d, limit = rays_of(origins, directions, max_distance)
        hits = Hits(
            np.empty(len(o), np.int32),
            np.empty(len(o), np.float32),
            np.empty(len(o), np.float32),
            np.empty(len(o), np.float32),
        )

        def trace(part: slice) -> None:
            found = self._run(o[part], d[part], _limit_of(limit, part), "INTERSECT", True)
            hits.triangle[part] = found["primID"]
            missed = found["primID"] < 0
            hits.distance[part] = np.where(missed, np.float32(np.inf), found["tfar"])
            hits.u[part] = found["u"]
            hits.v[part] = found["v"]

        self._chunked(len(o), trace)
        return hits

    def occluded(
        self, origins: Floats, directions: Floats, max_distance: Floats | float = np.inf
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether anything is hit at a distance in (0, max_distance)."""
        o, d, limit = rays_of(origins, directions, max_distance)
        blocked = np.empty(len(o), np.bool_)

        def trace(part: slice) -> None:
            found = self._run(o[part], d[part], _limit_of(limit, part), "OCCLUDED")
            blocked[part] = found != NO_HIT

        self._chunked(len(o), trace)
        return blocked

    def _run(
        self, o: Floats, d: Floats, limit: Floats | float, query: str, full: bool | None = None
    ) -> Any:
        """embreex's answer: triangle indices, or with ``full`` a dictionary of arrays."""
        # Embree accepts t = tfar; the interface's interval is open, hence the next float below.
        # `dists` is overwritten by embreex, hence always an array of our own.
        below = np.nextafter(np.float32(limit), np.float32(0.0))
        far = np.ascontiguousarray(np.broadcast_to(below, (len(o),)), np.float32).copy()
        return self._scene.run(o, d, dists=far, query=query, output=full)

    def _chunked(self, count: int, trace: Callable[[slice], None]) -> None:
        parts = [slice(i, min(i + _CHUNK_RAYS, count)) for i in range(0, count, _CHUNK_RAYS)]
        if self._pool is None or len(parts) < 2:
            for part in parts:
                trace(part)
        else:
            list(self._pool.map(trace, parts))


# By scene, as long as its vertices are held: one tree serves all that trace against a scene.
_TRACERS: dict[tuple[int, int], EmbreeTracer] = {}
_MAKING = threading.Lock()


def scene_tracer(scene: Scene) -> EmbreeTracer:
    """The tracer of ``scene``, all cores; made once for all scenes of the same triangles.

    Scenes that differ in lights alone share their arrays and so the tracer. It is let go with the
    arrays, which nobody may change.
    """
    key = id(scene.positions), id(scene.triangles)
    with _MAKING:
        if key not in _TRACERS:
            _TRACERS[key] = EmbreeTracer(scene.corners)
            for array in (scene.positions, scene.triangles):
                weakref.finalize(array, _TRACERS.pop, key, None)
        return _TRACERS[key]


def rays_of(
    origins: Floats, directions: Floats, max_distance: Floats | float
) -> tuple[Floats, Floats, Floats | float]:
    """Rays as contiguous float32 (n, 3) arrays and their limit as a number or (n,) float32.

    Raises:
        ValueError: the arrays' lengths differ.
    """
    o = np.ascontiguousarray(origins, np.float32).reshape(-1, 3)
    d = np.ascontiguousarray(directions, np.float32).reshape(-1, 3)
    if len(o) != len(d):
        raise ValueError(f"{len(o)} origins but {len(d)} directions")
    if np.ndim(max_distance) == 0:
        return o, d, float(max_distance)
    limit = np.ascontiguousarray(max_distance, np.float32).reshape(-1)
    if len(limit) != len(o):
        raise ValueError(f"{len(o)} origins but {len(limit)} maximal distances")
    return o, d, limit


def _limit_of(limit: Floats | float, part: slice) -> Floats | float:
    return limit[part] if isinstance(limit, np.ndarray) else limit
