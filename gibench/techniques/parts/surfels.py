"""Surfels on the device: preallocated, structure of arrays."""

from __future__ import annotations

from dataclasses import dataclass

from gibench.device import Buffer


@dataclass(frozen=True)
class SurfelGeometry:
    """The surfels' buffers that sorting reads and writes (kernels_cl/parts/surfel_sort.cl).

    Attributes:
        frame: (10,) uint32 what changes with the frame (kernels_cl/gibs/frame.cl).
        alive_ids: (capacity,) uint32.
        object_ids: (capacity,) int32, from 1; 0 is a surfel that is not placed.
        transforms: (objects, 12) float32, object to world, 3 x 4 row-major.
        local_position: (3, capacity) float32 in object space, m.
        local_normal: (3, capacity) float32 in object space, unit.
        world_position: (3, capacity) float32, m.
        world_normal: (3, capacity) float32, unit.
        radii: (capacity,) float32, m.
        mean: (3 or more, capacity) float32; rows 0-2 are the irradiance, W/m2.
        nearest: (capacity,) float32 least mean depth, m.
    """

    frame: Buffer
    alive_ids: Buffer
    object_ids: Buffer
    transforms: Buffer
    local_position: Buffer
    local_normal: Buffer
    world_position: Buffer
    world_normal: Buffer
    radii: Buffer
    mean: Buffer
    nearest: Buffer

    @property
    def capacity(self) -> int:
        """Number of surfels there is room for."""
        return self.alive_ids.shape[0]
