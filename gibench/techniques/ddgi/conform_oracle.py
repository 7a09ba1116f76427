"""DDGI's passes in float64 NumPy, written from the papers' formulas, one probe or point at a time
where that is plainer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.scene.model import Scene
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.parts.conformance.case import Tolerance
from gibench.techniques.parts.conformance.octahedral import (
    bordered,
    lookup,
    texel_directions,
)
from gibench.techniques.parts.conformance.shading import (
    STEP_BACK,
    direct_irradiance,
    surface,
)

ACTIVE, BLENDED, USABLE = 1, 2, 3
FAR = 1e27
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def randomise(
    technique: Any, rng: np.random.Generator, states: Sequence[int] = (0, 1, 2, 3)
) -> None:
    """Random offsets, states and maps with true borders."""
    probes, device = technique.probes, technique.device
    count, spacing = probes.volume.probes, np.array(probes.volume.spacing)
    data = np.zeros((count, 4))
    data[:, :3] = rng.uniform(-0.25, 0.25, (count, 3)) * spacing
    data[:, 3] = rng.choice(states, count)
    device.write(probes.data, data)
    irradiance = rng.uniform(0.2, 1.4, probes.irradiance.shape)
    mean = rng.uniform(0.05, 0.7, probes.distance.shape[:3])
    square = mean**2 + rng.uniform(0.0, 0.05, mean.shape)
    device.write(probes.irradiance, bordered(irradiance))
    device.write(probes.distance, bordered(np.stack([mean, square], axis=-1)))
    # As if so many frames had been: their number decides how much of a texel stays.
    probes.begun = int(200 * irradiance.flat[0])


SIZES = (1, 7, 64, 100)  # 7 and 100 divide none of the problems below
# 30 probes in blocks of 16 lanes leave lanes empty; 13 and 41 rays fill no list of four.
# A mean of 41 rays by sums of float32, decoded and encoded by powers (powr: 16 ulp in OpenCL 1.2,
# section 7.4, 1e-6), and the power of 5 multiplies what it is given.
IRRADIANCE = Tolerance(2e-5)
# The root of a difference of what is known to IRRADIANCE, over the mean.
VARIATION = Tolerance(1e-3, 2e-5)
# A power of 50 of a cosine multiplies its rounding.
DISTANCE = Tolerance(5e-5, 1e-7)
OFFSET = Tolerance(1e-5, 1e-6)
# Sums of positive values, by work-items and then by groups: some ten roundings on each one's way.
VARIABILITY = Tolerance(1e-6)

SMALL = {"counts": "5x3x2", "rays": 54, "fixed_rays": 13, "irradiance_texels": 5,
         "distance_texels": 7, "random_backface_threshold": 0.3}  # fmt: skip


@dataclass
class State:
    """What is on the device, as float64."""

    settings: DdgiSettings
    origin: Array
    spacing: Array
    counts: Array
    grid: Array  # (p, 3)
    offset: Array  # (p, 3)
    state: Array  # (p,) int
    irradiance: Array  # (p, s + 2, s + 2, 4)
    distance: Array  # (p, s + 2, s + 2, 2)
    directions: Array  # (rays, 3)
    kept: float  # share of a texel that stays in this frame

    @property
    def linear(self) -> bool:
        """Whether radiance itself is averaged, not its encoding."""
        return bool(self.settings.average == "linear")

    @property
    def longest(self) -> float:
        """The largest distance that is blended, m."""
        return float(1.5 * np.linalg.norm(self.spacing))

    @property
    def position(self) -> Array:
        """Where the probes are (p, 3), m."""
        return self.grid + self.offset


def state_of(technique: Any) -> State:
    """What is on the device, read back."""
    probes, read = technique.probes, technique.device.read
    data = read(probes.data).astype(np.float64)
    volume = probes.volume
    # Independent of the volume's own bookkeeping: a probe's data lie at its coordinates + scroll.
    x, y, z = np.meshgrid(*(np.arange(n) for n in volume.counts), indexing="ij")
    coordinates = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    stored = (coordinates + volume.scroll) % volume.counts
    place = (stored[:, 2] * volume.counts[1] + stored[:, 1]) * volume.counts[0] + stored[:, 0]
    grid = np.empty((volume.probes, 3))
    grid[place] = np.array(volume.origin) + coordinates * np.array(volume.spacing)
    return State(
        technique._settings,
        np.array(volume.origin),
        np.array(volume.spacing),
        np.array(volume.counts),
        grid,
        data[:, :3],
        data[:, 3].astype(int),
        read(probes.irradiance).astype(np.float64),
        read(probes.distance).astype(np.float64),
        read(probes.directions).astype(np.float64),
        _kept(technique._settings, probes.begun - 1),
    )


def _kept(settings: DdgiSettings, before: int) -> float:
    if settings.average == "encoded":
        return settings.hysteresis
    return min(settings.hysteresis, before / (before + 4))


# -- passes ------------------------------------------------------------------------------------


def gather(s: State, position: Array, bias: Array, normal: Array) -> tuple[Array, Array]:
    """Irradiance (n, 3) and which points are far from a border between two cells."""
    biased = position + bias
    cells = (biased - s.origin) / s.spacing
    certain = (np.abs(cells - np.rint(cells)) > 1e-4).all(axis=1)
    base = np.clip(np.floor(cells), 0, s.counts - 1).astype(int)
    alpha = np.clip(cells - base, 0, 1)
    total, weights = np.zeros((len(position), 3)), np.zeros(len(position))
    keyed = {
        tuple(np.rint((g - s.origin) / s.spacing).astype(int)): i for i, g in enumerate(s.grid)
    }
    for n in range(len(position)):
        for corner in np.ndindex(2, 2, 2):
            probe = keyed[tuple(np.minimum(base[n] + corner, s.counts - 1))]
            if s.state[probe] != USABLE:
                continue
            trilinear = np.prod(np.maximum(np.where(corner, alpha[n], 1 - alpha[n]), 1e-3))
            towards = s.position[probe] - position[n]
            facing = towards @ normal[n] / np.linalg.norm(towards) / 2 + 0.5
            weight = facing**2 + 0.2
            away = biased[n] - s.position[probe]
            distance = np.linalg.norm(away)
            mean, square = lookup(s.distance[probe], away[None] / distance)[0]
            if distance / s.longest > mean:
                variance = abs(mean**2 - square)
                seen = variance / (variance + (distance / s.longest - mean) ** 2)
                weight *= max(s.settings.visibility_floor, seen**3)
            if weight < (crush := s.settings.crush_threshold):
                weight = weight**3 / crush**2
            weight *= trilinear
            total[n] += weight * term(s, probe, normal[n][None])[0]
            weights[n] += weight
    mean = total / np.maximum(weights, 1e-300)[:, None]
    cells = (position - s.origin) / s.spacing
    outside = np.maximum(np.maximum(-0.5 - cells, cells - s.counts + 0.5), 0)
    inside = np.prod(1 - np.minimum(outside, 1), axis=1)
    half = mean if s.linear else mean**2
    irradiance = np.where(weights[:, None] > 0, 2 * np.pi * half, 0) * inside[:, None]
    return irradiance, np.asarray(certain)


def term(s: State, probe: int, directions: Array) -> Array:
    """What a probe's map holds for directions (n, 3), as it is averaged over probes."""
    gamma, maps = s.settings.exponent, s.irradiance[probe]
    if s.linear:
        return lookup(maps**gamma, directions)[:, :3]
    return np.asarray(lookup(maps, directions)[:, :3] ** (gamma / 2))


def bias_of(s: State, normal: Array, towards_viewer: Array) -> Array:
    """How far gathering points are moved off a surface (n, 3)."""
    off = s.settings.normal_bias * normal + s.settings.view_bias * towards_viewer
    return np.asarray(off * min(s.spacing))


def shade(
    scene: Scene, frame: int, s: State, direction: Array, hits: tuple[Array, Array, Array, Array]
) -> tuple[Array, Array, Array]:
    """Radiance (n, 3), signed distance (n,) and which are certain, for hits (t, u, v, triangle)."""
    t, u, v, triangle = hits
    radiance = scene.environment.radiance(direction)
    distance = np.where(triangle < 0, FAR, t)
    certain = np.ones(len(t), bool)
    hit = np.flatnonzero(triangle >= 0)
    f = surface(scene, triangle[hit], u[hit], v[hit])
    front = np.einsum("ij,ij->i", f.geometric, direction[hit]) < 0
    lit = direct_irradiance(scene, frame, f.position, f.normal, f.geometric, STEP_BACK)
    bias = bias_of(s, f.geometric, -direction[hit])
    indirect, inside = gather(s, f.position, bias, f.normal)
    sent = f.emission + f.albedo / np.pi * (lit.irradiance + indirect)
    radiance[hit] = np.where(front[:, None], sent, 0)
    distance[hit] = np.where(front, t[hit], -t[hit])
    certain[hit] = (lit.certain & inside) | ~front
    return radiance, distance, certain


def blended_irradiance(
    s: State, radiance: Array, distance: Array
) -> tuple[Array, Array, Array, Array]:
    """New maps (p, texels, 3), their variation (p, texels), which probes take them, and which
    texels are not on a threshold. radiance (p, b, 3), distance (p, b)."""
    x = s.settings
    texels = texel_directions(x.irradiance_texels)
    cosine = np.maximum(0, texels @ s.directions[x.fixed :].T)
    front = distance >= 0
    weights = np.einsum("tb,pb->pt", cosine, front)
    sums = np.einsum("tb,pb,pbc->ptc", cosine, front, radiance)
    half = sums / np.maximum(2 * weights, 1e-9)[..., None]
    sample = half ** (1 / x.exponent)
    side = x.irradiance_texels
    previous = s.irradiance[:, 1:-1, 1:-1, :3].reshape(-1, side * side, 3)
    fresh = ~(s.state & BLENDED).astype(bool)[:, None]
    fall = (previous - sample).max(axis=2)
    keep = np.where(fall > x.irradiance_threshold, max(0, s.kept - 0.75), s.kept)
    rise = (sample - previous) @ LUMINANCE
    certain = (np.abs(fall - x.irradiance_threshold) > 1e-4) & (
        np.abs(rise - x.brightness_threshold) > 1e-4
    )
    change = np.where(rise > x.brightness_threshold, 0.25, 1.0)[..., None] * (sample - previous)
    moved = previous + (1 - keep[..., None]) * change
    if s.linear:
        moved = (s.kept * previous**x.exponent + (1 - s.kept) * half) ** (1 / x.exponent)
        certain = np.ones_like(certain)
    result = np.where(fresh[..., None], sample, moved)
    deviation = np.sqrt(np.maximum((sample - previous) * (sample - result), 0))
    variation = np.where(fresh, 0, deviation @ LUMINANCE / (result @ LUMINANCE))
    most = max(1, int(x.random_backface_threshold * x.blended))
    return result, variation, (~front).sum(axis=1) < most, certain | fresh


def blended_distance(s: State, distance: Array) -> Array:
    """New maps (p, texels, 2), in units of the longest distance."""
    x = s.settings
    side = x.distance_texels
    cosine = np.maximum(0, texel_directions(side) @ s.directions[x.fixed :].T)
    weights = cosine**x.distance_exponent
    d = np.minimum(np.where(distance < 0, -0.2 * distance, distance), s.longest) / s.longest
    mean = np.stack([d @ weights.T, d**2 @ weights.T], axis=-1)
    mean /= np.maximum(weights.sum(axis=1), 1e-300)[:, None]
    previous = s.distance[:, 1:-1, 1:-1].reshape(-1, side * side, 2)
    fresh = ~(s.state & BLENDED).astype(bool)[:, None, None]
    return np.where(fresh, mean, s.kept * previous + (1 - s.kept) * mean)


def relocated(s: State, fixed_distance: Array) -> Array:
    """New offsets (p, 3)."""
    x = s.settings
    rays = s.directions[: x.fixed]
    least = x.min_frontface_distance * min(s.spacing)
    out = s.offset.copy()
    for i, d in enumerate(fixed_distance):
        back, front = d < 0, d >= 0
        move = np.zeros(3)
        nearest = d[front].min() if front.any() else FAR
        if back.mean() > x.fixed_backface_threshold:
            j = np.argmin(np.where(back, -d, np.inf))
            move = rays[j] * (-d[j] + least / 2)
        elif nearest < least:
            a, b = np.argmin(np.where(front, d, np.inf)), np.argmax(np.where(front, d, -1))
            if rays[a] @ rays[b] <= 0.5:
                move = rays[b] * min(d[b], least)
        elif (length := np.linalg.norm(s.offset[i])) > 0:
            move = -s.offset[i] * min(nearest - least, length) / length
        if np.linalg.norm((s.offset[i] + move) / s.spacing) < 0.45:
            out[i] += move
    return out


def classified(s: State, fixed_distance: Array, accepted: Array) -> Array:
    """New states (p,)."""
    rays = np.abs(s.directions[: s.settings.fixed])
    in_cell = (s.spacing / np.maximum(rays, 1e-6)).min(axis=1)
    near = ((fixed_distance >= 0) & (fixed_distance <= in_cell)).any(axis=1)
    inside = (fixed_distance < 0).mean(axis=1) > s.settings.fixed_backface_threshold
    blended = (s.state & BLENDED > 0) | ((s.state & ACTIVE > 0) & (accepted > 0))
    return np.asarray((near & ~inside) * ACTIVE + blended * BLENDED)
