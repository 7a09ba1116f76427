"""Round furniture for the hall."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Doubles
from gibench.scene.builtin.pieces import (
    Piece,
    circle,
    flat,
    shifted,
)
from gibench.scene.builtin.shapes import curve, lathe, loft, superellipse


def furniture(segments: int) -> tuple[list[Piece], list[Doubles]]:
    """Sofas, tables with bowls, stools, plants; the rings (n, 2), in (x, -z), where they stand."""
    made: list[Piece] = []
    feet: list[Doubles] = []
    for i, (x, z, turn) in enumerate(((-3.9, 2.9, 180.0), (-3.9, 0.3, 0.0), (0.6, 2.7, 180.0))):
        body, foot = _sofa(f"sofa {i}", segments * 2)
        made += [part.moved((x, 0.0, z), turn) for part in body]
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        # (x, -z) turns the usual way.
        feet.append(foot @ np.array([[c, s], [-s, c]]) + [x, -z])
    for i, (x, z) in enumerate(((-3.9, 1.6), (0.6, 1.2), (-0.2, -3.0))):
        made += _table(f"table {i}", (x, 0.0, z), segments * 2)
        feet.append(circle(0.26, (x, -z), segments * 2))
    stools = ((-0.9, 1.7), (2.1, 1.4), (-1.3, -2.7), (0.9, -2.7), (-0.2, -3.9))
    for i, (x, z) in enumerate(stools):
        made += _stool(f"stool {i}", (x, 0.0, z), segments)
        feet.append(circle(0.17, (x, -z), segments))
    for i, (x, z) in enumerate(((-5.4, -0.5), (2.9, 3.8), (5.4, -3.9))):
        made += _plant(f"plant {i}", (x, 0.0, z), segments)
        feet.append(circle(0.2, (x, -z), segments))
    return made, feet


def _skin(name: str, material: str, ring: Doubles, profile: Doubles) -> Piece:
    """A cushion: ``ring`` (n, 2) shrunk by profile[:, 0] metres at height profile[:, 1]."""
    half = np.abs(ring).max(axis=0)
    rings = np.empty((len(profile), len(ring), 3))
    for row, (inset, y) in enumerate(profile):
        scaled = ring * (half - inset) / half
        rings[row] = np.stack([scaled[:, 0], np.full(len(ring), y), -scaled[:, 1]], axis=1)
    return loft(name, material, rings)


def _cushion(bottom: float, top: float, bulge: float, inset: float, rows: int = 9) -> Doubles:
    """Profile of a cushion: out from its foot, up, and in to a flat top ``inset`` inwards."""
    middle = (bottom + top) / 2
    body = curve(
        [(0.0, bottom + 0.03), (-bulge, bottom + 0.05 + 0.1 * (middle - bottom)), (-bulge, middle),
         (-bulge * 0.6, top - 0.08), (0.02, top - 0.015), (inset, top)], rows - 1
    )  # fmt: skip
    # It rises straight from what it stands on, so that no wedge closes over the floor.
    return np.concatenate([[(0.0, bottom)], body])


def _shrunk(ring: Doubles, inset: float) -> Doubles:
    half = np.abs(ring).max(axis=0)
    return np.asarray(ring * (half - inset) / half)


def _sofa(name: str, segments: int) -> tuple[list[Piece], Doubles]:
    """A seat with a back and two arms standing on its flat top; its foot's ring."""
    foot = superellipse(1.15, 0.5, segments, 6.0)
    made = [_skin(name, "fabric", foot, _cushion(0.0, 0.42, 0.03, 0.06))]
    top = _shrunk(foot, 0.06)
    backrest = shifted(superellipse(0.78, 0.1, segments, 5.0), 0.0, 0.3)
    arms = [shifted(superellipse(0.09, 0.36, segments // 2, 5.0), s * 0.95, 0) for s in (-1, 1)]
    made.append(flat(name, "fabric", top, [backrest, *arms], origin=(0.0, 0.42, 0.0)))
    for ring, height in ((backrest, 0.85), (arms[0], 0.6), (arms[1], 0.6)):
        center = (ring.max(axis=0) + ring.min(axis=0)) / 2
        body = ring - center
        offset = (center[0], 0.0, -center[1])
        profile = _cushion(0.42, height, 0.015, 0.05)
        made.append(_skin(name, "fabric", body, profile).moved(offset))
        cap = flat(name, "fabric", _shrunk(body, 0.05), origin=(0.0, height, 0.0))
        made.append(cap.moved(offset))
    return made, foot


def _table(name: str, at: tuple[float, float, float], segments: int) -> list[Piece]:
    """A round table on one foot, a bowl on it."""
    y = 0.46
    foot = curve([(0.26, 0.0), (0.22, 0.02), (0.06, 0.08), (0.045, 0.25), (0.08, y - 0.03)], 9)
    plate = [(0.55, y - 0.03), (0.57, y - 0.015), (0.55, y), (0.08, y)]
    bowl = curve([(0.08, y), (0.08, y + 0.02), (0.2, y + 0.05), (0.24, y + 0.13)], 7)
    inner = curve([(0.225, y + 0.13), (0.18, y + 0.06), (0.0, y + 0.025)], 6)
    return [
        *lathe(name, "wood", np.concatenate([foot, plate]), segments, at),
        *lathe(f"{name} bowl", "glaze", np.concatenate([bowl, inner]), segments, at),
    ]


def _stool(name: str, at: tuple[float, float, float], segments: int) -> list[Piece]:
    """A tulip stool."""
    leg = curve([(0.17, 0.0), (0.14, 0.02), (0.05, 0.1), (0.045, 0.25), (0.16, 0.38)], 9)
    seat = curve([(0.16, 0.38), (0.215, 0.42), (0.2, 0.47), (0.1, 0.485), (0.0, 0.48)], 9)
    return [
        *lathe(name, "steel", leg, segments, at),
        *lathe(name, "leather", seat, segments, at),
    ]


def _plant(name: str, at: tuple[float, float, float], segments: int) -> list[Piece]:
    """A pot with a clipped bush growing out of its soil."""
    pot = [(0.2, 0.0), (0.2, 0.03), *curve([(0.22, 0.05), (0.27, 0.22), (0.3, 0.45)], 5)]
    soil = [(0.27, 0.45), (0.26, 0.4), (0.03, 0.41)]
    bush = curve(
        [
            (0.03, 0.41),
            (0.03, 0.7),
            (0.25, 0.8),
            (0.4, 1.05),
            (0.3, 1.4),
            (0.15, 1.65),
            (0.0, 1.75),
        ],
        26,
    )
    return [
        *lathe(name, "glaze", np.concatenate([pot, soil]), segments, at),
        *lathe(name, "leaves", bush, segments, at),
    ]
