"""Random surfels on a device without a technique around them, and NumPy's own grid."""

from dataclasses import replace

import numpy as np

from gibench.device import Device
from gibench.profiles import load_profile
from gibench.techniques.gibs.conform_oracle import (
    IDENTITY,
    STRETCH,
    frame_words,
    geometry,
    neighbour_lists,
    uniform_coordinates,
)
from gibench.techniques.gibs.macros import GIBS_MACROS
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.surfel_grid import NEIGHBOURS, SurfelGrid, UniformGrid

__all__ = [
    "BOUNDS",
    "IDENTITY",
    "STRETCH",
    "any_size_device",
    "defines",
    "frame_words",
    "geometry",
    "neighbour_lists",
    "run",
    "sort_launches",
    "surfel_grid",
    "uniform_coordinates",
    "unit_vectors",
]

BOUNDS = (np.zeros(3), np.array([1.0, 0.7, 0.9]))


def any_size_device():
    return Device(replace(load_profile("vega56"), simd_width=1, max_workgroup_size=4096))


def defines(capacity, grid=None, **others):
    """Macros of the kernels that look surfels up."""
    grid = grid or UniformGrid.around(BOUNDS, 4)
    return {**SCENE_MACROS, **GIBS_MACROS, **grid.defines,
            "CAPACITY": capacity, "ENTRIES": 27 * capacity,
            "PUBLISHED": False, "ALL_NEIGHBOURS": False, "NORMAL_STRETCH": STRETCH, "VEC": 8,
            "DEPTH": True, "GUIDING": True, "FLOORED": True, **others}  # fmt: skip


def surfel_grid(device, grid, surfels, published, entries=None, stretch=4.0, size=64):
    entries = NEIGHBOURS * surfels.capacity if entries is None else entries
    return SurfelGrid(device, grid, surfels, published, entries, stretch, size)


def sort_launches(surfel_grid, alive):
    return [
        *surfel_grid.transform_and_count(lambda: alive),
        *surfel_grid.prefix_sum(),
        *surfel_grid.finalise(lambda: alive),
    ]


def run(device, launches, size=64):
    for launch in launches:
        device.enqueue(launch, size)


def unit_vectors(n, rng):
    v = rng.normal(size=(n, 3))
    return (v / np.linalg.norm(v, axis=1, keepdims=True)).astype(np.float32)
