"""Random surfels on a device without a technique around them, and NumPy's own grid."""

from dataclasses import replace

import numpy as np

from gibench.device import Device
from gibench.profiles import load_profile
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.surfel_grid import NEIGHBOURS, SurfelGrid, UniformGrid
from gibench.techniques.parts.surfels import SurfelGeometry, surfel_words

STRETCH = 4.0  # what the tests and benchmarks of sorting use
BOUNDS = (np.zeros(3), np.array([1.0, 0.7, 0.9]))
IDENTITY = np.eye(3, 4, dtype=np.float32).reshape(1, 12)


def any_size_device():
    return Device(replace(load_profile("vega56"), simd_width=1, max_workgroup_size=4096))


def defines(capacity, grid=None, **others):
    """Macros of the kernels that look surfels up."""
    grid = grid or UniformGrid.around(BOUNDS, 4)
    return {**SCENE_MACROS, **grid.defines, "CAPACITY": capacity, "ENTRIES": 27 * capacity,
            "PUBLISHED": False, "ALL_NEIGHBOURS": False, "NORMAL_STRETCH": STRETCH, "VEC": 8,
            "DEPTH": True, "GUIDING": True, "FLOORED": True, **others}  # fmt: skip


def frame_words(alive, camera=(0, 0, 0), angle=0.0, least=0.01, most=np.inf, frame=1, rays=0):
    words = surfel_words(alive, camera, angle, least, most)
    return np.concatenate([words, np.array([frame, rays, 7], np.uint32)])


def geometry(device: Device, position, normal, frame, ids=None, capacity=None, transforms=IDENTITY):
    """Surfels of object 1 at ``position`` (n, 3) under the IDs ``ids``."""
    n = len(position)
    capacity = capacity or max(n, 1)
    ids = np.arange(n) if ids is None else ids
    alive = np.zeros(capacity, np.uint32)
    alive[:n] = ids
    objects = np.zeros(capacity, np.int32)
    objects[ids] = 1
    local = np.zeros((2, 3, capacity), np.float32)
    local[0][:, ids] = np.asarray(position, np.float32).T
    local[1][:, ids] = np.asarray(normal, np.float32).T
    return SurfelGeometry(
        device.upload("frame", frame),
        device.upload("alive_ids", alive),
        device.upload("object_ids", objects),
        device.upload("transforms", transforms),
        device.upload("local_position", local[0]),
        device.upload("local_normal", local[1]),
        device.empty("world_position", (3, capacity), np.float32),
        device.empty("world_normal", (3, capacity), np.float32),
        device.empty("radii", capacity, np.float32),
        mean=device.upload("mean", np.random.default_rng(5).random((3, capacity), np.float32)),
        nearest=device.empty("nearest", capacity, np.float32),
    )


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


def uniform_coordinates(grid: UniformGrid, position):
    """The cell coordinates (n, 3) of points, by the device's own float32 operations."""
    table = grid.table((0, 0, 0))
    at = np.floor((np.asarray(position, np.float32) - table[:3]) * table[4])
    return np.clip(at, 0, np.array(grid.shape) - 1).astype(int)


def neighbour_lists(grid: UniformGrid, position):
    """Every cell's set of surfels when each goes into its cell and all neighbours."""
    lists = [set() for _ in range(grid.cells)]
    nx, ny, nz = grid.shape
    for i, (x, y, z) in enumerate(uniform_coordinates(grid, position)):
        for cz in range(max(z - 1, 0), min(z + 2, nz)):
            for cy in range(max(y - 1, 0), min(y + 2, ny)):
                for cx in range(max(x - 1, 0), min(x + 2, nx)):
                    lists[(cz * ny + cy) * nx + cx].add(i)
    return lists
