"""A technique set up on a device by hand, without a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gibench.device import BufferSpec, Device
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.camera_path import Flight
from gibench.techniques.job import Job, Known, Shot, World
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
    """The technique ``spec`` with ``size`` work-items per group, which allocates what it declares,
    buffer by buffer.
    """
    shot = Shot(width, height)
    job = Job(spec.name, settings, variant, scene.name, device.profile, size, seed=seed, shot=shot)
    world = World(scene, lightmap, baked, camera, flight, motion)
    before = set(device.memory.allocated)
    technique: Any = spec.create(device, job, world)
    tree = technique.scene.bvh
    declared = by_name(spec.buffers(Known.all_of(job, world, tree, device)))
    held = {name: n for name, n in device.memory.allocated.items() if name not in before}
    assert held == declared
    return technique


def by_name(buffers: Sequence[BufferSpec]) -> dict[str, int]:
    """Bytes of declared buffers by name."""
    found = {buffer.name: buffer.nbytes for buffer in buffers}
    assert len(found) == len(buffers)
    return found


def check_memory(
    spec: TechniqueSpec,
    technique: Any,
    settings: Any,
    variant: str,
    size: int,
    receivers: int,
    motion: MovingObjects | None = None,
) -> tuple[int, int]:
    """What is declared before anything is baked or opened is a lower bound of every buffer that is
    there; the sums of both.
    """
    device, scene = technique.device, technique.scene
    shot = Shot(scene.width, scene.height)
    job = Job(spec.name, settings, variant, scene.scene.name, device.profile, size, shot=shot)
    least = by_name(spec.buffers(Known(job, scene.scene, receivers, motion=motion)))
    held = device.memory.allocated
    assert set(least) <= set(held)
    assert all(least[name] <= held[name] for name in least)
    return sum(least.values()), sum(held.values())
