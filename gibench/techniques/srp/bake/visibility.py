"""Visibility tables: most mutual-visibility rays need not be cast.

A receiver's primary rays land on the texels of the lightmap, and each texel is landed on hundreds
of times by receivers around the same probe. So a few rays from every probe to every texel decide
in advance: where they, and those to the eight neighbouring texels, agree, the texel is settled;
where they do not, a shadow's edge runs nearby and every pair gets its own ray. The same is done
for escapes with cells of directions around every probe.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter

from gibench.arrays import Bools, Floats
from gibench.progress import progress
from gibench.rays.offset import SHORT_OF_TARGET
from gibench.rays.tracer import RayTracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.parts.octahedral_maps import octahedral_decode
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.sampling import surface_points, triangle_planes

HIDDEN = 0
VISIBLE = 1
UNDECIDED = 2

POINTS_PER_TEXEL = 4
# Cells along one side of a probe's octahedral map of directions: 1.2 degrees each.
DIRECTION_GRID = 128
RAYS_PER_CELL_SIDE = 2


@dataclass(frozen=True)
class VisibilityTables:
    """What each probe sees.

    Attributes:
        grid: cells along one side of the octahedral map of directions.
        states: (n + grid^2 + 2, p) uint8, HIDDEN, VISIBLE or UNDECIDED (trace a ray): a row per
            receiver's texel, a row per direction cell towards the environment, then a row of
            HIDDEN and a row of UNDECIDED for samples that have neither.
    """

    grid: int
    states: npt.NDArray[np.uint8] = field(repr=False)


def no_tables(probes: int) -> npt.NDArray[np.uint8]:
    """The ``states`` of tables without receivers and directions: every pair needs a ray."""
    return np.repeat(np.array([[HIDDEN], [UNDECIDED]], np.uint8), probes, axis=1)


def visibility_tables(
    scene: Scene,
    lightmap: Lightmap,
    probes: ProbeSet,
    tracer: RayTracer,
    offset: float,
    seed: int = 0,
) -> VisibilityTables:
    """Build the tables of ``probes`` with rays that end ``offset`` metres off the surfaces."""
    rng = np.random.default_rng([seed, 2])
    points, triangle = surface_points(lightmap.fragments, POINTS_PER_TEXEL, rng)
    normals = triangle_planes(scene.corners)[:, :3][triangle].reshape(-1, 3)
    targets = points.reshape(-1, 3) + np.float32(offset) * normals
    receivers = len(lightmap.receivers)
    states = np.empty((receivers + DIRECTION_GRID**2 + 2, len(probes)), np.uint8)
    states[-2:] = no_tables(len(probes))
    with progress("Visibility between probes and texels", len(probes)) as advance:
        for index, probe in enumerate(probes.positions.astype(np.float32)):
            visible, hidden = _texels(probe, targets, normals, tracer)
            states[:receivers, index] = _settle(visible, hidden, lightmap)
            free, blocked = _directions(probe, tracer, rng)
            states[receivers:-2, index] = np.where(free & blocked, UNDECIDED, free)
            advance(1)
    return VisibilityTables(DIRECTION_GRID, states)


def _texels(
    probe: Floats, targets: Floats, normals: Floats, tracer: RayTracer
) -> tuple[Bools, Bools]:
    """Whether the probe sees any, and misses any, of each receiver's points it is in front of.

    A receiver all of whose points face away counts as both: whatever is hit there is decided by
    the plane test or by a ray.
    """
    toward = targets - probe
    facing = np.flatnonzero(np.einsum("nx,nx->n", normals, toward) < 0)
    origins = np.broadcast_to(probe, (len(facing), 3))
    blocked = tracer.occluded(origins, toward[facing], 1.0 - SHORT_OF_TARGET)
    state = np.zeros((2, len(targets)), np.bool_)
    state[0, facing] = ~blocked
    state[1, facing] = blocked
    visible, hidden = np.asarray(state.reshape(2, -1, POINTS_PER_TEXEL).any(axis=2))
    away = ~(visible | hidden)
    return visible | away, hidden | away


def _settle(visible: Bools, hidden: Bools, lightmap: Lightmap) -> npt.NDArray[np.uint8]:
    """(n,) the state of each receiver's texel from what its own and its neighbours' rays met."""
    maps = np.zeros((2, lightmap.height * lightmap.width), np.uint8)
    texel = lightmap.receivers.texel
    maps[0, texel] = visible
    maps[1, texel] = hidden
    shape = (lightmap.height, lightmap.width)
    near = [maximum_filter(m.reshape(shape), size=3).reshape(-1)[texel] > 0 for m in maps]
    return np.where(near[0] & near[1], UNDECIDED, visible).astype(np.uint8)


def _directions(probe: Floats, tracer: RayTracer, rng: np.random.Generator) -> tuple[Bools, Bools]:
    """Whether any ray of each direction cell, or of those around it, escapes and is blocked."""
    side = DIRECTION_GRID * RAYS_PER_CELL_SIDE
    row, column = np.divmod(np.arange(side * side), side)
    at = np.stack([column, row], axis=1) + rng.random((side * side, 2))
    directions = octahedral_decode(at * (2.0 / side) - 1.0).astype(np.float32)
    blocked = tracer.occluded(np.broadcast_to(probe, directions.shape), directions)
    cells = blocked.reshape(DIRECTION_GRID, RAYS_PER_CELL_SIDE, DIRECTION_GRID, -1)
    near = []
    for flags in (~cells, cells):
        any_of_cell = np.asarray(flags.any(axis=(1, 3))).astype(np.uint8)
        spread = maximum_filter(_wrapped(any_of_cell), size=3)[1:-1, 1:-1]
        near.append(spread.reshape(-1) > 0)
    return near[0], near[1]


def _wrapped(cells: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """The map with one row or column more on each side: across an edge it continues mirrored."""
    padded = np.pad(cells, 1)
    padded[0, 1:-1], padded[-1, 1:-1] = cells[0, ::-1], cells[-1, ::-1]
    padded[1:-1, 0], padded[1:-1, -1] = cells[::-1, 0], cells[::-1, -1]
    return padded
