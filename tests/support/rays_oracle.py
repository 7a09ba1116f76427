"""Ray casting in float64 and the rays that are hard for float32: what test_rays* judge by."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gibench.rays.bvh_wide import WIDTH
from gibench.rays.tracer import Hits

# Half a unit in the last place of 1.0f.
ROUNDING = 2.0**-24


class Claim(NamedTuple):
    """What float64 says of one ray against one triangle, over n pairs.

    slack: m, how far the ray may miss the triangle (or start before it) and still be within
        float32's reach. distance: along the ray. reach: the same along the ray. outside: m, how far
        the ray passes outside of the nearest edge; negative inside.
    """

    distance: np.ndarray
    outside: np.ndarray
    slack: np.ndarray
    reach: np.ndarray


def closest_float64(corners, origins, directions):
    """Brute force by Moeller and Trumbore 1997 in float64: (triangle, t, u, v)."""
    c = np.asarray(corners, np.float64)
    e1, e2 = c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]
    n = len(origins)
    best = np.full(n, np.inf)
    triangle = np.full(n, -1)
    us, vs = np.zeros(n), np.zeros(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        for first in range(0, n, 256):
            part = slice(first, first + 256)
            o = np.asarray(origins[part], np.float64)[:, None]
            d = np.asarray(directions[part], np.float64)[:, None]
            p = np.cross(d, e2[None])
            det = (p * e1).sum(-1)
            s = o - c[None, :, 0]
            u = (s * p).sum(-1) / det
            q = np.cross(s, e1[None])
            v = (q * d).sum(-1) / det
            t = (q * e2).sum(-1) / det
            good = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
            t = np.where(good, t, np.inf)
            k = t.argmin(axis=1)
            rows = np.arange(len(k))
            hit = np.isfinite(t[rows, k])
            best[part] = t[rows, k]
            triangle[part] = np.where(hit, k, -1)
            us[part], vs[part] = np.where(hit, u[rows, k], 0), np.where(hit, v[rows, k], 0)
    return triangle, best, us, vs


def claim(corners, origins, directions, triangle) -> Claim:
    """Judge hits of rays (n, 3) on ``triangle`` (n,) in float64."""
    c = np.asarray(corners, np.float64)[triangle]
    o, d = np.asarray(origins, np.float64), np.asarray(directions, np.float64)
    length = np.linalg.norm(d, axis=1)
    rel = c - o[:, None]
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    size = np.linalg.norm(normal, axis=1)
    along = (normal * d).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (normal * rel[:, 0]).sum(1) / along
        cosine = np.abs(along) / (size * length)
        edges = np.roll(rel, -1, axis=1) - rel
        # The distance between the ray's line and an edge's line, signed: positive outside.
        volume = (np.cross(rel, np.roll(rel, -1, axis=1)) * d[:, None]).sum(-1)
        apart = np.linalg.norm(np.cross(edges, d[:, None]), axis=-1)
        outside = (-volume * np.sign(along)[:, None] / apart).max(axis=1)
    # Corners relative to the origin are rounded once, the shear and the edge functions a few times
    # more: eight roundings of the largest number in play.
    scale = np.maximum(np.abs(rel).max(axis=(1, 2)), np.abs(o).max(axis=1))
    slack = 8 * ROUNDING * scale
    with np.errstate(divide="ignore"):
        # A thin triangle's plane is known only as well as its height allows.
        height = size / np.linalg.norm(edges, axis=-1).max(axis=1)
        tilt = np.maximum(1.0, np.abs(rel).max(axis=(1, 2)) / height)
        reach = slack * tilt / (cosine * length)
    return Claim(distance, outside, slack, reach)


AGREE, EDGE, START, ALIKE, UNEXPLAINED = range(5)
REASONS = (
    "agree",
    "through an edge",
    "starts on a surface",
    "surfaces in one place",
    "unexplained",
)


def differences(corners, origins, directions, a: Hits, b: Hits):
    """Why ``a`` and ``b`` differ on each ray, (n,) indices of REASONS.

    They agree on the same triangle, or on distances equal to 1e-4 relative. A difference is
    explained where float64 finds, of the nearer hit, that the ray passes within float32's rounding
    of an edge or starts within rounding of the triangle; or that both distances are equal within
    what rounding the corners does to the two planes at this angle.
    """
    ta, tb = a.distance.astype(np.float64), b.distance.astype(np.float64)
    with np.errstate(invalid="ignore"):
        close = np.abs(ta - tb) <= 1e-4 * np.minimum(ta, tb)
    reason = np.full(len(ta), AGREE)
    i = np.flatnonzero((a.triangle != b.triangle) & ~close)
    if len(i):
        nearer_a = ta[i] < tb[i]
        near = np.where(nearer_a, a.triangle[i], b.triangle[i])
        far = np.where(nearer_a, b.triangle[i], a.triangle[i])
        n = claim(corners, origins[i], directions[i], near)
        f = claim(corners, origins[i], directions[i], np.where(far < 0, near, far))
        alike = (far >= 0) & (np.abs(n.distance - f.distance) <= n.reach + f.reach)
        at_start = np.abs(n.distance) <= n.reach
        at_edge = (np.abs(n.outside) <= n.slack) | ~np.isfinite(n.outside)
        reason[i] = np.select([at_start, at_edge, alike], [START, EDGE, ALIKE], UNEXPLAINED)
    return reason


def lifted(origins, directions, by):
    """Origins moved along their rays by ``by`` m, off whatever they start on."""
    step = by / np.linalg.norm(directions.astype(np.float64), axis=1, keepdims=True)
    return (origins + step * directions).astype(np.float32)


def areas_of(corners):
    """(t,) triangle areas and (t, 3) unit normals, float64."""
    c = np.asarray(corners, np.float64)
    cross = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return length / 2, cross / np.maximum(length, 1e-300)[:, None]


def surface_points(corners, n, rng):
    """(n, 3) points uniform over the surface and their triangles' normals, float64."""
    area, normal = areas_of(corners)
    i = rng.choice(len(corners), n, p=area / area.sum())
    u = rng.random((n, 2))
    u = np.where(u.sum(axis=1, keepdims=True) > 1, 1 - u, u)
    c = np.asarray(corners, np.float64)[i]
    point = c[:, 0] + (c[:, 1] - c[:, 0]) * u[:, :1] + (c[:, 2] - c[:, 0]) * u[:, 1:]
    return point, normal[i], i


def unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def cosine_rays(corners, n, rng, offset=1e-4):
    """Rays as a bake casts them: cosine distributed from surface points, lifted by ``offset`` m."""
    point, normal, _ = surface_points(corners, n, rng)
    direction = unit(normal * (1 + 1e-9) + unit(rng.normal(size=(n, 3))))
    return (point + offset * normal).astype(np.float32), direction.astype(np.float32)


def hard_rays(corners, n, rng):
    """Rays of every awkward kind, n of each: {kind: (origins, directions)} float32."""
    low = corners.reshape(-1, 3).min(axis=0).astype(np.float64)
    high = corners.reshape(-1, 3).max(axis=0).astype(np.float64)
    inside = lambda: low + (high - low) * rng.random((n, 3))  # noqa: E731
    axis = np.zeros((n, 3))
    axis[np.arange(n), rng.integers(0, 3, n)] = rng.choice([-1.0, 1.0], n)
    plane = unit(rng.normal(size=(n, 3)))
    plane[np.arange(n), rng.integers(0, 3, n)] = rng.choice([0.0, -0.0], n)
    on, normal, triangle = surface_points(corners, n, rng)
    c = np.asarray(corners, np.float64)[triangle]
    start = inside()
    corner = c[np.arange(n), rng.integers(0, 3, n)]
    k = rng.integers(0, 3, n)
    w = rng.random((n, 1))
    edge_point = c[np.arange(n), k] * w + c[np.arange(n), (k + 1) % 3] * (1 - w)
    tangent = unit(np.cross(normal, unit(rng.normal(size=(n, 3)))))
    graze = unit(tangent + normal * (10.0 ** rng.uniform(-6, -2, (n, 1))))
    rays = {
        "random": (inside(), rng.normal(size=(n, 3))),
        "outside": (low - (high - low) * rng.random((n, 3)), high - low + rng.normal(size=(n, 3))),
        "axis-parallel": (inside(), axis * rng.uniform(0.1, 10.0, (n, 1))),
        "one zero component": (inside(), plane),
        "from surfaces": (on, normal + unit(rng.normal(size=(n, 3)))),
        "axis-parallel from surfaces": (on, axis),
        "grazing": (on - 0.3 * graze, graze),
        "grazing from surfaces": (on, graze),
        "at corners": (start, corner - start),
        "at edges": (start, edge_point - start),
        "from corners": (corner, rng.normal(size=(n, 3))),
    }
    return {name: (o.astype(np.float32), d.astype(np.float32)) for name, (o, d) in rays.items()}


def box(low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0)):
    """The 12 triangles of an axis-aligned box, (12, 3, 3) float32."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [tri for a, b, c, d in quads for tri in ((a, b, c), (a, c, d))]
    low, high = np.asarray(low, np.float32), np.asarray(high, np.float32)
    return (low + (high - low) * corner)[np.array(faces)]


def soup(n, rng, extent=10.0, size=1.0):
    """n random triangles about ``size`` m large in a cube of ``extent`` m, (n, 3, 3) float32."""
    centre = rng.uniform(0, extent, (n, 1, 3))
    return (centre + rng.normal(0, size / 2, (n, 3, 3))).astype(np.float32)


def slivers(n, rng):
    """n long thin triangles, 5 m by 1 mm, (n, 3, 3) float32."""
    centre = rng.uniform(0, 10.0, (n, 3))
    along = 2.5 * unit(rng.normal(size=(n, 3)))
    across = 1e-3 * unit(rng.normal(size=(n, 3)))
    return np.stack([centre - along, centre + along, centre + across], axis=1).astype(np.float32)


def sphere(rings, segments):
    """A closed sphere of radius 1 with shared corners, (t, 3, 3) float32."""
    polar = np.linspace(0, np.pi, rings + 1)[:, None]
    around = np.linspace(0, 2 * np.pi, segments, endpoint=False)[None]
    grid = np.stack(
        [
            np.sin(polar) * np.cos(around),
            np.cos(polar) + 0 * around,
            np.sin(polar) * np.sin(around),
        ],
        axis=-1,
    ).astype(np.float32)
    grid[0], grid[-1] = (0, 1, 0), (0, -1, 0)
    nxt = np.roll(grid, -1, axis=1)
    upper = np.stack([grid[:-1], nxt[1:], grid[1:]], axis=2)[:-1].reshape(-1, 3, 3)
    lower = np.stack([grid[:-1], nxt[:-1], nxt[1:]], axis=2)[1:].reshape(-1, 3, 3)
    return np.concatenate([upper, lower])


def walk(bvh, corners):
    """Visit the whole tree as the kernel does; every triangle's leaf bounds must hold it."""
    nodes = bvh.nodes.reshape(-1, 7, WIDTH)
    children = nodes[:, 6].copy().view(np.int32)
    blocks = bvh.blocks.reshape(-1, 10, WIDTH)
    ids = blocks[:, 9].copy().view(np.int32)
    seen = []
    deepest = 0
    stack = [(0, 1, np.full(3, -np.inf), np.full(3, np.inf))]
    visited = 0
    while stack:
        node, depth, low, high = stack.pop()
        visited += 1
        deepest = max(deepest, depth)
        for slot in range(WIDTH):
            lower, upper = nodes[node, 0:6:2, slot], nodes[node, 1:6:2, slot]
            if lower[0] == np.inf:
                assert np.all(upper == -np.inf)
                continue
            assert np.all(lower >= low) and np.all(upper <= high)
            child = children[node, slot]
            if child >= 0:
                stack.append((child, depth + 1, lower, upper))
                continue
            first, count = ~child >> 2, (~child & 3) + 1
            for block in range(first, first + count):
                for lane in np.flatnonzero(ids[block] >= 0):
                    triangle = ids[block, lane]
                    stored = blocks[block, :9, lane].reshape(3, 3)
                    assert np.array_equal(stored, corners[triangle])
                    assert np.all(stored.min(0) >= lower) and np.all(stored.max(0) <= upper)
                    seen.append(int(triangle))
    assert visited == bvh.node_count
    return seen, deepest
