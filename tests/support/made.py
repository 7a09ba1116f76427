"""A technique set up on a device by hand, without a run."""

from __future__ import annotations

from typing import Any

from gibench.device import Device
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.camera_path import Flight
from gibench.techniques.job import Job, Shot, World
from gibench.techniques.registry import TechniqueSpec


def made(
    spec: TechniqueSpec,
    device: Device,
    scene: Scene,
    lightmap: Lightmap,
    settings: Any,
    baked: Any,
    variant: str,
    size: int,
    width: int,
    height: int,
    camera: Camera,
    seed: int = 0,
    flight: Flight | None = None,
    motion: MovingObjects | None = None,
) -> Any:
    """The technique ``spec`` with ``size`` work-items per group."""
    shot = Shot(width, height)
    job = Job(spec.name, settings, variant, scene.name, device.profile, size, seed=seed, shot=shot)
    return spec.create(device, job, World(scene, lightmap, baked, camera, flight, motion))
