"""Where DDGI's probes are, and which rays they cast."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Floats
from gibench.scene.model import Scene
from gibench.techniques.ddgi.settings import DdgiSettings
from gibench.techniques.parts.directions import random_rotation, spherical_fibonacci
from gibench.techniques.parts.probe_volume import Volume, fit_counts, fit_volume, given_volume

PROBES_PER_SRP_PROBE = 8  # our choice: half of SRP's probe distance along every axis


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
    budget = settings.probes or PROBES_PER_SRP_PROBE * scene.probes.count
    return fit_volume(low, high, counts or fit_counts(low, high, budget))


def ray_directions(settings: DdgiSettings, seed: int, frame: int) -> Floats:
    """A frame's ray directions (rays, 3): the fixed ones, then the rotated ones."""
    rotation = random_rotation(np.random.default_rng((seed, frame)))
    rotated = spherical_fibonacci(settings.blended) @ rotation.T
    directions = np.concatenate([spherical_fibonacci(settings.fixed), rotated])
    return directions.astype(np.float32)
