"""Light from beyond a scene that falls on surfaces which the probes around them do not see, as on a
model's outside, where a volume that fits the scene has none.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.model import Scene
from gibench.techniques.parts.free_space import cosine_directions, free_space, points_on_surfaces
from gibench.techniques.parts.probe_volume import Volume
from gibench.techniques.parts.thin_walls import MATTERS, thickness_behind

_POINTS: Final = 2048
_LOOKS: Final = 8  # cosine-distributed rays from each


def told_of_sky(
    technique: str, scene: Scene, volume: Volume, bias: float, cost: str, most: float, reach: float
) -> list[str]:
    """That probes miss much of the sky's light, and the volume that would have it; where walls
    between its probes and those inside are thinner than what is looked up reaches, that it would
    light the inside, too.

    Args:
        technique: whose settings ``counts``, ``origin`` and ``spacing`` are.
        scene: the scene.
        volume: of the probes.
        bias: how far off the surface they are looked for, m.
        cost: what grows as the number of probes, in words.
        most: share of all light that may fall where no probe is seen.
        reach: m through which light that is looked up comes.
    """
    unseen = unseen_sky(scene, volume, bias)
    if unseen <= most:
        return []
    larger = wider(volume)
    values = {
        "counts": "x".join(str(count) for count in larger.counts),
        "origin": ",".join(f"{value:.4g}" for value in larger.origin),
        "spacing": ",".join(f"{value:.4g}" for value in larger.spacing),
    }
    given = " ".join(f"--set {technique}.{name}={value}" for name, value in values.items())
    thin = _thin_inside(scene, volume, bias, reach)
    leaks = (
        f", but their sky comes through walls: {thin:.0%} of the surface is inside of ones thinner "
        f"than {reach:.2g} m, and may get as much light too much; no setting is known to mend both"
    )
    return [
        f"{unseen:.0%} of the light is the sky's on surfaces that no probe around them sees, as on "
        f"a model's outside, which stay dark: {given} sets probes there, too, with "
        f"{larger.probes / volume.probes:.1f} times the {cost}" + (leaks if thin > MATTERS else "")
    ]


def _thin_inside(scene: Scene, volume: Volume, bias: float, reach: float) -> float:
    """Share of the surface that probes see and behind which, less than ``reach`` m on, a wall ends:
    a block whose sides are all outside has none.
    """
    points, normals = points_on_surfaces(scene, np.random.default_rng(19), _POINTS)
    origins = points + surface_offset(scene) * normals
    seen = _seen(scene, volume, origins, normals, bias)
    return float((seen & (thickness_behind(scene, points, normals) < reach)).mean())


def unseen_sky(scene: Scene, volume: Volume, bias: float) -> float:
    """Share of all light that is the sky's and falls where no probe around is seen, 0 to 1.

    Half of the lamps' light is taken to come back from what it falls on; a probe counts where it is
    on the grid, before it is moved.

    Args:
        scene: the scene.
        volume: of the probes.
        bias: how far off the surface they are looked for, m.
    """
    space = free_space(scene)
    light = space.sky + space.emitted + space.lamps / 2
    if space.sky <= 0 or space.open <= 0:
        return 0.0
    rng = np.random.default_rng(19)
    points, normals = points_on_surfaces(scene, rng, _POINTS)
    origins = points + surface_offset(scene) * normals
    unseen = ~_seen(scene, volume, origins, normals, bias)
    directions = cosine_directions(np.repeat(normals, _LOOKS, axis=0), rng).astype(np.float32)
    starts = np.repeat(origins, _LOOKS, axis=0).astype(np.float32)
    away = ~scene_tracer(scene).occluded(starts, directions)
    sky = away.reshape(-1, _LOOKS).mean(axis=1)
    if not sky.any():
        return 0.0
    return float(space.sky / light * sky[unseen].sum() / sky.sum())


def _seen(
    scene: Scene, volume: Volume, origins: Doubles, normals: Doubles, bias: float
) -> npt.NDArray[np.bool_]:
    """Which points (n,) any of the eight probes around sees, those before their surface."""
    first, spacing = np.array(volume.origin), np.array(volume.spacing)
    last = np.array(volume.counts) - 1
    at = (origins - first) / spacing
    base = np.clip(np.floor(at + bias * normals / spacing), 0, last)
    seen = np.zeros(len(origins), np.bool_)
    tracer = scene_tracer(scene)
    for corner in np.ndindex(2, 2, 2):
        way = first + np.minimum(base + corner, last) * spacing - origins
        free = ~tracer.occluded(origins.astype(np.float32), way.astype(np.float32), 1.0)
        seen |= free & ((way * normals).sum(axis=1) > 0)
    # As far from the volume as its light has faded (kernels_cl/parts/probe_volume.cl).
    inside = (at > -1.5).all(axis=1) & (at < last + 1.5).all(axis=1)
    return np.asarray(seen & inside)


def wider(volume: Volume) -> Volume:
    """The volume with one more layer of probes all around."""
    x, y, z = (first - step for first, step in zip(volume.origin, volume.spacing, strict=True))
    a, b, c = (count + 2 for count in volume.counts)
    return Volume((x, y, z), volume.spacing, (a, b, c))
