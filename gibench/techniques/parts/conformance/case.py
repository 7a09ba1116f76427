"""A case of `gibench conform`: kernels, and what compares them with their oracle.

A technique brings its own: a module ``conform.py`` in its folder that defines ``CASES``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable
from typing import Any, NamedTuple

import numpy as np

from gibench.arrays import Array
from gibench.device import Device, Launch, Layout
from gibench.profiles import load_profile
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.job import Job, Shot, World
from gibench.techniques.registry import TechniqueSpec
from gibench.techniques.technique import Technique

# 7 and 100 divide none of the problems.
SIZES = (1, 7, 64, 100)
_MOST_ITEMS = 512


@dataclass(frozen=True)
class Bench:
    """Where cases run.

    Attributes:
        cl_device: the OpenCL device.
        kernel_root: another kernel tree than the installed one.
    """

    cl_device: Any
    kernel_root: Traversable | None = None

    def open(self, local_memory: int = 16384, layout: Layout | None = None) -> Device:
        """A device on which any work-group size up to 512 may be tried."""
        profile = replace(
            load_profile("vega56"),
            simd_width=1,
            max_workgroup_size=min(_MOST_ITEMS, int(self.cl_device.max_work_group_size)),
            local_memory_bytes=min(local_memory, int(self.cl_device.local_mem_size)),
        )
        return Device(profile, self.cl_device, self.kernel_root, layout)


class Tolerance(NamedTuple):
    """What an element may be off by: ``absolute + relative * |expected|``.

    A quantity has one, which its test and its case share.
    """

    relative: float = 0.0
    absolute: float = 0.0


Check = Callable[[Bench, np.random.Generator, int], Iterator[float]]


@dataclass(frozen=True)
class Case:
    """Kernels that are judged together.

    Attributes:
        name: in words.
        kernels: each as ``file.cl:name``.
        check: runs them at a work-group size, and yields for each comparison the largest deviation
            as a share of what is allowed (:func:`off`): above 1 is wrong.
        sizes: work-group sizes.
    """

    name: str
    kernels: tuple[str, ...]
    check: Check
    sizes: tuple[int, ...] = SIZES


def off(found: Array, expected: Array, relative: float = 0.0, absolute: float = 0.0) -> float:
    """The largest deviation as a share of ``absolute + relative * |expected|``; infinite where one
    is not a number, or the shapes differ; 0 where both are equal.
    """
    found, expected = np.asarray(found), np.asarray(expected)
    if found.shape != expected.shape:
        return float("inf")
    if not found.size:
        return 0.0
    found, expected = found.astype(np.float64), expected.astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        allowed = np.maximum(absolute + relative * np.abs(expected), 1e-300)
        share = np.where(found == expected, 0.0, np.abs(found - expected) / allowed)
    return float(np.where(np.isnan(share), np.inf, share).max())


def at_least(compared: float, least: float) -> float:
    """Above 1 where less than ``least``, a share or a number, could be compared."""
    return 0.0 if compared >= least else float("inf")


def run(device: Device, launches: Sequence[Launch], size: int) -> None:
    """Enqueue launches in order, ``size`` work-items per group."""
    for launch in launches:
        device.enqueue(launch, size)


def run_pass(technique: Technique, name: str, size: int) -> None:
    """One pass of a technique alone."""
    (declared,) = [each for each in technique.passes() if each.name == name]
    run(technique.device, declared.launches(), size)


def created(
    spec: TechniqueSpec,
    device: Device,
    scene: Scene,
    lightmap: Lightmap,
    settings: Any,
    baked: Any,
    variant: str,
    size: int,
    image: tuple[int, int] = (24, 16),
    motion: MovingObjects | None = None,
) -> Any:
    """A technique on a device, without a run around it."""
    shot = Shot(*image)
    job = Job(spec.name, settings, variant, scene.name, device.profile, size, seed=0, shot=shot)
    return spec.create(device, job, World(scene, lightmap, baked, scene.cameras[0], None, motion))
