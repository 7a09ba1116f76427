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
from gibench.scene.cutouts import Cutouts
from gibench.scene.model import Scene

# How far behind a hole a ray goes on, as a share of the largest coordinate: a few roundings of a
# hit, less than what faces in one plane are apart (gibench.scene.readers.backs.STEP).
_BEHIND_A_HOLE = 2.0**-21
# Small enough to balance two threads, large enough that Python's share of a chunk is lost in it.
_CHUNK_RAYS = 65536


class _Tree:
    """Triangles (t, 3, 3) in a scene of Embree's."""

    def __init__(self, corners: Floats) -> None:
        self._scene = EmbreeScene(robust=True)
        self._mesh = TriangleMesh(self._scene, corners) if len(corners) else None
        # The first query commits the scene (builds its tree), which must not happen twice at once.
        self.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), 1.0, "OCCLUDED")

    def run(
        self, o: Floats, d: Floats, limit: Floats | float, query: str, full: bool | None = None
    ) -> Any:
        """embreex's answer: triangle indices, or with ``full`` a dictionary of arrays."""
        # Embree accepts t = tfar; the interface's interval is open, hence the next float below.
        # `dists` is overwritten by embreex, hence always an array of our own.
        below = np.nextafter(np.float32(limit), np.float32(0.0))
        far = np.ascontiguousarray(np.broadcast_to(below, (len(o),)), np.float32).copy()
        return self._scene.run(o, d, dists=far, query=query, output=full)


class EmbreeTracer:
    """A :class:`~gibench.rays.tracer.RayTracer` by Embree, in its robust mode.

    Robust mode tests triangles in Pluecker coordinates and widens boxes against rounding, so that
    no ray slips through an edge that two triangles share. Triangles are hit from both sides.

    Its interval includes 0, and embreex has no way to say otherwise: a ray that starts exactly on a
    triangle may report that triangle at distance 0. Lift origins off their surfaces.

    Triangles with cut-outs are kept in a tree of their own: a ray is traced against the whole ones
    first, then from hole to hole through the others, starting anew a little behind each.

    Args:
        corners: (t, 3, 3) float32 corner positions of every triangle, m.
        threads: threads that trace; all cores when None.
        cutouts: what is cut away of them, or None.
    """

    def __init__(
        self, corners: Floats, threads: int | None = None, cutouts: Cutouts | None = None
    ) -> None:
        self.corners = np.ascontiguousarray(corners, np.float32).reshape(-1, 3, 3)
        self.threads = max(1, threads or os.cpu_count() or 1)
        self._cutouts = cutouts
        whole = self.corners
        if cutouts is not None:
            rows = cutouts.rows(len(self.corners))
            self._whole_ids = np.flatnonzero(rows < 0).astype(np.int32)
            self._holed = _Tree(self.corners[cutouts.triangle])
            whole = self.corners[self._whole_ids]
        self._whole = _Tree(whole)
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
            own = _limit_of(limit, part)
            found = self._whole.run(o[part], d[part], own, "INTERSECT", True)
            hits.triangle[part] = found["primID"]
            missed = found["primID"] < 0
            hits.distance[part] = np.where(missed, np.float32(np.inf), found["tfar"])
            hits.u[part] = found["u"]
            hits.v[part] = found["v"]
            if self._cutouts is not None:
                mine = Hits(hits.triangle[part], hits.distance[part], hits.u[part], hits.v[part])
                self._nearer(self._cutouts, mine, o[part], d[part], own)

        self._chunked(len(o), trace)
        return hits

    def occluded(
        self, origins: Floats, directions: Floats, max_distance: Floats | float = np.inf
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether anything is hit at a distance in (0, max_distance)."""
        o, d, limit = rays_of(origins, directions, max_distance)
        blocked = np.empty(len(o), np.bool_)

        def trace(part: slice) -> None:
            own = _limit_of(limit, part)
            found = self._whole.run(o[part], d[part], own, "OCCLUDED")
            blocked[part] = found != NO_HIT
            if self._cutouts is not None:
                open_ = np.flatnonzero(~blocked[part])
                far = np.broadcast_to(np.float32(own), (len(o[part]),))[open_]
                through = self._through(self._cutouts, o[part][open_], d[part][open_], far)
                blocked[part][open_] = through.triangle >= 0

        self._chunked(len(o), trace)
        return blocked

    def _nearer(
        self, cutouts: Cutouts, hits: Hits, o: Floats, d: Floats, limit: Floats | float
    ) -> None:
        """Put hits of triangles with holes in the place of those of whole ones behind them."""
        hits.triangle[:] = np.append(self._whole_ids, np.int32(NO_HIT))[hits.triangle]
        far = np.minimum(hits.distance, np.broadcast_to(np.float32(limit), (len(o),)))
        found = self._through(cutouts, o, d, far)
        nearer = np.flatnonzero(found.triangle >= 0)
        for values, own in zip(hits, found, strict=True):
            values[nearer] = own[nearer]

    def _through(self, cutouts: Cutouts, o: Floats, d: Floats, far: Floats) -> Hits:
        """The closest hits before ``far`` (n,) of triangles with holes, where they are there."""
        count = len(o)
        triangle = np.full(count, NO_HIT, np.int32)
        distance = np.full(count, np.inf, np.float32)
        u, v = np.zeros(count, np.float32), np.zeros(count, np.float32)
        active = np.arange(count)
        start = np.zeros(count)  # of each ray, along it; behind the last hole
        step = np.full(count, _BEHIND_A_HOLE)
        last = np.full(count, NO_HIT, np.int64)
        length = np.linalg.norm(d.astype(np.float64), axis=1)
        while len(active):
            moved = start[active, None] * d[active].astype(np.float64)
            from_ = (o[active] + moved).astype(np.float32)
            left = (far[active] - start[active]).astype(np.float32)
            found = self._holed.run(from_, d[active], left, "INTERSECT", True)
            met = np.flatnonzero(found["primID"] >= 0)
            row, own_u, own_v = (found[name][met] for name in ("primID", "u", "v"))
            ray, active = active[met], active[met]
            along = start[ray] + found["tfar"][met]
            there = cutouts.there(row, own_u, own_v)
            stop = ray[there]
            triangle[stop] = cutouts.triangle[row[there]]
            distance[stop], u[stop], v[stop] = along[there], own_u[there], own_v[there]
            # A ray that meets the same triangle again has not come past it.
            step[ray] = np.where(row == last[ray], 2 * step[ray], _BEHIND_A_HOLE)
            last[ray] = row
            reach = np.abs(o[ray]).max(axis=1) + along * np.abs(d[ray]).max(axis=1)
            start[ray] = along + step[ray] * reach / length[ray]
            active = active[~there & (start[ray] < far[ray])]
        return Hits(triangle, distance, u, v)

    def _chunked(self, count: int, trace: Callable[[slice], None]) -> None:
        parts = [slice(i, min(i + _CHUNK_RAYS, count)) for i in range(0, count, _CHUNK_RAYS)]
        if self._pool is None or len(parts) < 2:
            for part in parts:
                trace(part)
        else:
            list(self._pool.map(trace, parts))


# By scene, as long as its vertices are held: one tree serves all that trace against a scene.
_TRACERS: dict[tuple[int, int, int], EmbreeTracer] = {}
_MAKING = threading.Lock()


def scene_tracer(scene: Scene) -> EmbreeTracer:
    """The tracer of ``scene``, all cores; made once for all scenes of the same triangles.

    Scenes that differ in lights alone share their arrays and so the tracer. It is let go with the
    arrays, which nobody may change.
    """
    held = (scene.positions, scene.triangles, *((scene.cutouts,) if scene.cutouts else ()))
    key = id(scene.positions), id(scene.triangles), id(scene.cutouts)
    with _MAKING:
        if key not in _TRACERS:
            _TRACERS[key] = EmbreeTracer(scene.corners, cutouts=scene.cutouts)
            for part in held:
                weakref.finalize(part, _TRACERS.pop, key, None)
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
