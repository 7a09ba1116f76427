"""Columns, piers and arched walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.arrays import Doubles
from gibench.scene.builtin.pieces import (
    Piece,
    circle,
    flat,
    panel,
    shifted,
)
from gibench.scene.builtin.shapes import curve, fluted_shaft, lathe, swept

# Neighbouring bands keep twice this apart, m, so that no wedge closes between them.
BAND_GAP = 0.02


@dataclass(frozen=True)
class Arcade:
    """What an arcade measures, metres.

    Attributes:
        bay: distance of columns; an arch with its two bands fills it exactly.
        band: width of the band around an arch.
        relief: how far the band stands out of the wall.
        thickness: of the wall.
        pier_half: half the side of the corner piers.
        radius: of the columns at their foot.
        segments: of a column's circle.
        rows: of quads along a shaft.
        arch_segments: of an arch.
    """

    bay: float
    band: float
    relief: float
    thickness: float
    pier_half: float
    radius: float
    segments: int
    rows: int
    arch_segments: int

    @property
    def opening(self) -> float:
        """Radius of an arch."""
        return self.bay / 2 - self.band


@dataclass(frozen=True)
class Storey:
    """Heights of a storey, metres.

    Attributes:
        name: for its objects.
        floor: of its floor.
        spring: where its arches begin.
        top: of its ceiling.
    """

    name: str
    floor: float
    spring: float
    top: float


def plinth_half(arcade: Arcade) -> float:
    """Half the side of the block under a column."""
    return arcade.radius * 1.45


def abacus_half(arcade: Arcade) -> float:
    """Half the side of the block on a column: it stands out a little from the arches it carries."""
    return max(arcade.band, arcade.thickness / 2 + arcade.relief) + 0.05


def _band_profile(arcade: Arcade) -> Doubles:
    """The arch's section (k, 2) as (radius, depth), from the front of the wall to its back."""
    inner, outer = arcade.opening, arcade.bay / 2 - BAND_GAP
    t, d, w = arcade.thickness / 2, arcade.relief, arcade.band
    front = [
        (outer, t), (outer, t + d), (outer - 0.33 * w, t + d), (outer - 0.42 * w, t + 0.6 * d),
        (outer - 0.85 * w, t + 0.6 * d), (inner, t),
    ]  # fmt: skip
    soffit = [(inner, t - arcade.thickness * i / 3) for i in (1, 2)]
    return np.array([*front, *soffit, *((r, -n) for r, n in reversed(front))])


def _half_section(arcade: Arcade) -> Doubles:
    """The foot of an arch in plan: (distance from the column's axis, depth)."""
    profile, t = _band_profile(arcade), arcade.thickness / 2
    foot = np.stack([arcade.bay / 2 - profile[:, 0], profile[:, 1]], axis=1)
    return np.concatenate([[(0.0, t)], foot, [(0.0, -t)]])


def arcade_wall(arcade: Arcade, storey: Storey, bays: int) -> list[Piece]:
    """A wall on arches along x, centred, its court side towards +z; it ends in corner piers.

    It has no top (the slab lies there) and no ends (the piers stand there).
    """
    t, bay = arcade.thickness / 2, arcade.bay
    angle = np.linspace(np.pi, 0, arcade.arch_segments + 1)
    profile = _band_profile(arcade)
    made: list[Piece] = []
    for i in range(bays):
        left = (i - bays / 2) * bay
        x = left + bay / 2
        arc = np.stack([np.cos(angle[::-1]), np.sin(angle[::-1])], axis=1) * profile[0, 0]
        y, top = storey.spring, storey.top
        frame = [(left, y), (left, top), (left + bay, top), (left + bay, y)]
        spandrel = np.concatenate([shifted(arc, x, y), frame])
        made.append(flat("", "stone", spandrel, origin=(0, 0, t), v=(0, 1, 0)))
        made.append(
            flat("", "stone", spandrel * [-1, 1], origin=(0, 0, -t), u=(-1, 0, 0), v=(0, 1, 0))
        )
        origin = np.tile([x, storey.spring, 0.0], (len(angle), 1))
        radial = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        depth = np.tile([0.0, 0.0, 1.0], (len(angle), 1))
        made += swept("", "stone", profile, (origin, radial, depth))
    half = _half_section(arcade)
    end = bays * bay / 2
    for side in (-1, 1):
        # The foot of the last arch hangs at the pier: closed from below. (x, z) with v = +z.
        section = np.stack([side * (end - half[:, 0]), half[:, 1]], axis=1)
        made.append(flat("", "stone", section, origin=(0, storey.spring, 0), v=(0, 0, 1)))
    return made


def pier(arcade: Arcade, storey: Storey, towards: tuple[float, float]) -> list[Piece]:
    """A square pier about the origin; walls meet its faces on the sides ``towards`` of x and z."""
    p, t = arcade.pier_half, arcade.thickness / 2
    y0, y1, spring = storey.floor, storey.top, storey.spring
    notched = [(-p, y0), (p, y0), (p, y1), (t, y1), (t, spring), (-t, spring), (-t, y1), (-p, y1)]
    made = []
    for normal in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        origin = (normal[0] * p, 0.0, normal[1] * p)
        u = (normal[1], 0.0, -normal[0])
        if normal in ((towards[0], 0.0), (0.0, towards[1])):
            made.append(flat("", "stone", notched, origin=origin, u=u, v=(0, 1, 0)))
        else:
            start = (origin[0] - p * u[0], y0, origin[2] - p * u[2])
            along = (2 * p * u[0], 0.0, 2 * p * u[2])
            made.append(panel("", "stone", start, along, (0, y1 - y0, 0), (1, 4)))
    return made


def column(arcade: Arcade, storey: Storey) -> list[Piece]:
    """A column about the origin: plinth, base, fluted shaft, capital, abacus.

    It carries a wall along x. Its plinth has no bottom; its abacus has a hole where arches stand.
    """
    y0, y1, r, n = storey.floor, storey.spring, arcade.radius, arcade.segments
    low, high = plinth_half(arcade), abacus_half(arcade)
    foot, neck, base = r * 1.35, r * 0.86, y0 + 0.16
    shaft = (base + 0.26, y1 - 0.62)
    made = _block("", low, y0, base)
    square = np.array([(-low, -low), (low, -low), (low, low), (-low, low)])
    made.append(flat("", "stone", square, [circle(foot, segments=n)], origin=(0, base, 0)))
    torus = curve(
        [(foot, base + 0.02), (r * 1.42, base + 0.06), (foot, base + 0.1), (r * 1.12, base + 0.14),
         (r * 1.18, base + 0.19), (r * 1.05, base + 0.24), (r, shaft[0])], 11
    )  # fmt: skip
    made += lathe("", "stone", np.concatenate([[(foot, base)], torus]), n)
    made.append(
        fluted_shaft("", "stone", (r, neck), shaft, flutes=16, segments=n, rows=arcade.rows)
    )
    y = shaft[1]
    bell = min(high * 0.94, r * 1.4)
    capital = curve(
        [(neck, y), (neck * 1.12, y + 0.04), (neck * 1.02, y + 0.09), (neck * 1.06, y + 0.2),
         (neck * 1.2, y + 0.34), (bell * 0.96, y + 0.45), (bell, y + 0.5)], 11
    )  # fmt: skip
    made += lathe("", "marble", capital, n)
    ring = circle(bell, segments=n)
    square = np.array([(-high, -high), (high, -high), (high, high), (-high, high)])
    made.append(flat("", "marble", square, [ring], origin=(0, y + 0.5, 0), v=(0, 0, 1)))
    made += _block("", high, y + 0.5, y1, "marble")
    # Arches stand to both sides along x.
    half = _half_section(arcade)
    section = np.concatenate([half[:-1], -half[:-1]])
    made.append(flat("", "marble", square, [section], origin=(0, y1, 0)))
    return made


def _block(
    name: str, half: float, bottom: float, top: float, material: str = "stone"
) -> list[Piece]:
    """The four sides of a square block about the origin."""
    corners = [(-half, half), (half, half), (half, -half), (-half, -half)]
    made = []
    for i in range(4):
        (x0, z0), (x1, z1) = corners[i], corners[(i + 1) % 4]
        made.append(
            panel(name, material, (x0, bottom, z0), (x1 - x0, 0, z1 - z0), (0, top - bottom, 0))
        )
    return made
