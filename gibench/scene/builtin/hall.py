"""A modern hall of two storeys: windows to the sky, a mezzanine, a staircase, round furniture.

The room lies between x = -6 and 6, z = -4.5 and 4.5, y = 0 and 6.2; the mezzanine is at its back.
All walls, slabs and steps end where they meet.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from gibench.arrays import Doubles
from gibench.scene.builtin.furniture import furniture
from gibench.scene.builtin.pieces import (
    Piece,
    circle,
    flat,
    panel,
)
from gibench.scene.builtin.settings import Settings
from gibench.scene.builtin.shapes import handrail, lathe, post

X, Z, HEIGHT = 6.0, 4.5, 6.2
# The mezzanine: its front edge, its underside and its floor.
EDGE, UNDER, DECK = -1.1, 3.0, 3.25
# The staircase rises towards -z and ends at the mezzanine's edge.
STAIR_X, STEPS, TREAD = (3.6, 5.1), 16, 0.29
RISE = DECK / (STEPS + 1)
FOOT = EDGE + STEPS * TREAD
REVEAL = 0.35
COLUMN_RADIUS, POST_RADIUS = 0.17, 0.018


@dataclass(frozen=True)
class Opening:
    """A window in a wall: from (u0, y0) to (u1, y1), metres along and up the wall."""

    u0: float
    y0: float
    u1: float
    y1: float

    @property
    def ring(self) -> Doubles:
        """Its outline (4, 2), counter-clockwise."""
        return np.array([(self.u0, self.y0), (self.u1, self.y0), (self.u1, self.y1),
                         (self.u0, self.y1)])  # fmt: skip


def parts(settings: Settings) -> list[Piece]:
    """All of the hall."""
    segments = int(settings.geometry["segments"])
    pieces, feet = furniture(segments)
    rails, deck_posts, tread_posts = _railings(segments)
    columns = [(x, EDGE - 0.45) for x in (-4.5, -1.5, 1.5)]
    rings = [circle(COLUMN_RADIUS, (x, -z), segments) for x, z in columns]
    made = [*pieces, *rails, *_walls(), *_stair(tread_posts)]
    stair_foot = _box_ring(STAIR_X, (_soffit_foot(), FOOT))
    room = _box_ring((-X, X), (-Z, Z))
    made.append(flat("floor", "floor", room, [stair_foot, *rings, *feet], metres_per_uv=2.0))
    lamps = [(-3.6, 1.9), (-1.2, 1.9), (1.2, 1.9)]
    mounts = [circle(0.05, (x, -z), segments) for x, z in lamps]
    # Seen from below, v is +z.
    flipped = [ring * [1, -1] for ring in mounts]
    made.append(flat("ceiling", "ceiling", room, flipped, origin=(0, HEIGHT, 0), v=(0, 0, 1)))
    for i, (x, z) in enumerate(lamps):
        made += _lamp(f"lamp {i}", (x, 0.0, z), segments)
    for i, ((x, z), ring) in enumerate(zip(columns, rings, strict=True)):
        del x, z
        heights = np.linspace(0.0, UNDER, 5)
        for y0, y1 in itertools.pairwise(heights):
            made.append(post(f"column {i}", "concrete", ring, y0, y1))
    deck = _box_ring((-X, X), (-Z, EDGE))
    made.append(flat("mezzanine", "wood", deck, deck_posts, origin=(0, DECK, 0), metres_per_uv=2.0))
    under = deck * [1, -1]
    holes = [ring * [1, -1] for ring in rings]
    made.append(flat("mezzanine", "ceiling", under, holes, origin=(0, UNDER, 0), v=(0, 0, 1)))
    # Its front edge leaves out what the last step covers.
    s0, s1 = STAIR_X
    edge = [(-X, UNDER), (s0, UNDER), (s0, DECK - RISE), (s1, DECK - RISE), (s1, UNDER),
            (X, UNDER), (X, DECK), (-X, DECK)]  # fmt: skip
    made.append(flat("mezzanine", "concrete", edge, origin=(0, 0, EDGE), v=(0, 1, 0)))
    return made


def parts_with_door(settings: Settings) -> list[Piece]:
    """All of the hall, and a door before the left wall's middle window, a hand's breadth off it."""
    low, high = (
        np.array(settings.geometry["door"]["low"]),
        np.array(settings.geometry["door"]["high"]),
    )
    size = high - low
    made = parts(settings)
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3], v[(axis + 2) % 3] = size[(axis + 1) % 3], size[(axis + 2) % 3]
        top = low.copy()
        top[axis] = high[axis]
        made.append(panel("door", "door", low, v, u))
        made.append(panel("door", "door", top, u, v))
    return made


def _box_ring(x: tuple[float, float], z: tuple[float, float]) -> Doubles:
    """The rectangle (4, 2) between two x and two z, in (x, -z)."""
    return np.array([(x[0], -z[1]), (x[1], -z[1]), (x[1], -z[0]), (x[0], -z[0])])


def _walls() -> list[Piece]:
    """Four walls; windows on the left and at the front, strips of light high up at the back."""
    made: list[Piece] = []
    back = [Opening(u, 4.3, u + 1.7, 5.5) for u in (1.0, 3.4, 5.8, 8.2)]
    low, high = (0.0, UNDER), (DECK, HEIGHT)
    made += _wall("back wall", (-X, -Z), (1, 0), [(0, 2 * X, *low)], [])
    made += _wall("back wall", (-X, -Z), (1, 0), [(0, 2 * X, *high)], back)
    # Side walls: under and over the mezzanine, and the part in front of it.
    deep = EDGE + Z
    left = [Opening(u, 0.5, u + 1.3, 5.4) for u in (0.45, 2.15, 3.85)]
    made += _wall("left wall", (-X, Z), (0, -1), [(0, 2 * Z - deep, 0.0, HEIGHT)], left)
    for span in (low, high):
        made += _wall("left wall", (-X, Z), (0, -1), [(2 * Z - deep, 2 * Z, *span)], [])
        made += _wall("right wall", (X, -Z), (0, 1), [(0, deep, *span)], [])
    made += _wall("right wall", (X, -Z), (0, 1), [(deep, 2 * Z, 0.0, HEIGHT)], [])
    front = [Opening(u, 0.4, u + 2.0, 5.6) for u in (2.6, 5.2, 7.8)]
    made += _wall("front wall", (X, Z), (-1, 0), [(0, 2 * X, 0.0, HEIGHT)], front)
    return made


def _wall(
    name: str,
    start: tuple[float, float],
    along: tuple[int, int],
    spans: list[tuple[float, float, float, float]],
    openings: list[Opening],
) -> list[Piece]:
    """Plane pieces of a wall (u0, u1, y0, y1) with windows, and the windows' reveals."""
    u = np.array([along[0], 0.0, along[1]])
    o = np.array([start[0], 0.0, start[1]])
    out = np.array([along[1], 0.0, -along[0]])
    made = []
    for u0, u1, y0, y1 in spans:
        ring = [(u0, y0), (u1, y0), (u1, y1), (u0, y1)]
        made.append(
            flat(name, "wall", ring, [w.ring for w in openings], origin=o, u=u, v=(0, 1, 0))
        )
    for window in openings:
        rim = window.ring
        for a, b in zip(rim, np.roll(rim, -1, axis=0), strict=True):
            corner = o + a[0] * u + [0, a[1], 0]
            side = (b[0] - a[0]) * u + [0, b[1] - a[1], 0]
            # Counter-clockwise round the opening, the inside lies to the left.
            made.append(panel(name, "frame", corner, side, REVEAL * out, (4, 1)))
    return made


def _soffit_foot() -> float:
    """Where the stair's sloping underside meets the floor, z."""
    return FOOT - 0.4


def _stair(tread_posts: list[tuple[int, Doubles]]) -> list[Piece]:
    """Steps on a sloping slab: treads, risers, two cheeks and the underside."""
    x0, x1 = STAIR_X
    made: list[Piece] = []
    outline = [(FOOT, 0.0)]
    for i in range(STEPS):
        z, y = FOOT - i * TREAD, (i + 1) * RISE
        outline += [(z, y), (z - TREAD, y)]
        made.append(panel("stair", "concrete", (x0, y - RISE, z), (x1 - x0, 0, 0),
                              (0, RISE, 0)))  # fmt: skip
        holes = [ring for step, ring in tread_posts if step == i]
        tread = _box_ring(STAIR_X, (z - TREAD, z))
        made.append(flat("stair", "wood", tread, holes, origin=(0, y, 0), metres_per_uv=2.0))
    outline += [(EDGE, UNDER), (_soffit_foot(), 0.0)]
    cheek = np.array(outline)
    # Seen from +x, u is -z; seen from -x, u is +z.
    made.append(flat("stair", "concrete", cheek * [-1, 1], origin=(x1, 0, 0), u=(0, 0, -1),
                     v=(0, 1, 0)))  # fmt: skip
    made.append(flat("stair", "concrete", cheek, origin=(x0, 0, 0), u=(0, 0, 1), v=(0, 1, 0)))
    slope = (0, UNDER, EDGE - _soffit_foot())
    made.append(panel("stair", "concrete", (x1, 0, _soffit_foot()), (x0 - x1, 0, 0), slope,
                          (1, 6)))  # fmt: skip
    return made


def _railings(segments: int) -> tuple[list[Piece], list[Doubles], list[tuple[int, Doubles]]]:
    """Rails along the mezzanine's edge and the stair.

    Returns the parts, the posts' feet on the mezzanine, and those on the stair with their step.
    """
    made: list[Piece] = []
    deck: list[Doubles] = []
    n = segments // 2
    z, height = EDGE - 0.12, 0.95
    for i, (x0, x1) in enumerate(((-5.9, STAIR_X[0] - 0.05), (STAIR_X[1] + 0.05, 5.9))):
        count = max(3, round((x1 - x0) / 0.14))
        rings = [circle(POST_RADIUS, (x, -z), n) for x in np.linspace(x0 + 0.08, x1 - 0.08, count)]
        name = f"mezzanine rail {i}"
        made += [post(name, "steel", ring, DECK, DECK + height) for ring in rings]
        made += handrail(name, "wood", (x0, DECK + height, z), (x1 - x0, 0, 0), (0.08, 0.05), rings)
        deck += rings
    treads: list[tuple[int, Doubles]] = []
    slope = RISE / TREAD
    for side, x in enumerate((STAIR_X[0] + 0.07, STAIR_X[1] - 0.07)):
        rings = []
        name = f"stair rail {side}"
        start = np.array([x, RISE + height, FOOT - 0.04])
        run = np.array([0.0, 1.0, 0.0]) * slope + [0.0, 0.0, -1.0]
        run *= STEPS * TREAD - 0.08
        for i in range(STEPS):
            for share in (0.25, 0.75):
                ring = circle(POST_RADIUS, (x, -(FOOT - (i + share) * TREAD)), n)
                top = start[1] + slope * (start[2] + ring[:, 1])
                made.append(post(name, "steel", ring, (i + 1) * RISE, top))
                rings.append(ring)
                treads.append((i, ring))
        made += handrail(name, "wood", start, run, (0.07, 0.05), rings)
    return made, deck, treads


def _lamp(name: str, at: tuple[float, float, float], segments: int) -> list[Piece]:
    """A pendant: a rose at the ceiling, a cord, a globe."""
    globe, radius, top = 4.1, 0.24, HEIGHT
    angle = np.linspace(np.pi / 2 * 0.96, -np.pi / 2, 17)
    ball = np.stack([radius * np.cos(angle), globe + radius * np.sin(angle)], axis=1)
    ball[-1, 0] = 0.0
    cord = ball[0, 0]
    profile = np.concatenate([[(0.05, top), (0.05, top - 0.03), (cord, top - 0.06)], ball])
    # Going down, the outside is on the left: turn the profile round.
    return lathe(name, "lamp", profile[::-1], segments, at)
