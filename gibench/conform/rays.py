"""Rays through the device's tree, against brute force in float64."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from gibench.arrays import Array
from gibench.rays.bvh import build_bvh
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.techniques.parts.conformance.case import Bench, Case, at_least, off
from gibench.techniques.parts.conformance.synthetic import random_scene, random_unit

RAYS = 400


def closest(corners: Array, origins: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Distance of every ray's first hit, infinite for none, its triangle (Moeller and Trumbore 1997
    in float64), and how far in barycentric coordinates the ray passes from any edge, (n,) each.
    """
    c = corners.astype(np.float64)
    e1, e2 = c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]
    o, d = origins.astype(np.float64)[:, None], directions.astype(np.float64)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.cross(d, e2[None])
        determinant = (p * e1).sum(-1)
        s = o - c[None, :, 0]
        u = (s * p).sum(-1) / determinant
        q = np.cross(s, e1[None])
        v = (q * d).sum(-1) / determinant
        t = (q * e2).sum(-1) / determinant
    inside = np.minimum(np.minimum(u, v), 1 - u - v)
    t = np.where((inside >= 0) & (t > 0), t, np.inf)
    margin = np.abs(np.where(np.isfinite(inside), inside, 1.0)).min(axis=1)
    first = t.argmin(axis=1)
    distance = t[np.arange(len(t)), first]
    return distance, np.where(np.isfinite(distance), first, -1), margin


def _hits(bench: Bench, rng: np.random.Generator, size: int, packets: bool) -> Iterator[float]:
    """Closest hits, and whether there is any within a limit."""
    corners = random_scene(rng, 70).corners
    origins = rng.uniform(-1.5, 1.5, (RAYS, 3)).astype(np.float32)
    directions = random_unit(rng, RAYS)
    distance, triangle, margin = closest(corners, origins, directions)
    certain = (margin > 1e-4) & ((distance > 1e-3) | ~np.isfinite(distance))
    yield at_least(float(certain.mean()), 0.8)
    device = bench.open()
    tree = DeviceBvh.upload(device, build_bvh(corners))
    tracer = DeviceTracer(device, tree, size, 300, packets=packets)
    found = tracer.closest(origins, directions)
    yield off(found.triangle[certain], triangle[certain])
    met = certain & (triangle >= 0)
    yield off(found.distance[met], distance[met], relative=1e-4)
    limits = rng.uniform(0.1, 2.0, RAYS).astype(np.float32)
    blocked = tracer.occluded(origins, directions, limits)
    certain &= np.abs(distance - limits) > 1e-3
    yield off(blocked[certain], (distance < limits)[certain])


CASES = [
    Case(
        "Rays through the tree",
        ("rays/trace.cl:trace_closest", "rays/trace.cl:trace_occluded"),
        partial(_hits, packets=False),
    ),
    Case(
        "Packets of rays through the tree",
        ("rays/trace_packets.cl:trace_closest", "rays/trace_packets.cl:trace_occluded"),
        partial(_hits, packets=True),
    ),
]
