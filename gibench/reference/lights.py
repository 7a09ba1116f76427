"""What the reference path tracer needs to know to sample lights.

Delta lights are all connected to. Emissive triangles are chosen by area times luminance, those that
emit by an image in pieces (``glow_pieces.py``), pixels of the environment by solid angle times
luminance; both are weighted against cosine-distributed directions (multiple importance sampling),
so a constant environment is not sampled at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles, Floats, Ints
from gibench.reference.glow_pieces import glow_pieces
from gibench.reference.luminance import luminance
from gibench.scene.glow import Glow
from gibench.scene.model import (
    DirectionalLight,
    Light,
    PointLight,
    Scene,
)

LIGHT_FLOATS = 12
"""Of a delta light (kernels_cl/reference/lights.cl)."""
# KHR_lights_punctual bounds the cone's fade below by this difference of cosines.
_LEAST_FADE = 0.001


@dataclass(frozen=True)
class EmitterTable:
    """Emissive triangles to sample.

    Attributes:
        triangle: (e,) int32 scene triangles; empty when nothing emits.
        table: (e,) float32 cumulative probability.
        density: (materials,) float32 density of samples per surface of each material, 1/m2.
        pieces: (e, 3, 2) float32 corners of what is sampled of each, as weights of the triangle's
            corners 1 and 2; empty without ``glow``, where all of it is sampled.
        glow: uint32, as kernels_cl/reference/glow.cl has it; None where no image emits.
    """

    triangle: Ints = field(repr=False)
    table: Floats = field(repr=False)
    density: Floats = field(repr=False)
    pieces: Floats = field(default_factory=lambda: np.empty((0, 3, 2), np.float32), repr=False)
    glow: npt.NDArray[np.uint32] | None = field(default=None, repr=False)


@dataclass(frozen=True)
class EnvironmentTable:
    """The environment to sample.

    Attributes:
        sampled: False where choosing directions by radiance gains nothing (constant or black).
        black: True when no light comes from it.
        density: (h, w) float32 density within each pixel, 1/sr.
        rows: (h,) float32 cumulative probability of the rows.
        columns: (h, w) float32 cumulative probability within each row.
        edges: (h + 1,) float32 cosines of the polar angles between the rows.
    """

    sampled: bool
    black: bool
    density: Floats = field(repr=False)
    rows: Floats = field(repr=False)
    columns: Floats = field(repr=False)
    edges: Floats = field(repr=False)


def triangle_areas(corners: Floats) -> Doubles:
    """Areas (t,) of triangles (t, 3, 3), m2."""
    c = corners.astype(np.float64)
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    return np.asarray(np.linalg.norm(normal, axis=1) / 2)


def emitter_table(scene: Scene) -> EmitterTable:
    """The scene's emissive triangles, chosen by area times luminance of the emission."""
    emission = np.array([m.emission for m in scene.materials], np.float64).reshape(-1, 3)
    strength = np.where((emission > 0).any(axis=1), luminance(emission), 0.0)
    shines = strength[scene.material_ids] > 0
    if scene.glow is not None:
        return _with_images(scene, scene.glow, strength, shines)
    triangle = np.flatnonzero(shines)
    power = strength[scene.material_ids[triangle]] * triangle_areas(scene.corners[triangle])
    total = power.sum()
    table = np.cumsum(power) / total if len(power) else power
    density = strength / total if len(power) else np.zeros_like(strength)
    return EmitterTable(
        triangle.astype(np.int32), table.astype(np.float32), density.astype(np.float32)
    )


def _with_images(
    scene: Scene, glow: Glow, strength: Doubles, shines: npt.NDArray[np.bool_]
) -> EmitterTable:
    """The emitters of a scene in which images emit: whole triangles, then the pieces of others."""
    shines[glow.triangle] = False
    plain = np.flatnonzero(shines)
    areas = triangle_areas(scene.corners)
    pieces = glow_pieces(glow, areas[glow.triangle])
    power = np.concatenate((strength[scene.material_ids[plain]] * areas[plain], pieces.power))
    total = float(power.sum()) or 1.0
    whole = np.broadcast_to(np.array(((0, 0), (1, 0), (0, 1)), np.float32), (len(plain), 3, 2))
    return EmitterTable(
        np.concatenate((plain, glow.triangle[pieces.row])).astype(np.int32),
        (np.cumsum(power) / total).astype(np.float32),
        (strength / total).astype(np.float32),
        np.concatenate((whole, pieces.corners)).astype(np.float32),
        pieces.packed(glow, len(scene.triangles), total),
    )


def environment_table(pixels: Floats) -> EnvironmentTable:
    """How to choose directions by the radiance of an equirectangular image (h, w, 3).

    A pixel is chosen by the luminance that bilinear interpolation gives it on average (its own
    colour weighs 3/4 along each axis, either neighbour 1/8) times its solid angle.
    """
    bright = luminance(pixels)
    height, width = bright.shape
    padded = np.concatenate((bright[:1], bright, bright[-1:]))
    mean = (padded[:-2] + 6 * padded[1:-1] + padded[2:]) / 8
    mean = (np.roll(mean, 1, axis=1) + 6 * mean + np.roll(mean, -1, axis=1)) / 8
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    solid_angle = (edges[:-1] - edges[1:])[:, None] * (2 * np.pi / width)
    power = mean * solid_angle
    total = power.sum()
    if total <= 0 or np.ptp(pixels.reshape(-1, 3), axis=0).max() == 0:
        one = np.ones((1, 1), np.float32)
        return EnvironmentTable(
            False, not np.any(pixels), one, one[0], one, np.array((1.0, -1.0), np.float32)
        )
    by_row = power.sum(axis=1)
    in_row = np.cumsum(power, axis=1)
    columns = in_row / np.where(by_row > 0, by_row, 1.0)[:, None]
    return EnvironmentTable(
        True,
        False,
        (power / total / solid_angle).astype(np.float32),
        (np.cumsum(by_row) / total).astype(np.float32),
        columns.astype(np.float32),
        edges.astype(np.float32),
    )


def delta_lights(lights: Sequence[Light]) -> Floats:
    """Delta lights as (n, 12) float32: position, direction, colour, kind, spot scale and offset.

    Kind 0 is directional (colour: irradiance), 1 point, 2 spot (colour: intensity). The spot's
    fade is clamp(cos * scale + offset, 0, 1) squared, as KHR_lights_punctual has it.
    """
    table = np.zeros((len(lights), LIGHT_FLOATS), np.float64)
    for row, light in zip(table, lights, strict=True):
        if isinstance(light, DirectionalLight):
            row[3:6] = light.direction
            row[6:9] = light.irradiance
        elif isinstance(light, PointLight):
            row[0:3] = light.position
            row[6:9] = light.intensity
            row[9] = 1
        else:
            inner, outer = math.cos(light.inner_angle), math.cos(light.outer_angle)
            scale = 1.0 / max(_LEAST_FADE, inner - outer)
            row[0:3] = light.position
            row[3:6] = light.direction
            row[6:9] = light.intensity
            row[9:] = 2, scale, -outer * scale
    return table.astype(np.float32)
