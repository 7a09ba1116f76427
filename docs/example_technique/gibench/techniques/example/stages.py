"""The bake, in two stages: how far each probe sees, then how much of that is open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from gibench.techniques.example.settings import ExampleSettings

from gibench.arrays import Floats
from gibench.bake.stage import Arrays, Format, Stage, Unit, stage_key
from gibench.rays.embree import scene_tracer
from gibench.scene.model import Scene
from gibench.techniques.parts.directions import spherical_fibonacci
from gibench.techniques.parts.probe_volume import Volume, fit_volume
from gibench.techniques.registry import BakeContext
from gibench.work import Worker

# Raised whenever what a stage computes, or how it is stored, changes.
DISTANCES_VERSION = OPENNESS_VERSION = 1


@dataclass(frozen=True)
class Given:
    """What both stages are computed from; plain data, so that it can be sent anywhere."""

    scene: Scene
    settings: ExampleSettings


def volume_of(scene: Scene, settings: ExampleSettings) -> Volume:
    """Where the probes are."""
    return fit_volume(*scene.bounds, settings.grid)


def stages(context: BakeContext) -> tuple[Stage, ...]:
    """The last one's value is what the technique is created with.

    A key holds all that the stage depends on and no more: with another reach the distances are
    read, not traced again.
    """
    scene, settings = context.scene, context.settings
    given = Given(scene, settings)
    distances = Stage(
        name="example-distances",
        key=stage_key(
            "example-distances",
            DISTANCES_VERSION,
            scene.geometry_hash(),
            settings.grid,
            settings.rays,
        ),
        compute=_distances,
        given=given,
        format=Format(_write, _read),
    )
    openness = Stage(
        name="example-openness",
        key=stage_key("example-openness", OPENNESS_VERSION, settings.reach, needs=(distances,)),
        compute=_openness,
        given=given,
        needs=(distances,),
        format=Format(_write, _read),
    )
    return distances, openness


def _distances(given: Given, needed: Sequence[Floats], unit: Unit, worker: Worker) -> Floats:
    """Distance (probes, rays) to the nearest surface, m; infinite where there is none."""
    probes = volume_of(given.scene, given.settings).positions.astype(np.float32)
    rays = spherical_fibonacci(given.settings.rays).astype(np.float32)
    origins = np.repeat(probes, len(rays), axis=0)
    hits = scene_tracer(given.scene).closest(origins, np.tile(rays, (len(probes), 1)))
    return hits.distance.reshape(len(probes), len(rays))


def _openness(given: Given, needed: Sequence[Floats], unit: Unit, worker: Worker) -> Floats:
    """Share (probes,) of a probe's rays that meet nothing within reach."""
    (distances,) = needed
    share: Floats = np.mean(distances > given.settings.reach, axis=1, dtype=np.float32)
    return share


def _write(value: Floats) -> Arrays:
    return {"value": value}


def _read(unit: Unit, stored: Arrays) -> Floats:
    value: Floats = stored["value"]
    return value
