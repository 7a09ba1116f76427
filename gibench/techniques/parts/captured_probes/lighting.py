"""The light of probes that are lit once: direct light, then bounce by bounce.

What a map's texel sends to its probe is what is emitted there and what is reflected: albedo / pi
times direct light with shadow rays and, from the second bounce on, what random rays find
(``bounced.py``) or the irradiance that the probes hold for the place, interpolated and tested as in
a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from gibench.arrays import Doubles, Floats
from gibench.progress import progress
from gibench.rays.offset import surface_offset
from gibench.rays.tracer import RayTracer
from gibench.scene.model import DirectionalLight, Light, Scene, SpotLight
from gibench.techniques.parts.captured_probes.bounced import RayGather, bounced_radiance
from gibench.techniques.parts.captured_probes.maps import (
    bilinear,
    texel_directions,
    texel_solid_angles,
)
from gibench.techniques.parts.captured_probes.points import Points, points_of
from gibench.techniques.parts.captured_probes.resample import ProbeMaps, Resampling
from gibench.techniques.parts.macros import SHADOW_RAY_SHARE
from gibench.techniques.parts.probe_volume import Volume

MOST_BOUNCES = 64
SETTLED = 1e-4
"""Any number of bounces ends where the last adds less than this share of the light."""
_ROWS = 2048  # of the cosine matrix at once


@dataclass(frozen=True)
class Visibility:
    """The Chebyshev test of McGuire et al. 2017 (after Donnelly and Lauritzen 2006).

    Attributes:
        moments: (p, t, 2) filtered mean distance and mean squared distance, in units of ``far``.
        far: m.
        bias: taken off the distance of a point before it is compared, m.
    """

    moments: Floats = field(repr=False)
    far: float
    bias: float


def direct_irradiance(
    scene: Scene, lights: Sequence[Light], tracer: RayTracer, at: Points
) -> Doubles:
    """Irradiance (n, 3) of ``lights`` at points, W/m2."""
    origin = (at.position + surface_offset(scene) * at.geometric).astype(np.float32)
    total = np.zeros((len(at.position), 3))
    for light in lights:
        if isinstance(light, DirectionalLight):
            towards = np.broadcast_to(-np.asarray(light.direction), at.position.shape)
            limit = np.full(len(origin), np.inf)
            gain = np.broadcast_to(np.asarray(light.irradiance), towards.shape)
        else:
            offset = np.asarray(light.position) - at.position
            distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-6)
            towards = offset / distance[:, None]
            limit = distance * SHADOW_RAY_SHARE
            gain = np.asarray(light.intensity) / distance[:, None] ** 2
            if isinstance(light, SpotLight):
                gain = gain * _cone(light, towards)[:, None]
        cosine = np.einsum("nx,nx->n", at.normal, towards)
        facing = (cosine > 0) & (np.einsum("nx,nx->n", at.geometric, towards) > 0)
        asked = np.flatnonzero(facing & (gain.sum(axis=1) > 0))
        rays = np.ascontiguousarray(towards[asked], np.float32)
        hidden = tracer.occluded(origin[asked], rays, limit[asked].astype(np.float32))
        lit = asked[~hidden]
        total[lit] += gain[lit] * cosine[lit, None]
    return total


def _cone(light: SpotLight, towards: Doubles) -> Doubles:
    """How much of a spot light's intensity goes to where it is seen along ``towards`` (n, 3)
    (glTF, KHR_lights_punctual, "Inner and Outer Cone Angles").
    """
    outer = np.cos(light.outer_angle)
    scale = 1.0 / max(0.001, float(np.cos(light.inner_angle) - outer))
    cosine = -(towards @ np.asarray(light.direction))
    return np.asarray(np.clip((cosine - outer) * scale, 0.0, 1.0) ** 2)


def gather_matrix(
    volume: Volume,
    usable: npt.NDArray[np.bool_],
    side: int,
    at: Points,
    surface_bias: float,
    visibility: Visibility | None,
) -> csr_array:
    """(n, probes * texels) what each texel of the irradiance maps counts at each point.

    Trilinear weights, times the cubed Chebyshev bound where there is a ``visibility``; they sum to
    1, or to nothing where no probe counts.

    Args:
        volume: where the probes are; not scrolled.
        usable: (p,) probes that count.
        side: texels of a map's side.
        at: the points.
        surface_bias: how far off its surface a point is looked at, m.
        visibility: of the probes.
    """
    point = at.position + surface_bias * at.geometric
    counts = np.array(volume.counts)
    grid = (point - volume.origin) / np.array(volume.spacing)
    base = np.clip(np.floor(grid), 0, counts - 1).astype(np.int64)
    n = len(point)
    probe, weight = np.zeros((n, 8), np.int64), np.zeros((n, 8))
    for k in range(8):
        cell = base + np.array([k & 1, k >> 1 & 1, k >> 2])
        inside = (cell < counts).all(axis=1)
        cell = np.minimum(cell, counts - 1)
        probe[:, k] = (cell[:, 2] * counts[1] + cell[:, 1]) * counts[0] + cell[:, 0]
        share = np.maximum(1 - np.abs(cell - grid), 0).prod(axis=1)
        weight[:, k] = np.where(inside & usable[probe[:, k]], share, 0.0)
        if visibility is not None:
            centre = np.array(volume.origin) + cell * np.array(volume.spacing)
            weight[:, k] *= _seen(visibility, probe[:, k], point - centre, side)
    total = weight.sum(axis=1, keepdims=True)
    weight = np.divide(weight, total, out=np.zeros_like(weight), where=total > 0)
    texel, share = bilinear(at.normal, side)
    columns = probe[:, :, None] * side**2 + texel[:, None, :]
    values = weight[:, :, None] * share[:, None, :]
    rows = np.broadcast_to(np.arange(n)[:, None, None], columns.shape)
    shape = (n, volume.probes * side**2)
    matrix = csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape)
    matrix.eliminate_zeros()
    return matrix.astype(np.float32)


def _seen(
    visibility: Visibility, probe: npt.NDArray[np.int64], offset: Doubles, side: int
) -> Doubles:
    """(n,) the bound, cubed, on how much of what lies ``offset`` (n, 3) from a probe it sees."""
    distance = np.linalg.norm(offset, axis=1)
    texel, share = bilinear(offset / np.maximum(distance, 1e-9)[:, None], side)
    found = visibility.moments[probe[:, None], texel].astype(np.float64)
    mean, square = np.einsum("nk,nkc->cn", share, found)
    behind = (distance - visibility.bias) / visibility.far - mean
    variance = np.abs(mean**2 - square)
    bound = variance / np.maximum(variance + behind**2, 1e-30)
    return np.where(behind > 0, bound**3, 1.0)


def filtered_irradiance(radiance: Floats, side: int) -> Floats:
    """Irradiance maps (p, t, 3), W/m2, of radiance maps (p, t, 3).

    The integral over the hemisphere about a texel's direction, texel by texel of the radiance map
    with its solid angle; the weights are made to sum to pi.
    """
    probes, texels, _ = radiance.shape
    directions = texel_directions(side).astype(np.float32)
    angles = texel_solid_angles(side).astype(np.float32)
    columns = np.ascontiguousarray(radiance.transpose(1, 0, 2).reshape(texels, 3 * probes))
    found = np.empty((texels, 3 * probes), np.float32)
    for begin in range(0, texels, _ROWS):
        part = slice(begin, begin + _ROWS)
        weights = np.maximum(directions[part] @ directions.T, 0) * angles
        found[part] = np.pi * (weights @ columns) / weights.sum(axis=1, keepdims=True)
    return found.reshape(texels, probes, 3).transpose(1, 0, 2)


def filtered_moments(moments: Floats, side: int, sharpness: float) -> Floats:
    """Distance maps (p, t, 2): mean and mean square over a lobe cos^sharpness about each texel."""
    d = texel_directions(side)
    resampling = Resampling.of(d, d, sharpness)
    return np.stack([resampling.apply(own) for own in moments]).astype(np.float32)


@dataclass(frozen=True)
class Lit:
    """The light of probes that are lit once.

    Attributes:
        irradiance: (p, t, 3) W/m2.
        radiance: (p, t, 3) that it is the integral of, W/m2/sr.
    """

    irradiance: Floats = field(repr=False)
    radiance: Floats = field(repr=False)


def lit_once(
    scene: Scene,
    lights: Sequence[Light],
    tracer: RayTracer,
    maps: Sequence[ProbeMaps],
    volume: Volume,
    usable: npt.NDArray[np.bool_],
    side: int,
    bounces: int | None,
    surface_bias: float,
    visibility: Visibility | None,
    rays: RayGather | None = None,
) -> Lit:
    """Light probes.

    Args:
        scene: the scene.
        lights: as they stand.
        tracer: of the scene.
        maps: the probes' G-buffers.
        volume: where the probes are.
        usable: (p,) probes that count.
        side: texels of a map's side.
        bounces: of indirect light; None for any number.
        surface_bias: how far off its surface a point is looked at, m.
        visibility: of the probes, where they are tested.
        rays: that further bounces are gathered by; None: from the probes' irradiance.
    """
    albedo = np.stack([own.albedo for own in maps]).reshape(-1, 3)
    first, shown, found = _first(scene, lights, tracer, maps, side)
    most = (MOST_BOUNCES if bounces is None else bounces) - 1
    settled = SETTLED if bounces is None else 0.0
    if rays is not None and most > 0:
        radiance = bounced_radiance(
            scene, tracer, maps, volume, usable, side, first, most, settled, rays
        )
        return Lit(filtered_irradiance(radiance, side), radiance)
    light, radiance = filtered_irradiance(first, side), first
    if most == 0:
        return Lit(light, radiance)
    with progress("Lighting probes, bounce by bounce", most) as advance:
        gathers = [
            gather_matrix(volume, usable, side, at, surface_bias, visibility) for at in found
        ]
        for _ in range(most):
            before, radiance = light, first.copy()
            flat, sent = before.reshape(-1, 3), radiance.reshape(-1, 3)
            for texel, matrix in zip(shown, gathers, strict=True):
                sent[texel] += albedo[texel] / np.float32(np.pi) * (matrix @ flat)
            light = filtered_irradiance(radiance, side)
            advance(1)
            change = float(np.abs(light - before)[usable].sum())
            if change <= settled * float(light[usable].sum()):
                break
    return Lit(light, radiance)


def _first(
    scene: Scene, lights: Sequence[Light], tracer: RayTracer, maps: Sequence[ProbeMaps], side: int
) -> tuple[Floats, list[npt.NDArray[np.int64]], list[Points]]:
    """Radiance (p, t, 3) that is emitted or reflects direct light; each probe's texels that show
    fronts, as rows of all maps together; and where.
    """
    probes, texels = len(maps), side**2
    direct = np.zeros((probes, texels, 3), np.float32)
    shown, found = [], []
    for number, own in enumerate(maps):
        texel, at = points_of(scene, own)
        light = direct_irradiance(scene, lights, tracer, at)
        direct[number, texel] = own.albedo[texel] / np.float32(np.pi) * light
        shown.append(number * texels + texel)
        found.append(at)
    return np.stack([own.emission for own in maps]) + direct, shown, found
