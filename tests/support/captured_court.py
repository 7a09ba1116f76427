"""Captured probes in a box within a scene: whose the error is, one thing at a time.

Usage: python tests/support/captured_court.py sponza.obj [POINTS [PATHS]] prints the table of
docs/light-field-probes.md. Points lie evenly on the surfaces within the box, hidden ones among
them; their truth and the light of probes where it is "traced" are path-traced here, by Embree.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.lightmap.albedo import mean_albedo, mean_emission
from gibench.scene.load import load_scene
from gibench.techniques.parts.captured_probes.bounced import RayGather, cosine_directions
from gibench.techniques.parts.captured_probes.capture import capture, cube_directions
from gibench.techniques.parts.captured_probes.lighting import (
    Visibility,
    direct_irradiance,
    filtered_moments,
    gather_matrix,
    lit_once,
)
from gibench.techniques.parts.captured_probes.maps import texel_directions
from gibench.techniques.parts.captured_probes.points import Points
from gibench.techniques.parts.captured_probes.resample import Resampling, resampled
from gibench.techniques.parts.captured_probes.settings import texel_sharpness
from gibench.techniques.parts.captured_probes.stages import far_plane
from gibench.techniques.parts.probe_volume import Volume, fit_counts, fit_volume

# The court of Crytek Sponza as gibench loads it, up to the eaves, its galleries among it.
LOW, HIGH = np.array([-9.6, 0.05, -4.3]), np.array([8.9, 7.0, 3.8])
SIDE, CAPTURE, BIAS, BACKS, MOST = 32, 96, 0.01, 0.25, 12


@dataclass
class Court:
    """A scene, and light path-traced at points of it."""

    scene: object
    rng: np.random.Generator

    def __post_init__(self) -> None:
        scene = self.scene
        self.tracer, self.step = scene_tracer(scene), surface_offset(scene)
        c = scene.corners.astype(float)
        self.corners, self.face = c, np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
        self.lights = scene.lights_at(0)

    def points(self, triangle, u, v) -> Points:
        """Points of triangles."""
        w = np.stack([1 - u - v, u, v], axis=1)
        normals = self.scene.normals[self.scene.triangles[triangle]].astype(float)
        mixed = [np.einsum("nk,nkx->nx", w, a) for a in (self.corners[triangle], normals)]
        unit = [
            n / np.linalg.norm(n, axis=1, keepdims=True) for n in (mixed[1], self.face[triangle])
        ]
        return Points(mixed[0], unit[1], unit[0])

    def sampled(self, count: int) -> Points:
        """Points evenly on all surfaces within the box."""
        low, high = self.corners.min(axis=1), self.corners.max(axis=1)
        near = np.flatnonzero((low < HIGH).all(axis=1) & (high > LOW).all(axis=1))
        area = np.linalg.norm(self.face[near], axis=1)
        near = self.rng.choice(near, 16 * count, p=area / area.sum())
        a, b = self.rng.random((2, len(near)))
        found = self.points(near, np.sqrt(a) * (1 - b), np.sqrt(a) * b)
        own = np.flatnonzero(((found.position > LOW) & (found.position < HIGH)).all(axis=1))
        return chosen(found, own[:count])

    def traced(self, at: Points, paths: int) -> tuple[np.ndarray, np.ndarray]:
        """Indirect irradiance (n, 3), and the share of first rays (n,) that see backs."""
        total, backs = np.zeros((len(at.position), 3)), np.zeros(len(at.position))
        for _ in range(paths):
            path, left, now = np.arange(len(total)), np.ones((len(total), 3)), at
            for bounce in range(MOST):
                d = cosine_directions(now.normal, self.rng)
                go = np.einsum("nx,nx->n", d, now.geometric) > 0
                path, left, now, d = path[go], left[go], chosen(now, go), d[go]
                start = (now.position + self.step * now.geometric).astype(np.float32)
                hits = self.tracer.closest(start, d.astype(np.float32))
                seen = hits.triangle >= 0
                sky = self.scene.environment.radiance(d[~seen])
                np.add.at(total, path[~seen], np.pi * left[~seen] * sky)
                front = seen & (np.einsum("nx,nx->n", self.face[hits.triangle], d) < 0)
                if not bounce:
                    np.add.at(backs, path[seen & ~front], 1 / paths)
                if not front.any():
                    break
                triangle = hits.triangle[front].astype(np.int64)
                u, v = hits.u[front].astype(float), hits.v[front].astype(float)
                pieces = np.repeat(np.stack([1 - u - v, u, v], axis=1)[:, None], 3, axis=1)
                path, now = path[front], self.points(triangle, u, v)
                glow = np.pi * mean_emission(self.scene, triangle, pieces)
                np.add.at(total, path, left[front] * glow)
                left = left[front] * mean_albedo(self.scene, triangle, pieces)
                lit = direct_irradiance(self.scene, self.lights, self.tracer, now)
                np.add.at(total, path, left * lit)
                if bounce > 2:  # Russian roulette
                    chance = np.minimum(left.max(axis=1), 0.95)
                    go = self.rng.random(len(path)) < chance
                    path, now, left = path[go], chosen(now, go), left[go] / chance[go, None]
        return total / paths, backs

    def seen(self, at: Points, towards: np.ndarray) -> np.ndarray:
        """Which points (n,) see (n, 3)."""
        start = at.position + self.step * at.geometric
        to = towards - start
        length = np.linalg.norm(to, axis=1)
        rays = (start, to / length[:, None], 0.9999 * length)
        hidden = self.tracer.occluded(*(a.astype(np.float32) for a in rays))
        return ~hidden & (np.einsum("nx,nx->n", to, at.geometric) > 0)

    def by_traced_light(self, at: Points, volume: Volume, exact: bool, paths: int) -> np.ndarray:
        """Irradiance (n, 3) of probes that hold path-traced light, trilinear; ``exact``: of those
        that a point sees, where it sees any.
        """
        total, weights = np.zeros((len(at.position), 3)), np.zeros(len(at.position))
        counts, spacing = np.array(volume.counts), np.array(volume.spacing)
        grid = (at.position + BIAS * at.geometric - volume.origin) / spacing
        for corner in np.ndindex(2, 2, 2):
            cell = np.floor(grid).astype(int) + corner
            share = np.maximum(1 - np.abs(cell - grid), 0).prod(axis=1)
            own = np.flatnonzero((share > 0) & ((cell >= 0) & (cell < counts)).all(axis=1))
            place, points = volume.origin + cell[own] * spacing, chosen(at, own)
            light, backs = self.traced(Points(place, points.normal, points.normal), paths)
            share = share[own] * (backs <= BACKS)
            if exact:
                share = share * np.where(self.seen(points, place), 1.0, 1e-9)
            total[own] += share[:, None] * light
            weights[own] += share
        return total / np.maximum(weights, 1e-300)[:, None]


def chosen(at: Points, own) -> Points:
    """Some of the points."""
    return Points(at.position[own], at.geometric[own], at.normal[own])


def captured(court: Court, at: Points, volume: Volume) -> dict[str, np.ndarray]:
    """Irradiance (n, 3) of captured probes."""
    scene, directions, far = court.scene, cube_directions(CAPTURE), far_plane(volume)
    sharp = texel_sharpness(SIDE)
    resampling = Resampling.of(texel_directions(SIDE), directions, sharp)
    maps = [
        resampled(capture(scene, court.tracer, p, directions), resampling, far)
        for p in volume.positions
    ]
    usable = np.array([own.back_share <= BACKS for own in maps])
    moments = filtered_moments(np.stack([own.moments for own in maps]), SIDE, sharp)
    sight = Visibility(moments, far, BIAS)
    given = scene, court.lights, court.tracer, maps, volume, usable, SIDE, None, BIAS
    found = {}
    for name, known, rays in (
        ("irradiance probes", None, None),
        ("light field probes", sight, None),
        ("light field probes, bounces by rays", sight, RayGather(1, 2, BIAS, far)),
    ):
        light = lit_once(*given, known, rays).irradiance.reshape(-1, 3)
        found[name] = gather_matrix(volume, usable, SIDE, at, BIAS, known) @ light
    return found


def main(name: str, count: int = 1500, paths: int = 64) -> None:
    """Print the table."""
    court = Court(load_scene(name), np.random.default_rng(1))
    at = court.sampled(count)
    truth, backs = court.traced(at, paths)
    hidden = backs > 0.02
    light = truth[hidden].sum() / truth.sum()
    print(f"{hidden.mean():.0%} of the surface is hidden, with {light:.0%} of the light")
    volumes = [fit_volume(LOW, HIGH, fit_counts(LOW, HIGH, n)) for n in (160, 1280)]
    found = captured(court, at, volumes[0])
    for volume in volumes:
        for exact, sight in ((False, "no visibility"), (True, "exact visibility")):
            what = f"{volume.probes} probes, traced light, {sight}"
            found[what] = court.by_traced_light(at, volume, exact, max(1, paths // 8))
    for what, values in found.items():
        rows = []
        for own in (slice(None), ~hidden, hidden):
            off, true = (values - truth)[own], truth[own]
            l2 = np.sqrt((off**2).sum() / (true**2).sum())
            rows.append(f"{off.sum() / true.sum():+.0%}, {l2:.0%}")
        print(f"| {what} | {' | '.join(rows)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *(int(a) for a in sys.argv[2:]))
