"""Where DDGI's probes are, and which rays they cast."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Floats
from gibench.scene.model import Scene
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.parts.directions import random_rotation, spherical_fibonacci
from gibench.techniques.parts.free_space import free_space
from gibench.techniques.parts.probe_volume import Volume, fit_counts, fit_volume, given_volume

PROBES_PER_SRP_PROBE = 8  # our choice: half of SRP's probe distance along every axis
# Where nobody says how many: between surfaces that face each other two or three along each axis,
# no more than Ekberg 2022 takes for Sponza, and no fewer than the Cornell Box gets.
SPACINGS = 0.4  # of the closeness of surfaces
FEWEST_PROBES, MOST_PROBES = 216, 2000


def make_volume(scene: Scene, settings: DdgiSettings) -> Volume:
    """The volume that the settings ask for.

    Raises:
        BadInput: it misses the scene.
    """
    counts = settings.given_counts
    origin, spacing = settings.given_origin, settings.given_spacing
    if counts is not None and origin is not None and spacing is not None:
        return given_volume(scene, counts, origin, spacing)
    low, high = scene.bounds
    return fit_volume(low, high, counts or fit_counts(low, high, _budget(scene, settings)))


def wanted_probes(scene: Scene, spacing: float) -> int:
    """How many fill the scene's bounds, ``spacing`` metres apart."""
    space = free_space(scene)
    extent = np.maximum(space.extent, spacing)
    return int(np.ceil(np.prod(extent) / spacing**3 - 1e-9))


def _budget(scene: Scene, settings: DdgiSettings) -> int:
    if settings.probes is not None:
        return settings.probes
    if not scene.probes.automatic:
        return PROBES_PER_SRP_PROBE * scene.probes.count
    closeness = free_space(scene).closeness
    if not np.isfinite(closeness):
        return FEWEST_PROBES
    return min(max(wanted_probes(scene, SPACINGS * closeness), FEWEST_PROBES), MOST_PROBES)


def ray_directions(settings: DdgiSettings, seed: int, frame: int) -> Floats:
    """A frame's ray directions (rays, 3): the fixed ones, then the rotated ones."""
    rotation = random_rotation(np.random.default_rng((seed, frame)))
    rotated = spherical_fibonacci(settings.blended) @ rotation.T
    directions = np.concatenate([spherical_fibonacci(settings.fixed), rotated])
    return directions.astype(np.float32)
