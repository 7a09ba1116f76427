"""Where the error of captured probes comes from: one thing at a time replaced by the truth.

Usage: python tests/support/captured_errors.py [SCENE...] prints the table of
docs/light-field-probes.md. Everything is NumPy and Embree; light is that of probes that are lit
with any number of bounces.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.reference.path_tracer import reference_irradiance
from gibench.scene.builtin import build
from gibench.scene.lightmap.atlas import unwrap
from gibench.techniques.parts.captured_probes.bounced import RayGather
from gibench.techniques.parts.captured_probes.capture import capture, cube_directions
from gibench.techniques.parts.captured_probes.lighting import (
    Visibility,
    direct_irradiance,
    filtered_irradiance,
    filtered_moments,
    lit_once,
)
from gibench.techniques.parts.captured_probes.maps import bilinear, texel_directions
from gibench.techniques.parts.captured_probes.points import Points, points_of
from gibench.techniques.parts.captured_probes.resample import Resampling, resampled
from gibench.techniques.parts.captured_probes.settings import texel_sharpness
from gibench.techniques.parts.captured_probes.stages import far_plane
from gibench.techniques.parts.probe_volume import fit_counts, fit_volume

RECEIVERS, SIDE, CAPTURE, BIAS, THRESHOLD = 4000, 32, 128, 0.01, 0.25
CHEBYSHEV, EXACT, NONE = "Chebyshev", "exact", "none"


class Study:
    """A scene with its truth."""

    def __init__(self, name: str) -> None:
        self.scene = build(name)
        self.tracer = scene_tracer(self.scene)
        self.lightmap = unwrap(self.scene, RECEIVERS)
        cache = Path.home() / ".cache" / "gibench"
        truth = reference_irradiance(self.scene, self.lightmap, target_error=0.02, store_dir=cache)
        self.truth = truth.value
        r = self.lightmap.receivers
        normal = r.normal.astype(float)
        self.at = Points(r.position.astype(float), normal, normal)
        self.area = r.area.astype(float)
        low, high = self.scene.bounds
        self.tree = cKDTree(
            np.hstack([self.at.position, normal * 0.3 * np.linalg.norm(high - low)])
        )
        self.reach = 0.3 * np.linalg.norm(high - low)

    def true_at(self, at: Points) -> np.ndarray:
        """Indirect irradiance (n, 3) of the truth's nearest receiver that faces likewise."""
        _, own = self.tree.query(np.hstack([at.position, at.geometric * self.reach]))
        return self.truth[own]

    def errors(self, found: np.ndarray, where: np.ndarray | None = None) -> tuple[float, float]:
        """Bias and relative L2, as gibench.reference.metrics has them, over receivers ``where``."""
        own = slice(None) if where is None else where
        area, off, true = self.area[own, None], (found - self.truth)[own], self.truth[own]
        bias = (area * off).sum() / (area * true).sum()
        return float(bias), float(np.sqrt((area * off**2).sum() / (area * true**2).sum()))


@dataclass
class Probes:
    """Captured probes of a study."""

    study: Study
    budget: int

    def __post_init__(self) -> None:
        scene = self.study.scene
        low, high = scene.bounds
        self.volume = fit_volume(low, high, fit_counts(low, high, self.budget))
        self.far = far_plane(self.volume)
        directions = cube_directions(CAPTURE)
        resampling = Resampling.of(texel_directions(SIDE), directions, texel_sharpness(SIDE))
        self.maps = [
            resampled(capture(scene, self.study.tracer, p, directions), resampling, self.far)
            for p in self.volume.positions
        ]
        self.usable = np.array([m.back_share <= THRESHOLD for m in self.maps])
        moments = np.stack([m.moments for m in self.maps])
        self.moments = filtered_moments(moments, SIDE, texel_sharpness(SIDE))

    def lit(self, rays: int = 0, denoise: int = 2) -> np.ndarray:
        """Irradiance maps by the technique's own light."""
        how = RayGather(rays, denoise, BIAS, self.far) if rays else None
        s = self.study
        return lit_once(
            s.scene, s.scene.lights_at(0), s.tracer, self.maps, self.volume, self.usable, SIDE,
            None, BIAS, Visibility(self.moments, self.far, BIAS), how,
        ).irradiance  # fmt: skip

    def truly_lit(self) -> np.ndarray:
        """Irradiance maps of radiance that has the truth's irradiance on every surface."""
        s, sent = self.study, []
        for own in self.maps:
            radiance = own.emission.astype(float)
            texel, at = points_of(s.scene, own)
            light = direct_irradiance(s.scene, s.scene.lights_at(0), s.tracer, at) + s.true_at(at)
            radiance[texel] += own.albedo[texel] / np.pi * light
            sent.append(radiance)
        return filtered_irradiance(np.stack(sent).astype(np.float32), SIDE)

    def gathered(self, light: np.ndarray, sight: str, facing: bool = False) -> np.ndarray:
        """Irradiance (n, 3) at the receivers, by sight of ``sight``; ``facing``: probes behind a
        surface count less (Majercik et al. 2019).
        """
        s, volume = self.study, self.volume
        point = s.at.position + BIAS * s.at.geometric
        total, weights = np.zeros_like(point), np.zeros(len(point))
        texel, share = bilinear(s.at.normal, SIDE)
        for number, centre in enumerate(volume.positions):
            if not self.usable[number]:
                continue
            near = np.maximum(1 - np.abs(point - centre) / np.array(volume.spacing), 0).prod(axis=1)
            own = np.flatnonzero(near > 0)
            away = point[own] - centre
            meters = np.linalg.norm(away, axis=1)
            weight = near[own]
            if sight == CHEBYSHEV:
                t, w = bilinear(away / meters[:, None], SIDE)
                mean, square = np.einsum("nk,nkc->cn", w, self.moments[number][t].astype(float))
                behind = (meters - BIAS) / self.far - mean
                variance = np.abs(mean**2 - square)
                bound = variance / np.maximum(variance + behind**2, 1e-30)
                weight = weight * np.where(behind > 0, bound**3, 1.0)
            elif sight == EXACT:
                start = s.at.position[own] + surface_offset(s.scene) * s.at.geometric[own]
                to = centre - start
                length = np.linalg.norm(to, axis=1)
                hidden = s.tracer.occluded(
                    *(start.astype(np.float32), (to / length[:, None]).astype(np.float32)),
                    (0.9999 * length).astype(np.float32),
                )
                # Those that are seen alone; where none is, all that are near.
                weight = weight * np.where(hidden, 1e-9, 1.0)
            if facing:
                cosine = np.einsum("nx,nx->n", -away, s.at.normal[own]) / meters
                weight = weight * (((cosine + 1) / 2) ** 2 + 0.2)
            values = np.einsum("nk,nkc->nc", share[own], light[number][texel[own]])
            total[own] += weight[:, None] * values
            weights[own] += weight
        return total / np.maximum(weights, 1e-300)[:, None]


def main(names: list[str]) -> None:
    """Print the table."""
    for name in names:
        study = Study(name)
        halves: list[np.ndarray | None] = [None]
        if name.startswith("two-rooms"):
            x, middle = study.at.position[:, 0], study.scene.bounds
            away = x - float(np.mean(middle, axis=0)[0])
            sides = (away < -0.05, away > 0.05)
            halves.append(max(sides, key=lambda own: float(study.truth[own].mean())))
        for budget in (16, 64, 256):
            probes = Probes(study, budget)
            own, rays, true = probes.lit(), probes.lit(1), probes.truly_lit()
            found = {
                "as it is": (own, CHEBYSHEV, False),
                "bounces by rays": (rays, CHEBYSHEV, False),
                "bounces by rays, not smoothed": (probes.lit(1, 0), CHEBYSHEV, False),
                "no visibility": (own, NONE, False),
                "exact visibility": (own, EXACT, False),
                "true light in the probes": (true, CHEBYSHEV, False),
                "both true": (true, EXACT, False),
                "as it is, facing weight": (own, CHEBYSHEV, True),
                "both true, facing weight": (true, EXACT, True),
            }
            for what, how in found.items():
                result = probes.gathered(*how)
                told = [study.errors(result, where) for where in halves]
                figures = " | ".join(f"{100 * b:+.1f} % | {100 * e:.1f} %" for b, e in told)
                count = f"{probes.volume.probes} ({int(probes.usable.sum())})"
                print(f"| {name} | {count} | {what} | {figures} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or ["cornell-box", "two-rooms"])
